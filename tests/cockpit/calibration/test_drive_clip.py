"""Frames of a clip with the distance driven to the next one."""

from pathlib import Path

import numpy as np
import pytest
from video_rig import matroska

from cockpit.calibration.drive_clip import steps_of


def test_the_distance_between_two_frames_of_a_video_is_that_of_their_stamps(tmp_path: Path) -> None:
    times_ms = [0, 40, 80, 280, 480, 1480]
    images = [np.full((48, 64, 3), 40 * n, np.uint8) for n in range(6)]
    steps = steps_of(matroska(tmp_path / "a.mkv", images, times_ms, duration_ms=60_000.0), speed_mps=10.0)
    ways_m = [step.way_m for step in steps]
    assert ways_m == pytest.approx([0.4, 0.4, 2.0, 2.0, 10.0])
    assert [round(float(step.image.mean()) / 40) for step in steps] == list(range(5))
