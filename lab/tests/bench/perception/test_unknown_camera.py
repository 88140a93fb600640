import csv
import math

import cv2
import numpy as np
import pytest

from lab.bench.perception import unknown_camera
from lab.bench.perception.unknown_camera import BeliefError, WatchedDrive, unknown_drive
from perception.camera.odometry import StateOdometry
from trepid.recording.csv_file import MPS_PER_MPH

SEED = 3


def belief(height: float, sigma: float = 0.04) -> BeliefError:
    return BeliefError(height=height, height_sigma=sigma, focal=-0.02, horizon_rad=0.001, yaw_rad=-0.002)


def test_the_same_seed_drives_the_same_drive():
    one, other = (next(iter(unknown_drive(SEED, 1).moments())) for _ in range(2))
    assert np.array_equal(one.image, other.image) and one.speed_mps == other.speed_mps


def test_the_measured_odometry_is_that_of_the_drive_with_small_errors():
    drive = unknown_drive(SEED, 4)
    moments = [one for number, one in enumerate(drive.moments()) if number % 20 == 0]
    speeds = [one.speed_mps / drive.course.speed_along_mps(one.t_s) for one in moments]
    rates = [one.yaw_rate_radps - drive.course.yaw_rate_radps(one.t_s) for one in moments]
    assert np.ptp(speeds) < 1e-9 and abs(speeds[0] - 1) < 0.04
    assert max(map(abs, rates)) < 0.03


def test_the_scores_are_shares_and_medians_over_the_drives():
    drives = [
        WatchedDrive(StateOdometry.WAY, (belief(0.2), belief(0.03), belief(0.01)), 0.8, 0.1),
        WatchedDrive(StateOdometry.WAY, (belief(0.2), belief(0.1), belief(-0.09)), 0.6, -0.3),
    ]
    scores = unknown_camera._scores(drives)
    assert scores["height_within_5_percent_after_2_s_percent"] == 0.0
    assert scores["height_within_5_percent_after_5_s_percent"] == 50.0
    assert scores["height_within_2_sigma_percent"] == 50.0
    assert scores["height_error_percent"] == pytest.approx(5.0)
    assert scores["lane_width_error_m"] == pytest.approx(0.2) and scores["confidence"] == pytest.approx(0.7)
    assert scores["horizon_error_deg"] == pytest.approx(math.degrees(0.001))


@pytest.mark.long
def test_a_drive_knows_its_camera_with_odometry_better_than_by_its_images_alone(monkeypatch):
    monkeypatch.setattr(unknown_camera, "StateOdometry", (StateOdometry.NONE, StateOdometry.WAY_AND_TURN))
    by_odometry = {one.odometry: one for one in unknown_camera.watch((SEED, 0))}
    known, images = by_odometry[StateOdometry.WAY_AND_TURN].seen[-1], by_odometry[StateOdometry.NONE].seen[-1]
    assert abs(known.height) < 0.05 and abs(known.focal) < 0.05
    assert known.height_sigma < 0.6 * images.height_sigma


@pytest.mark.long
def test_the_height_of_a_foreign_camera_is_measured_by_stretch(tmp_path, monkeypatch):
    """A set of the same layout, with frames of a rendered drive through a lens of 60° and the true speed."""
    monkeypatch.setattr(unknown_camera, "STRETCH", 60)
    monkeypatch.setattr(unknown_camera, "SPEED_ERROR", 0.0)
    monkeypatch.setattr(unknown_camera, "random_camera", lens_of_60_degrees)
    drive = unknown_drive(SEED, 0)
    (tmp_path / "IMG").mkdir()
    with (tmp_path / "driving_log.csv").open("w", newline="") as file:
        for number, one in enumerate(drive.moments()):
            if number >= 120:
                break
            name = f"center_2018_07_16_17_11_{number // 20:02}_{50 * (number % 20):03}.jpg"
            cv2.imwrite(str(tmp_path / "IMG" / name), one.image)
            csv.writer(file).writerow([f"IMG/{name}", "", "", 0, 0, 0, one.speed_mps / MPS_PER_MPH])
    found = unknown_camera.foreign_heights(tmp_path)
    assert found["stretches"] == 2
    assert found["median_height_m"] == pytest.approx(drive.camera.height_m, rel=0.06)


original = unknown_camera.random_camera


def lens_of_60_degrees(rng):
    camera = original(rng)
    focal_px = camera.height_px / 2 / math.tan(math.pi / 6)
    return camera.model_copy(update={"fx_px": focal_px, "fy_px": focal_px})
