import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.camera_check import CameraCheck
from perception.lane.fit import KAPPA, PITCH, PSI, LaneState

SETTINGS = lane_cv_settings().camera_check
DT_S, SPEED_MPS = 0.04, 8.0


def lane(*, curvature_1pm: float = 0.0, pitch_rad: float = 0.0, heading_rad: float = 0.0) -> LaneState:
    mean = np.zeros(6)
    mean[[KAPPA, PITCH, PSI]] = curvature_1pm, pitch_rad, heading_rad
    return LaneState(mean=mean, covariance=np.eye(6))


def driven(
    check: CameraCheck, seconds: float, *, curvature_1pm: float, seen_1pm: float, pitch_rad: float = 0.0
) -> None:
    """Drive a bend that is seen with ``seen_1pm``, swaying a little in the lane."""
    before = 0.0
    for number in range(round(seconds / DT_S)):
        heading = 0.02 * np.sin(number / 10)
        rate = SPEED_MPS * curvature_1pm + (heading - before) / DT_S
        before = heading
        check.step(
            lane(curvature_1pm=seen_1pm, pitch_rad=pitch_rad, heading_rad=heading),
            speed_mps=SPEED_MPS,
            yaw_rate_radps=rate,
            dt_s=DT_S,
        )


def test_nothing_is_said_before_anything_has_shown():
    check = CameraCheck(SETTINGS)
    assert check.doubt.pitch_error_rad is check.doubt.height_ratio is None and check.reason == ""


@pytest.mark.parametrize("pitch_rad", [0.014, -0.014])
def test_a_pitch_that_is_wrong_by_a_tenth_is_said_on_the_straight(pitch_rad):
    check = CameraCheck(SETTINGS)
    driven(check, 6.0, curvature_1pm=0.0, seen_1pm=0.0, pitch_rad=pitch_rad)
    assert check.doubt.pitch_error_rad == pytest.approx(pitch_rad)
    assert ("down" if pitch_rad > 0 else "up") in check.reason


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("ratio", "word"), [(1.1, "lower"), (0.9, "higher"), (1.0, "")])
def test_a_height_that_is_wrong_by_a_tenth_shows_in_bends(side, ratio, word):
    check = CameraCheck(SETTINGS)
    driven(check, 40.0, curvature_1pm=side * 0.03, seen_1pm=side * 0.03 / ratio)
    assert check.doubt.height_ratio == pytest.approx(ratio, abs=0.01)
    assert word in check.reason and (word != "" or check.reason == "")


def test_a_frame_without_lines_leaves_no_turn_behind():
    check = CameraCheck(SETTINGS)
    driven(check, 40.0, curvature_1pm=0.03, seen_1pm=0.03)
    ratio = check.doubt.height_ratio
    check.pause()
    check.step(lane(curvature_1pm=0.03, heading_rad=0.5), speed_mps=SPEED_MPS, yaw_rate_radps=0.24, dt_s=DT_S)
    assert check.doubt.height_ratio == ratio
