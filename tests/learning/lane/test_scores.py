"""Claims about scores and calibration, checked on made-up errors whose distribution is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learning.lane.scores import PursuitTask, auroc, calibrate, expected_calibration_error
from trepid.car.vehicle import road_wheel_angle
from trepid.clothoid import Lane

TOLERANCE_RAD = math.radians(2)


def draw_errors(count: int, seed: int, honesty: float) -> tuple[np.ndarray, np.ndarray]:
    """Predicted σ and errors that are ``honesty`` times as large as predicted."""
    rng = np.random.default_rng(seed)
    sigma = TOLERANCE_RAD * np.exp(rng.normal(0, 0.8, count))
    return sigma, honesty * sigma * rng.normal(size=count)


@pytest.mark.parametrize("honesty", [0.5, 1.0, 2.0])
def test_calibrated_confidence_is_the_share_of_good_estimates_for_any_scale_of_sigma(honesty):
    calibration = calibrate(*draw_errors(20_000, 1, honesty), tolerance_rad=TOLERANCE_RAD)
    sigma, error = draw_errors(20_000, 2, honesty)
    confidence = np.array([calibration.probability(s) for s in sigma])
    assert expected_calibration_error(confidence, np.abs(error) < TOLERANCE_RAD) < 0.05


def test_an_overconfident_network_is_miscalibrated_before_and_not_after():
    sigma, error = draw_errors(20_000, 3, 3.0)
    good = np.abs(error) < TOLERANCE_RAD
    nominal = np.array([math.erf(TOLERANCE_RAD / s / math.sqrt(2)) for s in sigma])
    calibration = calibrate(sigma, error, tolerance_rad=TOLERANCE_RAD)
    confidence = np.array([calibration.probability(s) for s in sigma])
    assert expected_calibration_error(nominal, good) > 0.2
    assert expected_calibration_error(confidence, good) < 0.05


def test_calibration_survives_estimates_that_are_all_good():
    sigma, _ = draw_errors(500, 4, 1.0)
    calibration = calibrate(sigma, np.zeros(500), tolerance_rad=TOLERANCE_RAD)
    assert calibration.probability(float(np.median(sigma))) > 0.99


def test_calibration_error_is_zero_for_an_oracle_and_one_for_its_opposite():
    happened = np.arange(100) % 2 == 0
    assert expected_calibration_error(happened.astype(float), happened) == 0
    assert expected_calibration_error(1.0 - happened, happened) == 1


def test_auroc_counts_the_pairs_in_the_right_order():
    rng = np.random.default_rng(0)
    score, positive = rng.integers(0, 6, 60).astype(float), rng.random(60) < 0.4
    pairs = score[positive][:, None] - score[~positive][None, :]
    assert auroc(score, positive) == pytest.approx(np.mean((pairs > 0) + 0.5 * (pairs == 0)))


@given(
    offset=st.floats(-1, 1),
    heading=st.floats(-0.2, 0.2),
    curvature=st.floats(-0.06, 0.06),
    ahead=st.floats(-0.06, 0.06),
)
def test_the_task_is_the_pure_pursuit_of_the_clothoid(offset, heading, curvature, ahead):
    reach, lookahead = 8.0, 10.0
    share = reach / (3 * lookahead)
    task = PursuitTask(1.75, np.array([-2 / reach**2, -2 / reach, 1 - share, share]))
    command = Lane(offset, heading, curvature, (ahead - curvature) / lookahead).pursuit_curvature(reach)
    angle = task.road_wheel_angle(np.array([[offset, heading, curvature, ahead]]))[0]
    assert angle == pytest.approx(road_wheel_angle(command, wheelbase_m=1.75), abs=1e-9)
