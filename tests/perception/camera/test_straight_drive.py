"""Pitch, yaw and height of a camera are found again from drawn drives along a straight road."""

import math

import numpy as np
import pytest
from straight_drive_rig import KNOWN, LANE_M, TRUE, clip

from perception.camera.height import Step
from perception.camera.straight_drive import mounting
from sim_harness.world.roads.drawn import Kind
from trepid.config import InputError


def test_pitch_yaw_and_height_are_found_from_the_speed() -> None:
    found = mounting(clip(Kind.WHITE), KNOWN)
    assert found.height_from == "the speed"
    assert found.pitch_down_rad == pytest.approx(TRUE.pitch_down_rad, abs=math.radians(0.25))
    assert found.yaw_rad == pytest.approx(TRUE.yaw_rad, abs=math.radians(0.4))
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_the_width_of_the_lane_tells_the_height_as_well() -> None:
    found = mounting([Step(step.image) for step in clip(Kind.YELLOW)], KNOWN, lane_width_m=LANE_M)
    assert found.height_from == "the width of the lane"
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_without_a_known_length_the_height_stays() -> None:
    found = mounting([Step(step.image) for step in clip(Kind.WHITE)], KNOWN)
    assert (found.height_m, found.height_from) == (KNOWN.height_m, "the camera file")


def test_lens_distortion_is_taken_out_first() -> None:
    bent = KNOWN.model_copy(update={"distortion": (-0.2, 0.05, 0.0, 0.0, 0.0)})
    straight = [Step(step.image) for step in clip(Kind.WHITE)]
    plain, undistorted = mounting(straight, KNOWN), mounting(straight, bent)
    assert abs(plain.pitch_down_rad - undistorted.pitch_down_rad) > math.radians(0.3)


def test_a_bend_is_refused() -> None:
    with pytest.raises(InputError, match="the road is not straight: it turns by"):
        mounting(clip(Kind.WHITE, curvature_1pm=0.01, sway_m=0.0), KNOWN)


def test_swerving_is_refused() -> None:
    with pytest.raises(InputError, match="the vehicle does not drive straight: the heading sways by"):
        mounting(clip(Kind.WHITE, sway_m=0.3), KNOWN)


def test_gravel_without_lines_is_refused() -> None:
    with pytest.raises(InputError, match="of the lines in the image meet in one point"):
        mounting(clip(Kind.GRAVEL), KNOWN)


@pytest.mark.parametrize("grey", [0, 128])
def test_pictures_without_a_road_are_refused(grey: int) -> None:
    with pytest.raises(InputError, match="lines along the road in 0 of 8 frames, 5 expected"):
        mounting([Step(np.full((240, 320, 3), grey, np.uint8))] * 8, KNOWN)
