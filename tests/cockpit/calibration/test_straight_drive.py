"""Mounting of a camera from drawn drives along a straight road."""

import math

import cv2
import numpy as np
import pytest
from straight_drive_rig import KNOWN, LANE_M, TRUE, clip

from cockpit.calibration.height import Step
from cockpit.calibration.straight_drive import mounting
from trepid.car.camera import Camera
from trepid.config import InputError


def test_pitch_yaw_and_height_are_measured_with_the_speed() -> None:
    found = mounting(clip("white"), KNOWN)
    assert found.height_from == "the speed"
    assert found.pitch_down_rad == pytest.approx(TRUE.pitch_down_rad, abs=math.radians(0.25))
    assert found.yaw_rad == pytest.approx(TRUE.yaw_rad, abs=math.radians(0.4))
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_the_height_is_measured_with_the_width_of_the_lane() -> None:
    found = mounting([Step(step.image) for step in clip("yellow")], KNOWN, lane_width_m=LANE_M)
    assert found.height_from == "the width of the lane"
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_without_a_known_length_the_height_is_that_of_the_file() -> None:
    found = mounting([Step(step.image) for step in clip("white")], KNOWN)
    assert (found.height_m, found.height_from) == (KNOWN.height_m, "the camera file")


def through_lens(image: np.ndarray, lens: Camera) -> np.ndarray:
    """An undistorted image as ``lens`` takes it."""
    columns, rows = np.meshgrid(np.arange(lens.width_px), np.arange(lens.height_px))
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
    intrinsics = lens.intrinsics
    source = cv2.undistortPoints(pixels[:, None], intrinsics, np.array(lens.distortion), P=intrinsics)
    maps = source.reshape(lens.height_px, lens.width_px, 2).astype(np.float32)
    return cv2.remap(image, maps, None, cv2.INTER_LINEAR)


def test_lens_distortion_is_corrected() -> None:
    lens = KNOWN.model_copy(update={"distortion": (-0.2, 0.05, 0.0, 0.0, 0.0)})
    steps = [Step(through_lens(step.image, lens)) for step in clip("white")]
    error, uncorrected = (
        abs(mounting(steps, camera).pitch_down_rad - TRUE.pitch_down_rad) for camera in (lens, KNOWN)
    )
    assert error < math.radians(0.15) < uncorrected


def test_a_bend_is_refused() -> None:
    with pytest.raises(InputError, match="the road is not straight: it turns by"):
        mounting(clip("white", curvature_1pm=0.01, sway_m=0.0), KNOWN)


@pytest.mark.parametrize(("sway_m", "frames", "degrees"), [(0.2, 24, 1.2), (0.25, 24, 1.6), (0.3, 10, 2.0)])
def test_swerving_is_refused_with_the_sway_of_all_frames(sway_m: float, frames: int, degrees: float) -> None:
    with pytest.raises(InputError, match=rf"does not drive straight: the heading sways by {degrees}°"):
        mounting(clip("yellow", sway_m=sway_m, frames=frames), KNOWN)


def test_gravel_without_lines_is_refused() -> None:
    with pytest.raises(InputError, match="of the lines in the image meet in one point"):
        mounting(clip("gravel"), KNOWN)


@pytest.mark.parametrize("grey", [0, 128])
def test_images_without_a_road_are_refused(grey: int) -> None:
    with pytest.raises(InputError, match="lines along the road in 0 of 8 frames, 5 expected"):
        mounting([Step(np.full((240, 320, 3), grey, np.uint8))] * 8, KNOWN)
