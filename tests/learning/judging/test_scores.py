"""Scores of angles, compared with closed forms and with SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from learning.judging.baselines import previous
from learning.judging.scores import (
    bin_edges_deg,
    by_size,
    errors,
    groups,
    rate_rms_degps,
    straight_bias_deg,
)

ANGLES = st.lists(st.floats(-30, 30), min_size=3, max_size=40)


def noisy(seed: int, n: int = 500) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    true = random.normal(1.0, 5.0, n)
    return 0.8 * true + random.normal(0.3, 1.0, n), true


def test_errors_agree_with_numpy_and_scipy():
    predicted, true = noisy(0)
    found, line = errors(predicted, true), stats.linregress(true, predicted)
    assert found["mae_deg"] == pytest.approx(np.mean(np.abs(predicted - true)))
    assert found["rmse_deg"] == pytest.approx(math.sqrt(np.mean((predicted - true) ** 2)))
    assert found["rmse_deg"] ** 2 == pytest.approx(found["mean_error_deg"] ** 2 + found["std_deg"] ** 2)
    assert found["slope"] == pytest.approx(line.slope)
    assert found["r2"] == pytest.approx(1 - np.var(predicted - true) / np.var(true), abs=0.01)


def test_r2_of_the_least_squares_line_is_the_squared_correlation():
    predicted, true = noisy(1)
    line = stats.linregress(predicted, true)
    assert errors(line.intercept + line.slope * predicted, true)["r2"] == pytest.approx(line.rvalue**2)


@given(true=ANGLES)
def test_a_perfect_prediction_has_no_error_and_the_mean_has_r2_zero(true):
    angles = np.array(true)
    perfect, mean = errors(angles, angles), errors(np.full(len(angles), angles.mean()), angles)
    assert perfect["mae_deg"] == perfect["mean_error_deg"] == 0.0
    if np.ptp(angles) > 1e-3:
        assert perfect["r2"] == 1.0 and perfect["slope"] == pytest.approx(1.0)
        assert mean["r2"] == pytest.approx(0.0, abs=1e-9)


def test_a_constant_record_has_neither_r2_nor_slope_and_no_frame_has_no_scores():
    found = errors(np.array([1.0, 2.0]), np.array([3.0, 3.0]))
    assert found["r2"] is None and found["slope"] is None and found["mae_deg"] == 1.5
    assert errors(np.array([]), np.array([]))["mae_deg"] is None


def test_bins_of_the_steering_wheel_hold_every_frame_once():
    predicted, true = noisy(2)
    bins = by_size(predicted, true, bin_edges_deg(true, 16.0), 16.0)
    assert sum(one["frames"] for one in bins) == len(true)
    weighted = sum(one["frames"] * one["mae_deg"] for one in bins) / len(true)
    assert weighted == pytest.approx(errors(predicted, true)["mae_deg"])
    assert all(one["to_deg"] - one["from_deg"] == 10.0 for one in bins)


def test_bends_predicted_too_weak_are_weak_on_both_sides():
    true = np.array([-10.0, 10.0, -1.0])
    (gentle, sharp) = by_size(0.5 * true, true, (0.0, 40.0, math.inf), 16.0)
    assert (gentle["frames"], sharp["frames"], sharp["to_deg"]) == (1, 2, None)
    assert sharp["weak_deg"] == 5.0 and gentle["weak_deg"] == 0.5


def test_the_bias_ahead_is_that_of_straight_frames_only():
    true = np.array([0.0, 0.2, 9.0])
    assert straight_bias_deg(np.array([1.0, 3.2, 99.0]), true, 16.0) == pytest.approx(2.0)
    assert straight_bias_deg(true, true + 9.0, 16.0) is None


def test_the_steering_rate_is_that_of_a_sine_and_stops_at_gaps():
    t_s = np.arange(0, 20, 0.01)
    angle = 3.0 * np.sin(2 * t_s)
    one = np.zeros(len(t_s), int)
    assert rate_rms_degps(angle, t_s, one) == pytest.approx(3 * 2 / math.sqrt(2), rel=0.02)
    jump = np.where(t_s < 10, angle, angle + 50)
    assert rate_rms_degps(jump, t_s, (t_s >= 10).astype(int)) == pytest.approx(4.24, rel=0.02)
    assert rate_rms_degps(angle[:2], np.array([0.0, 5.0]), one[:2]) is None


def test_groups_are_scored_apart():
    predicted, true = noisy(3, 10)
    names = np.array(["a"] * 4 + ["b"] * 6)
    found = groups(predicted, true, names)
    assert found["a"] == errors(predicted[:4], true[:4]) and found["b"]["frames"] == 6


def test_the_angle_of_a_moment_ago_is_at_least_so_old_and_of_the_same_stretch():
    t_s = np.array([0.0, 0.1, 0.2, 0.35, 10.0, 10.2])
    stretch = np.array([0, 0, 0, 0, 1, 1])
    angles = np.arange(6.0)
    assert previous(angles, t_s, stretch) == pytest.approx([np.nan, np.nan, 0, 1, np.nan, 4], nan_ok=True)
