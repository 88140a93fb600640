import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.camera_check import CameraCheck
from perception.lane.model.evidence import NO_SUPPORT, BoundarySupport, LaneFit
from perception.lane.model.geometry import KAPPA, PITCH, PSI, LaneState
from perception.lane.model.prediction import VehicleMotion

SETTINGS = lane_cv_settings().camera_check
SEEN = BoundarySupport(excess=1.0, extent_m=20.0, seen=True)
DT_S, SPEED_MPS = 0.04, 8.0


def detected_fit(
    *, curvature_1pm: float = 0.0, pitch_rad: float = 0.0, heading_rad: float = 0.0, right=SEEN
) -> LaneFit:
    mean = np.zeros(6)
    mean[[KAPPA, PITCH, PSI]] = curvature_1pm, pitch_rad, heading_rad
    return LaneFit(state=LaneState(mean, np.eye(6)), left=SEEN, right=right, residual=1.0)


def drive_bend(
    check: CameraCheck, seconds: float, *, curvature_1pm: float, measured_1pm: float, pitch_rad: float = 0.0
) -> None:
    """Drive a bend that is measured with ``measured_1pm``, swaying a little in the lane."""
    before = 0.0
    for number in range(round(seconds / DT_S)):
        heading = 0.02 * np.sin(number / 10)
        rate = SPEED_MPS * curvature_1pm + (heading - before) / DT_S
        before = heading
        fit = detected_fit(curvature_1pm=measured_1pm, pitch_rad=pitch_rad, heading_rad=heading)
        check.step(fit, VehicleMotion(SPEED_MPS, rate), dt_s=DT_S)


def test_without_frames_no_error_is_known():
    check = CameraCheck(SETTINGS)
    assert check.error.pitch_rad is check.error.height_ratio is None and check.reason == ""


@pytest.mark.parametrize("pitch_rad", [0.014, -0.014])
def test_a_pitch_error_of_a_tenth_is_reported_on_a_straight(pitch_rad):
    check = CameraCheck(SETTINGS)
    drive_bend(check, 6.0, curvature_1pm=0.0, measured_1pm=0.0, pitch_rad=pitch_rad)
    assert check.error.pitch_rad == pytest.approx(pitch_rad)
    assert ("down" if pitch_rad > 0 else "up") in check.reason


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("ratio", "word"), [(1.1, "lower"), (0.9, "higher"), (1.0, "")])
def test_a_height_error_of_a_tenth_is_reported_after_bends(side, ratio, word):
    check = CameraCheck(SETTINGS)
    drive_bend(check, 40.0, curvature_1pm=side * 0.03, measured_1pm=side * 0.03 / ratio)
    assert check.error.height_ratio == pytest.approx(ratio, abs=0.01)
    assert word in check.reason and (word != "" or check.reason == "")


@pytest.mark.parametrize(
    ("gap", "dt_s"), [(detected_fit(right=NO_SUPPORT), DT_S), (detected_fit(), 0.3), (detected_fit(), 0.0)]
)
def test_a_heading_from_before_a_gap_measures_no_turn(gap, dt_s):
    check = CameraCheck(SETTINGS)
    drive_bend(check, 40.0, curvature_1pm=0.03, measured_1pm=0.03)
    ratio = check.error.height_ratio
    check.step(gap, VehicleMotion(SPEED_MPS, 0.24), dt_s=dt_s)
    check.step(detected_fit(curvature_1pm=0.03, heading_rad=0.5), VehicleMotion(SPEED_MPS, 0.24), dt_s=DT_S)
    assert check.error.height_ratio == ratio
