"""A training that is killed with -9 at any moment, its start and its export too, ends as an undisturbed one."""

import json
import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")
onnx = pytest.importorskip("onnx")

from drive_rig import made_dataset, write_tub  # noqa: E402

from learning.dataset.dataset import Dataset  # noqa: E402

pytestmark = pytest.mark.proof
KILLS = 20
SETTINGS = (
    *("--set", "height_px=24", "--set", "width_px=32", "--set", "batch=32", "--set", "checkpoint_s=0.2"),
    "--set",
    "stages=[{name: all, part: all, epochs: 6, learning_rate: 1.0e-3, schedule: cosine, patience: 6}]",
)


def start_training(data: Dataset, out: Path, *words: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-W", "ignore", "-m", "trepid", "train", "--data", str(data.folder)]
    command += ["--model", "steer", "--out", str(out), *SETTINGS, *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def result(out: Path) -> tuple[dict[str, bytes], list[tuple[int, float]]]:
    """The weights by name, and the validation error of every epoch."""
    weights = {
        one.name: onnx.numpy_helper.to_array(one).tobytes() for one in onnx.load(out).graph.initializer
    }
    lines = out.with_name(f"{out.name}.train").joinpath("curve.jsonl").read_text().splitlines()
    points = map(json.loads, lines)
    return weights, [(point["epoch"], point["validation_mae_rad"]) for point in points]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_training_killed_at_20_random_moments_gives_the_weights_of_an_undisturbed_one(tmp_path):
    data = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", 360))
    began_s = time.monotonic()
    whole = start_training(data, tmp_path / "whole.onnx")
    assert whole.wait(timeout=300) == 0, whole.stderr.read().decode()
    lasted_s = time.monotonic() - began_s
    expected = result(tmp_path / "whole.onnx")
    assert np.isfinite([error for _, error in expected[1]]).all() and len(expected[1]) == 6
    moments, killed = random.Random(20), 0
    for number in range(KILLS):
        out = tmp_path / f"{number}" / "killed.onnx"
        out.parent.mkdir()
        training = start_training(data, out)
        try:
            training.wait(timeout=moments.uniform(0.0, lasted_s))
        except subprocess.TimeoutExpired:
            training.kill()
            training.wait()
            killed += 1
        resumed = start_training(data, out, "--resume")
        assert resumed.wait(timeout=300) == 0, resumed.stderr.read().decode()
        assert result(out) == expected, f"kill {number}"
    assert killed >= KILLS / 4  # the time of a training varies with the load
