"""The peak memory of a process is its own, and grows by what it loads."""

from pathlib import Path

import numpy as np
import pytest

from lab.bench.perception import memory
from lab.bench.perception.memory import FEAR, IMAGES, SHAPE, YAW_RATES, moments, peak_mib, peak_of
from trepid.config import InputError

MIB = 1024**2
RUNTIME_MIB = 20.0  # of ONNX Runtime and a network, at least


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """A folder with three frames."""
    images = np.random.default_rng(0).integers(0, 255, (3, *SHAPE), np.uint8)
    (tmp_path / IMAGES).write_bytes(images.tobytes())
    np.save(tmp_path / YAW_RATES, np.array([0.1, 0.2, 0.3]))
    return tmp_path


def test_frames_come_back_as_they_were_written(frames: Path):
    stored = np.fromfile(frames / IMAGES, np.uint8).reshape(-1, *SHAPE)
    found = list(moments(frames))
    assert all((frame.image == image).all() for (frame, _), image in zip(found, stored, strict=True))
    assert [state.yaw_rate_radps for _, state in found] == [0.1, 0.2, 0.3]
    assert all(frame.t_s == state.t_s for frame, state in found)


def test_a_process_has_its_own_peak_and_not_that_of_the_larger_one_that_began_it(frames: Path):
    held = np.ones(256 * MIB, np.uint8)
    alone = peak_of(frames, ())
    assert held.nbytes / MIB < peak_mib() and alone < peak_mib() - 100.0
    assert peak_of(frames, ("cnn", FEAR)) > alone + RUNTIME_MIB


def test_an_estimator_that_is_not_there_is_named_in_one_line(frames: Path):
    with pytest.raises(InputError, match="none_such"):
        peak_of(frames, ("none_such",))


def test_every_row_stands_beside_the_frames_alone(monkeypatch):
    monkeypatch.setattr(memory, "write_lap", lambda folder: None)
    monkeypatch.setattr(memory, "peak_of", lambda folder, names: 50.0 + 10.0 * len(names))
    found = memory.bench_memory(estimators=("nets/own.onnx",))["peak memory of one process"]
    assert set(found) == {*memory.ROWS, "own.onnx"}
    assert found["cv, cnn under fear"] == {"peak [MiB]": 80.0, "above the frames alone [MiB]": 30.0}
    assert found[memory.ALONE]["above the frames alone [MiB]"] == 0.0
