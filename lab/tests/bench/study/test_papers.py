"""The networks of the paper learn from the same frames as ours, and say how."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import made_dataset, write_table, write_tub  # noqa: F401

from lab.bench.imitation.training_code import one_stage
from lab.bench.study import learned, papers
from lab.bench.study.papers import (
    AUTO_ENCODER,
    NETWORKS,
    PAPER,
    TRUNKS,
    Contestant,
    bench_deep_steer,
    bench_trunks,
    changes_of,
)
from learning.dataset.dataset import Dataset
from learning.judging.evaluate import BIN_RATIO
from learning.models.catalogue import MODELS, build
from learning.rendered import say
from learning.training.frames import Frames
from learning.training.recipe import load_recipe
from learning.training.run import run

ALIKE = {
    "size": lambda recipe: (recipe.height_px, recipe.width_px),
    "epochs": lambda recipe: [(stage.part, stage.epochs) for stage in recipe.stages],
    "augmentation": lambda recipe: recipe.augmentation,
    "optimiser": lambda recipe: recipe.optimiser,
    "seed": lambda recipe: recipe.seed,
}
"""What the recipes of TRUNKS share, of a recipe."""
TINY = {"stages": one_stage(2, 1.0e-3), "height_px": "24", "width_px": "32", "batch": "16"}


def test_every_network_of_the_paper_is_trained_at_its_size_on_a_gpu_and_smaller_without_one():
    for row in NETWORKS:
        model = papers.model_of(row)
        full, small = (load_recipe(model, None, overrides=changes_of(row, 7, at)) for at in ("cuda", "cpu"))
        assert full.height_px is full.width_px is None, "the size of the network itself"
        assert full.seed == small.seed == 7 and full.augmentation.flip == small.augmentation.flip
        if model in papers.REDUCED:
            assert small.width_px < MODELS[model].width and small.height_px < MODELS[model].height
            assert full.histogram == "match" and full.augmentation.brightness == full.augmentation.erase == 0
    assert {"vgg16", "vgg19", "inception-v3", "inception-rnn", "inception-rnn-as-printed"} < set(NETWORKS)


def test_the_trunks_learn_equally_many_frames_of_one_size_in_equal_epochs():
    recipes = {row: load_recipe(row, None, overrides=papers.trunk_changes_of(row, 7)) for row in TRUNKS}
    assert {"vgg16", "vgg19", "inception-v3", "inception-rnn", "inception-rnn-as-printed"} < set(recipes)
    one_of = {field: len({repr(of(one)) for one in recipes.values()}) for field, of in ALIKE.items()}
    assert one_of == dict.fromkeys(ALIKE, 1)
    moments = np.arange(400.0)
    train = Frames(moments, moments, np.zeros(400, int), np.zeros(400, int), ("drive",))
    shown = {
        row: papers.frames_of_epoch(
            train, build(row, height=recipe.height_px, width=recipe.width_px, head=recipe.head), recipe
        )
        for row, recipe in recipes.items()
        if row in ("steer", "inception-v3", "inception-rnn")
    }
    assert shown.pop("inception-rnn") == pytest.approx(400, abs=papers.WINDOW)
    assert set(shown.values()) == {400}
    rnn = recipes["inception-rnn"]
    assert rnn.window * rnn.batch == recipes["vgg19"].batch, "as many frames in a step"


def test_a_quick_study_of_trunks_leaves_vgg_out(monkeypatch):
    monkeypatch.setattr(papers, "study_sets", lambda seed, roads: None)
    monkeypatch.setattr(papers, "_table", lambda sets, seed, changes, name, jobs: changes)
    whole, part = bench_trunks(seed=1), bench_trunks(seed=1, quick=True)
    assert set(whole) - set(part) == {"vgg16", "vgg19"}
    assert part.items() < whole.items()


def test_the_row_of_a_wheel_held_straight_has_the_mean_angle_of_each_split(data: Dataset):
    row = papers.straight_row(learned.Sets(data, data))
    angles = np.degrees(np.abs(data.labelled_rows("test")["road_wheel_rad"])) * BIN_RATIO
    assert row["test_deg"] == row["unseen_deg"] == pytest.approx(float(angles.mean()), abs=1e-3)
    assert set(row) == {f"{name}_deg" for name in ("train", "validation", "test", "unseen")}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drive")
    return made_dataset(folder / "set", write_tub(folder / "tub"), options=("--lock-deg", "20"))


@pytest.fixture
def tiny_study(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small data set in place of the drives, and networks of a moment."""
    monkeypatch.setattr(papers, "study_sets", lambda seed, roads=0: learned.Sets(data, data))
    monkeypatch.setattr(learned, "WORK_DIR", tmp_path)
    for rows in ("NETWORKS", "TRUNKS"):
        monkeypatch.setattr(papers, rows, {"steer": TINY, "steer-lstm": TINY | {"window": "2"}})


@pytest.mark.long
def test_a_study_that_is_started_again_trains_nothing_twice_and_states_its_recipe(tiny_study, monkeypatch):
    found = bench_deep_steer(seed=0)["mean absolute error"]
    assert set(found) == {*PAPER, "always straight", "steer", "steer-lstm"}
    row = found["steer"]
    assert row["frame"] == "32×24" and row["first weights"] == "random"
    assert row["recipe"] == "adamw 0.001, 2 epochs, batches of 16" and row["device"]
    assert row["test_deg"] == row["unseen_deg"] > 0, "one data set stands for both here"
    assert row["frames"] == found["steer-lstm"]["frames"] // 2 + 1, (
        "two frames in a sequence, one less of them"
    )
    trunks = bench_trunks(seed=0)
    monkeypatch.setattr("learning.training.run.train_network", None)
    assert bench_deep_steer(seed=0)["mean absolute error"] == found and bench_trunks(seed=0) == trunks


@pytest.mark.long
def test_the_errors_are_those_of_the_exported_network(data: Dataset, tmp_path: Path):
    row = papers.trained_row(
        Contestant("steer", tuple(TINY.items()), data.folder, data.folder, tmp_path / "steer")
    )
    recipe = load_recipe("steer", None, overrides=TINY)
    run(data, "steer", tmp_path / "steer.onnx", recipe, resume=False, command="test", report=say)
    exported = learned.scores(learned.Sets(data, data), tmp_path / "steer.onnx")
    assert row["unseen_deg"] == pytest.approx(exported["mae_deg"], abs=0.01)
    assert row["unseen_r2"] == pytest.approx(exported["r2"], abs=0.001)


@pytest.mark.long
def test_a_training_that_leaves_the_finite_numbers_has_a_row_that_says_so(data: Dataset, tmp_path: Path):
    wild = TINY | {"stages": one_stage(2, 1.0e30), "optimiser": "sgd"}
    row = papers.trained_row(
        Contestant("steer", tuple(wild.items()), data.folder, data.folder, tmp_path / "wild")
    )
    assert "not finite" in row["failed"] or "no finite angle" in row["failed"]


def test_the_tables_of_the_paper_stand_as_printed():
    assert PAPER["InceptionV3, paper"]["unseen_deg"] == 4.25 and PAPER["RNN, paper"]["unseen_deg"] == 3.82
    assert AUTO_ENCODER in NETWORKS
