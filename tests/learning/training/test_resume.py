"""A training that is interrupted ends with the weights of an undisturbed one, bit by bit."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

import learning.training.loop  # noqa: E402
from learning.descent import descend  # noqa: E402
from learning.models.catalogue import build  # noqa: E402
from learning.training.checkpoint import Checkpoints  # noqa: E402
from learning.training.frames import Frames  # noqa: E402
from learning.training.loop import Trainer  # noqa: E402
from learning.training.recipe import load_recipe  # noqa: E402
from learning.training.run import batches_of, prepare  # noqa: E402
from trepid.config import InputError  # noqa: E402

pytestmark = pytest.mark.long
STAGES = (
    "[{name: top, part: top, epochs: 1, learning_rate: 1.0e-3, schedule: constant, patience: 9}, "
    "{name: fine, part: all, epochs: 2, learning_rate: 1.0e-3, schedule: cosine, patience: 9}]"
)
RECIPE = {"batch": "16", "checkpoint_s": "1.0e-9", "stages": STAGES, "window": "2"}
STEPS = 9  # 3 epochs of 3 batches


def frames(count: int, seed: int) -> Frames:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (count, 24, 32, 3)).astype(np.uint8)
    labels = rng.normal(0, 0.1, count).astype(np.float32)
    return Frames(images, labels, np.zeros(count, np.int32), np.zeros(count, np.int64), ("a",))


def trainer(folder, model="steer", **changes) -> Trainer:
    recipe = load_recipe(model, None, overrides=RECIPE | changes)
    torch.manual_seed(recipe.seed)
    network, train = build(model, height=24, width=32), frames(48, 0)
    prepare(network, recipe, train, lock_rad=None)
    return Trainer(
        recipe=recipe,
        network=network,
        batches=batches_of(recipe, network, train, print),
        validation=frames(16, 1),
        checkpoints=Checkpoints(folder / "checkpoint"),
        identity=recipe.model_dump_json(),
        report=lambda text: None,
        on_epoch=lambda progress: None,
    )


def weights(one: Trainer) -> dict[str, torch.Tensor]:
    return one.network.state_dict()


@pytest.fixture(scope="module")
def whole_training(tmp_path_factory):
    whole = trainer(tmp_path_factory.mktemp("whole"))
    whole.run(resume=False)
    return whole


@pytest.mark.parametrize("step", [1, 2, 3, 4, 5, 8, 9])
def test_a_training_killed_at_any_step_gives_the_same_weights(step, whole_training, tmp_path, monkeypatch):
    done = []

    def until(*args, **kwargs):
        if len(done) == step - 1:
            raise KeyboardInterrupt
        done.append(step)
        return descend(*args, **kwargs)

    monkeypatch.setattr(learning.training.loop, "descend", until)
    with pytest.raises(KeyboardInterrupt):
        trainer(tmp_path).run(resume=False)
    monkeypatch.undo()
    resumed = trainer(tmp_path)
    progress = resumed.run(resume=True)
    assert all(torch.equal(value, weights(whole_training)[name]) for name, value in weights(resumed).items())
    assert [p["validation_mae_rad"] for p in progress.curve] == [
        p["validation_mae_rad"] for p in whole_training.progress.curve
    ]


def test_a_resumed_training_repeats_no_finished_step(tmp_path, monkeypatch):
    trainer(tmp_path).run(resume=False)
    counted = []
    monkeypatch.setattr(learning.training.loop, "descend", lambda *a, **k: counted.append(1))
    trainer(tmp_path).run(resume=True)
    assert counted == []


def test_the_checkpoint_of_another_recipe_is_refused(tmp_path):
    trainer(tmp_path).run(resume=False)
    with pytest.raises(InputError, match="of another network, recipe or data set"):
        trainer(tmp_path, batch="8").run(resume=True)


def test_a_checkpoint_cut_in_half_is_named_and_the_one_before_is_used(whole_training, tmp_path):
    trainer(tmp_path).run(resume=False)
    path = tmp_path / "checkpoint"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    said = []
    resumed = trainer(tmp_path)
    resumed.report = said.append
    resumed.run(resume=True)
    assert said[0] == f"{path}: cut off or damaged: not used"
    assert all(torch.equal(value, weights(whole_training)[name]) for name, value in weights(resumed).items())


def test_damaged_checkpoints_alone_are_refused(tmp_path):
    checkpoints = Checkpoints(tmp_path / "checkpoint")
    (tmp_path / "checkpoint").write_bytes(b"half")
    with pytest.raises(InputError, match="cut off or damaged, and no other checkpoint"):
        checkpoints.load(lambda text: None)


def test_a_kill_between_the_two_renames_leaves_a_checkpoint(tmp_path):
    checkpoints = Checkpoints(tmp_path / "checkpoint")
    checkpoints.save({"number": 1})
    (tmp_path / "checkpoint").rename(tmp_path / "checkpoint.before")
    assert checkpoints.load(lambda text: None) == {"number": 1}


def test_the_first_stage_leaves_the_trunk_as_it_was(tmp_path):
    one = trainer(tmp_path, stages=STAGES.partition(", {name: fine")[0] + "]")
    before = {name: value.clone() for name, value in one.network.trunk.state_dict().items()}
    one.run(resume=False)
    assert all(torch.equal(value, before[name]) for name, value in one.network.trunk.state_dict().items())


def test_a_stage_ends_when_the_validation_error_has_not_fallen_for_its_patience(tmp_path, monkeypatch):
    stages = "[{name: all, part: all, epochs: 9, learning_rate: 1.0e-30, schedule: constant, patience: 2}]"
    progress = trainer(tmp_path, model="rausch", stages=stages).run(resume=False)
    assert progress.epoch == 3 and progress.best_epoch == 1
