"""Driving networks with 8 bits, beside the same networks with 32."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import made_dataset, run, write_tub

from learning.dataset.dataset import Dataset
from learning.training import quantise as module
from learning.training.quantise import Comparison
from perception.net.driver import DriverNetwork

pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of the ONNX export in torch
]
SMALL = ("height_px=24", "width_px=32")


@pytest.fixture(scope="module")
def large(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network with 32 bits."""
    return train_network(data, tmp_path_factory.mktemp("weights") / "large.onnx", "steer")


@pytest.fixture(scope="module")
def small(data: Dataset, large: Path) -> Path:
    """The same with 8 bits."""
    out = large.with_name("small.onnx")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LEAST_GAIN", 0.0)  # how fast this machine is does not decide
        patch.setattr(module, "MOST_ERROR", 10.0)
        assert run_quantise(large, data, out) == 0
    return out


def train_network(data: Dataset, out: Path, model: str, *, epochs: int = 3) -> Path:
    fields = f"epochs: {epochs}, learning_rate: 3.0e-3, schedule: cosine, patience: 3"
    stages = f"stages=[{{name: all, part: all, {fields}}}]"
    words = [word for text in (stages, *SMALL) for word in ("--set", text)]
    assert run("train", "--data", str(data.folder), "--model", model, "--out", str(out), *words) == 0
    return out


def run_quantise(network: Path, data: Dataset, out: Path) -> int:
    return run("quantise", str(network), "--data", str(data.folder), "--out", str(out))


def test_the_angles_of_8_bits_are_those_of_32_to_a_tenth_of_their_spread_in_a_smaller_file(
    data, large, small
):
    networks = DriverNetwork(large), DriverNetwork(small)
    rows = data.rows("test")[::5]
    angles = np.array(
        [[network(data.image(row), None).road_wheel_rad for network in networks] for row in rows]
    )
    assert np.abs(angles[:, 1] - angles[:, 0]).max() < 0.1 * angles[:, 0].std()
    assert small.stat().st_size < 0.5 * large.stat().st_size


def test_with_8_bits_noise_is_unlike_and_frames_of_the_drive_are_not(data, small):
    network = DriverNetwork(small)
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    known = [network(data.image(row), None).unlike for row in data.rows("validation")]
    assert np.median(known) <= 1.0
    assert network(noise, None).unlike > 2.0 * max(1.0, *known)


def test_the_interval_with_8_bits_covers_ninety_percent_of_the_validation_frames(data, small):
    network = DriverNetwork(small)
    rows = data.rows("validation")
    found = [network(data.image(row), None) for row in rows]
    errors = np.abs([one.road_wheel_rad for one in found] - rows["road_wheel_rad"])
    inside = errors <= network.record.interval_90 * np.array([one.scale_rad for one in found])
    assert inside.mean() >= 0.89


def test_a_network_with_8_bits_of_another_data_set_or_with_a_memory_is_refused(
    data, large, small, tmp_path, capfd
):
    out = tmp_path / "out.onnx"
    assert run_quantise(small, data, out) == 2
    assert "has 8 bits already" in capfd.readouterr().err
    other = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", 300))
    assert run_quantise(large, other, out) == 2
    assert "was trained on a data set with sha256" in capfd.readouterr().err
    recurrent = train_network(data, tmp_path / "recurrent.onnx", "cnn-lstm", epochs=1)
    capfd.readouterr()
    assert run_quantise(recurrent, data, out) == 2
    assert "has a memory" in capfd.readouterr().err
    assert not out.exists()


def test_where_8_bits_do_not_pay_nothing_is_written_and_the_exit_code_is_1(
    data, large, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(module, "LEAST_GAIN", 1e9)
    out = tmp_path / "out.onnx"
    assert run("quantise", str(large), "--data", str(data.folder), "--out", str(out), "--json") == 1
    row = json.loads(capfd.readouterr().out)
    assert row["written"] is False and row["file_bytes"][1] < row["file_bytes"][0]
    assert not out.exists()


def test_an_output_that_cannot_be_written_is_refused_in_one_line(data, large, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(module, "LEAST_GAIN", 0.0)
    monkeypatch.setattr(module, "MOST_ERROR", 10.0)
    out = tmp_path / "folder.onnx"
    out.mkdir()
    capfd.readouterr()
    assert run_quantise(large, data, out) == 2
    assert "cannot be written" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("frame_ms", "mae_deg", "pays"),
    [
        ((1.3, 1.0), (2.0, 2.0), True),
        ((1.1, 1.0), (2.0, 2.0), False),  # hardly faster
        ((1.3, 1.0), (2.0, 2.1), False),  # less exact
    ],
)
def test_8_bits_pay_where_they_are_faster_and_as_exact(frame_ms, mae_deg, pays):
    assert Comparison(mae_deg, frame_ms, (2, 1), 0.1).pays is pays
