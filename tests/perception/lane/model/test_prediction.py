import math

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.model.geometry import KAPPA, KAPPA_RATE, PSI, E, LaneState
from perception.lane.model.prediction import (
    VehicleMotion,
    grade_variance_m2,
    predict,
    steady,
    unseen_variance_m2,
)
from supervisor.supervisor import SupervisorSettings
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, load
from trepid.messages import SIGMA_AHEAD_M, VehicleState

SETTINGS = lane_cv_settings()


def lane(offset_m=0.0, heading_rad=0.0, curvature_1pm=0.0) -> LaneState:
    mean = np.array([offset_m, heading_rad, curvature_1pm, 0.0, 3.5, 0.0])
    return LaneState(mean=mean, covariance=np.eye(6) * 1e-4)


def predict_lane(state: LaneState, speed_mps=None, yaw_rate_radps=None) -> LaneState:
    motion = VehicleMotion(speed_mps, yaw_rate_radps)
    return predict(state, 0.1, motion, track=SETTINGS.track, prior=SETTINGS.prior)


def test_driving_along_an_arc_with_its_yaw_rate_keeps_offset_and_heading():
    after = predict_lane(lane(0.2, 0.0, 0.05), 10.0, 0.5)
    assert after.mean[[E, PSI, KAPPA]] == pytest.approx([0.2, 0.0, 0.05])


def test_driving_straight_with_a_heading_error_to_the_left_moves_left():
    assert predict_lane(lane(heading_rad=0.1), 10.0, 0.0).mean[E] == pytest.approx(math.sin(0.1), abs=1e-6)


@pytest.mark.parametrize("motion", [(10.0, 0.0), (10.0, None), (None, None)])
def test_the_covariance_grows_without_a_detection(motion):
    before = lane()
    after = predict_lane(before, *motion)
    assert (np.diag(after.covariance)[:3] > np.diag(before.covariance)[:3]).all()


def test_a_steady_lane_keeps_its_bend_and_has_no_rate_of_it():
    bent = LaneState(mean=np.array([0.0, 0.0, 0.02, 0.001, 3.5, 0.0]), covariance=np.eye(6))
    assert steady(bent).mean[[KAPPA, KAPPA_RATE]].tolist() == [0.02, 0.0]


@pytest.mark.parametrize("value", [math.nan, math.inf, None])
def test_a_motion_that_is_not_finite_is_not_known(value):
    state = VehicleState(
        t_s=0.0, speed_mps=value, road_wheel_angle_rad=0.0, yaw_rate_radps=value, driver_override=False
    )
    assert VehicleMotion.of(state) == VehicleMotion.of(None) == VehicleMotion(None, None)


@pytest.mark.parametrize("beyond_m", [2.0, 10.0, 25.0])
def test_beyond_the_last_pixel_the_variance_is_that_of_a_road_whose_curvature_rate_walks_randomly(beyond_m):
    # Steps of y, y', κ and κ' with noise of κ' alone, as an integrator chain of its own.
    step_m = beyond_m / 400
    powers = [step_m**k / math.factorial(k) for k in range(4)]
    walk = np.array([[0.0] * row + powers[: 4 - row] for row in range(4)])
    covariance, noise = np.zeros((4, 4)), np.zeros((4, 4))
    noise[3, 3] = SETTINGS.track.curvature_rate_noise_1pm2_per_sqrt_m**2 * step_m
    for _ in range(400):
        covariance = walk @ covariance @ walk.T + noise
    found = unseen_variance_m2(np.array([12.0, 12.0 + beyond_m]), 12.0, SETTINGS.track)
    assert found == pytest.approx([0.0, covariance[0, 0]], rel=0.02)


@pytest.mark.parametrize("bend_1pm", [-0.01, 0.0, 0.004])
@pytest.mark.parametrize("offset_m", [-0.8, 0.5])
def test_a_lane_on_rising_ground_appears_off_by_the_deviation_for_an_unknown_grade(bend_1pm, offset_m):
    camera, lane_of_flat = load(CONFIG_DIR / "camera.yaml", Camera), Lane(offset_m, 0.03, bend_1pm, 1e-4)
    rising_1pm = SETTINGS.track.vertical_curvature_1pm / 100
    # Rays from the lens through points of the lane on the risen ground meet the flat ground farther away.
    x_m = np.linspace(camera.x_m, 35.0, 4000)
    y_m = np.array([lane_of_flat.y_m(at_m) for at_m in x_m])
    up_m = rising_1pm * (x_m - camera.x_m) ** 2 / 2
    farther = camera.height_m / (camera.height_m - up_m)
    seen_x_m = camera.x_m + (x_m - camera.x_m) * farther
    seen_y_m = camera.y_m + (y_m - camera.y_m) * farther
    ahead_m = np.array([10.0, 20.0])
    off_m = np.interp(ahead_m, seen_x_m, seen_y_m) - np.interp(ahead_m, x_m, y_m)
    found_m = np.sqrt(grade_variance_m2(ahead_m, lane_of_flat, camera, SETTINGS.track))
    assert 100 * np.abs(off_m) == pytest.approx(found_m, rel=0.03)


def test_a_straight_lane_under_the_lens_is_where_it_seems_on_every_hill():
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    middle = Lane(-camera.y_m, 0.0, 0.0, 0.0)
    assert grade_variance_m2(np.array([5.0, 40.0]), middle, camera, SETTINGS.track) == pytest.approx(0.0)


@pytest.mark.parametrize("bend_1pm", [-0.5, 0.5])
def test_the_deviation_for_an_unknown_grade_stays_possible_in_the_tightest_bend(bend_1pm):
    camera, limits = (
        load(CONFIG_DIR / "camera.yaml", Camera),
        load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings),
    )
    lane_of_flat = Lane(0.3, 0.5, bend_1pm, 0.05)
    variance_m2 = grade_variance_m2(np.array(SIGMA_AHEAD_M), lane_of_flat, camera, SETTINGS.track)
    assert np.sqrt(variance_m2).max() < limits.validation.max_sigma_m / 5
