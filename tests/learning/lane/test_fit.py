"""Claims about training, on tiny made-up data: a bright stripe whose place is the lane's offset."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from learning.lane.fit import Recipe, largest_difference, train  # noqa: E402
from learning.lane.network import SteerNetwork, command_row, export, loss  # noqa: E402
from learning.lane.scores import LabelledFrames  # noqa: E402
from learning.lane.unlabelled import SelfTraining, UnlabelledFrames  # noqa: E402
from learning.unlike import attach  # noqa: E402
from perception.net.canonical import crop_camera  # noqa: E402
from perception.net.steer_net import Network  # noqa: E402
from trepid.car.camera import Camera  # noqa: E402
from trepid.clothoid import Lane  # noqa: E402
from trepid.config import CONFIG_DIR, InputError, load  # noqa: E402

pytestmark = pytest.mark.long
CANONICAL = crop_camera(
    load(CONFIG_DIR / "camera.yaml", Camera), top_px=82, bottom_px=202, width_px=200, height_px=66
)
MIDDLE = np.array([0, 0, 0, 0, 3.3], np.float32)
SPREAD = np.array([0.5, 0.08, 0.02, 0.02, 0.4], np.float32)
TINY = load(CONFIG_DIR / "train.yaml", Recipe).model_copy(update=dict(batch=32, epochs=2, bfloat16=False))


def stripes(count: int, seed: int) -> LabelledFrames:
    rng = np.random.default_rng(seed)
    images = rng.integers(60, 120, (count, 66, 200, 3), dtype=np.uint8)
    lanes = (MIDDLE + rng.uniform(-1, 1, (count, 5)) * SPREAD).astype(np.float32)
    for image, offset in zip(images, lanes[:, 0], strict=True):
        column = int(100 + 120 * offset)
        image[:, column - 5 : column + 5] = 230
    return LabelledFrames(images, lanes, np.ones(count, bool))


def bare() -> SteerNetwork:
    return SteerNetwork(torch.from_numpy(MIDDLE), torch.from_numpy(SPREAD), 10.0, 8.0)


def fit(tmp_path, recipe=TINY, resume=False, report=None, unlabelled=None):
    lines = []
    network, progress = train(
        recipe,
        stripes(96, 0),
        stripes(32, 1),
        canonical=CANONICAL,
        wheelbase_m=2.7,
        unlabelled=unlabelled,
        checkpoint=tmp_path / "c.pt",
        resume=resume,
        report=report or lines.append,
    )
    return network, progress, lines


@pytest.fixture(scope="module")
def whole_fit(tmp_path_factory):
    """Folder, network, progress and reports of a training in one go."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, *fit(folder)


def test_the_command_row_is_pure_pursuit():
    lane = np.array([0.3, -0.02, 0.03, 0.01])
    expected = Lane(0.3, -0.02, 0.03, (0.01 - 0.03) / 10).pursuit_curvature(7.0)
    assert float(command_row(10.0, 7.0).double().numpy() @ lane) == pytest.approx(expected, abs=1e-8)


def test_training_is_the_same_twice_and_the_loss_falls(whole_fit, tmp_path):
    _, one, progress, lines = whole_fit
    two, *_ = fit(tmp_path)
    assert progress.epoch == 2 and len(lines) == 2 and "epoch 2/2" in lines[1]
    assert all(torch.equal(a, b) for a, b in zip(one.parameters(), two.parameters(), strict=True))
    losses = [float(text.split("validation")[1].split()[0]) for text in lines]
    assert losses[1] < losses[0]


def test_a_resumed_training_equals_one_in_one_go(whole_fit, tmp_path):
    _, whole, *_ = whole_fit

    def interrupt(text: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(tmp_path, report=interrupt)
    resumed, progress, lines = fit(tmp_path, resume=True)
    assert progress.epoch == 2 and len(lines) == 1
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), resumed.parameters(), strict=True))


def test_resuming_another_recipe_is_refused(whole_fit):
    folder, *_ = whole_fit
    with pytest.raises(InputError, match="another recipe"):
        fit(folder, recipe=TINY.model_copy(update=dict(seed=9)), resume=True)


def test_frames_without_labels_change_the_training_and_only_the_same_ones_continue_it(tmp_path):
    loose = SelfTraining(share=0.5, after=0.5, agree_deg=60.0, most_frames=100)
    recipe = TINY.model_copy(update=dict(self_training=loose))
    drive = UnlabelledFrames(stripes(40, 5).images, np.zeros(40, int))
    alone, *_ = fit(tmp_path, recipe)
    whole, _, lines = fit(tmp_path, recipe, unlabelled=drive)
    assert lines[0].startswith("0 of 40 frames") and lines[2].startswith("40 of 40 frames")
    assert not torch.equal(next(alone.parameters()), next(whole.parameters()))

    def interrupt(text: str) -> None:
        if "epoch 1" in text:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(tmp_path, recipe, unlabelled=drive, report=interrupt)
    with pytest.raises(InputError, match="other drives"):
        fit(
            tmp_path,
            recipe,
            unlabelled=UnlabelledFrames(stripes(40, 6).images, np.zeros(40, int)),
            resume=True,
        )
    resumed, *_ = fit(tmp_path, recipe, unlabelled=drive, resume=True)
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), resumed.parameters(), strict=True))


def test_the_exported_network_agrees_with_torch_for_any_batch(whole_fit, tmp_path):
    _, network, *_ = whole_fit
    export(network, tmp_path / "n.onnx")
    attach(tmp_path / "n.onnx", stripes(12, 3).images)
    exported = Network(tmp_path / "n.onnx")
    for count in (1, 5):
        assert largest_difference(network, exported, stripes(count, 2).images) < 1e-4


def test_frames_without_a_road_do_not_contribute_to_the_loss_of_the_lane():
    torch.manual_seed(0)
    network = bare()
    raw = torch.randn(2, 12)
    visible = torch.tensor([1.0, 0.0])
    lanes = torch.zeros(2, 5)
    elsewhere = lanes.clone()
    elsewhere[1] = 1.0
    assert loss(network, raw, lanes, visible, beta=0.5) == loss(network, raw, elsewhere, visible, beta=0.5)


def test_the_loss_is_least_where_sigma_equals_the_error():
    network = bare()
    error = 0.7
    lanes = torch.full((1, 5), error) * network.lane_spread + network.lane_middle
    sigmas = torch.linspace(0.3, 1.5, 121)
    losses = []
    for sigma in sigmas:
        raw = torch.zeros(1, 12)
        raw[:, 5:10] = sigma.log()
        losses.append(float(loss(network, raw, lanes, torch.ones(1), beta=0.0)))
    assert float(sigmas[int(np.argmin(losses))]) == pytest.approx(error, abs=0.02)
