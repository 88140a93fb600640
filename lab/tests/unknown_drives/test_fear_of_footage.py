"""`trepid estimate --fear` with a log of the odometry of a drive whose camera is not known."""

import json

import cv2
import numpy as np
import pytest

from lab.bench.perception.unknown_camera import unknown_drive
from sim_harness.footage.estimate_cli import estimate

pytestmark = pytest.mark.long


def test_a_log_of_speed_and_yaw_rate_measures_an_unknown_camera(tmp_path, capsys):
    """Without odometry a lane seen from 1.64 m seems narrower than it is."""
    drive, seen = unknown_drive(7, 0), []
    true_m = drive.course.road.settings.lane_width_m
    assert drive.camera.height_m > 1.5
    rows = ["t_s,speed_mps,yaw_rate_radps"]
    for number, one in enumerate(drive.moments()):
        cv2.imwrite(str(tmp_path / f"{number}.bmp"), one.image)
        rows.append(f"{one.t_s},{one.speed_mps},{one.yaw_rate_radps}")
    log = tmp_path / "log.csv"
    log.write_text("\n".join(rows) + "\n")
    for options in ({"speeds": log, "speed": None}, {"speed": drive.course.speed_mps}):
        estimate([tmp_path], fear=True, as_json=True, drive=True, fps=20.0, camera=None, **options)
        found = [json.loads(line) for line in capsys.readouterr().out.splitlines()][-60:]
        widths = [one["estimates"][name]["lane_width_m"] for one in found for name in ("cv", "cnn")]
        seen.append(abs(np.median([width for width in widths if width is not None]) - true_m))
    measured, constant = seen
    assert measured < 0.2 and measured < constant
