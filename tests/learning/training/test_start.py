"""A training that begins with the weights of another one."""

import json
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import made_dataset, run, write_tub  # noqa: E402

from learning.dataset.dataset import Dataset  # noqa: E402
from learning.training.start import copy_start, work_folder  # noqa: E402
from perception.net.driver import DriverNetwork  # noqa: E402

pytestmark = pytest.mark.long
SMALL = ("--set", "height_px=24", "--set", "width_px=32", "--set", "batch=32", "--set", "average=0.9")


def stages(epochs: int, rate: float) -> str:
    fields = f"epochs: {epochs}, learning_rate: {rate}, schedule: cosine, patience: 99"
    return f"stages=[{{name: all, part: all, {fields}}}]"


def train_network(data: Dataset, out: Path, *words: str, epochs: int = 8, rate: float = 3e-3) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the ONNX export in torch
        command = ("train", "--data", str(data.folder), "--model", "steer", "--out", str(out), *SMALL)
        return run(*command, "--set", stages(epochs, rate), *words)


@pytest.fixture(scope="module")
def first(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("first") / "first.onnx"
    assert train_network(data, out) == 0
    return out


def angles(weights: Path, data: Dataset) -> np.ndarray:
    network = DriverNetwork(weights)
    return np.array(
        [network(image, network.initial_state).road_wheel_rad for image in data.images(data.rows("test"))]
    )


def test_a_training_that_learns_nothing_more_ends_with_the_network_that_it_began_with(data, first, tmp_path):
    out = tmp_path / "same.onnx"
    assert train_network(data, out, "--start", str(first), epochs=1, rate=1e-30) == 0
    assert angles(out, data) == pytest.approx(angles(first, data), abs=1e-6)
    assert "all of first.onnx, sha256" in out.with_suffix(".md").read_text()


def test_a_training_that_makes_the_network_worse_keeps_the_weights_that_it_began_with(data, first, tmp_path):
    out = tmp_path / "spoilt.onnx"
    assert train_network(data, out, "--start", str(first), epochs=1, rate=10.0) == 0
    assert angles(out, data) == pytest.approx(angles(first, data), abs=1e-5)
    assert "no epoch improved on them" in out.with_suffix(".md").read_text()


def test_the_first_epoch_of_a_continued_training_is_nearer_than_that_of_a_new_one(data, first, tmp_path):
    def first_error(out: Path) -> float:
        lines = (work_folder(out) / "curve.jsonl").read_text().splitlines()
        return float(json.loads(lines[0])["validation_mae_rad"])

    for name, words in (("on.onnx", ("--start", str(first))), ("new.onnx", ())):
        assert train_network(data, tmp_path / name, *words, epochs=1, rate=1e-4) == 0
    assert first_error(tmp_path / "on.onnx") < 0.7 * first_error(tmp_path / "new.onnx")


def test_a_copy_of_a_network_can_be_begun_with_like_the_network(data, first, tmp_path):
    copy_start(first, tmp_path / "copy.onnx")
    assert train_network(data, tmp_path / "out.onnx", "--start", str(tmp_path / "copy.onnx"), epochs=1) == 0


@pytest.mark.parametrize("fault", ["no folder", "other weights", "other size", "itself"])
def test_weights_that_are_not_those_of_the_file_are_refused_in_one_line(data, first, tmp_path, capsys, fault):
    start = tmp_path / "start.onnx"
    shutil.copyfile(first, start)
    out, words = tmp_path / "out.onnx", ["--start", str(start)]
    expected = {
        "no folder": "no checkpoint of the training of start.onnx",
        "other weights": "steers otherwise than the weights in",
        "other size": "another network or size",
        "itself": "is the network of --start itself",
    }[fault]
    if fault == "other weights":
        assert train_network(data, tmp_path / "other.onnx", "--set", "seed=7", epochs=1) == 0
        shutil.copytree(work_folder(tmp_path / "other.onnx"), work_folder(start))
    elif fault != "no folder":
        shutil.copytree(work_folder(first), work_folder(start))
    if fault == "other size":
        words += ["--set", "width_px=64"]
    capsys.readouterr()
    assert train_network(data, start if fault == "itself" else out, *words) == 2
    assert expected in capsys.readouterr().err and not out.exists()


def test_a_training_on_a_straight_drive_says_in_its_card_that_nothing_was_shown(tmp_path, capsys):
    flat = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", 360, gain=0.001))
    assert train_network(flat, tmp_path / "flat.onnx", epochs=1) == 0
    card = (tmp_path / "flat.md").read_text()
    assert "## What was learned" in card and "any constant angle fits them" in card
    assert "cannot show whether anything was learned" in card
    assert "cannot show whether anything was learned" in capsys.readouterr().out.splitlines()[-1]
