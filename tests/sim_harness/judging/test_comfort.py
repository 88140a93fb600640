"""Jerk and steering reversals against closed forms."""

import math

import numpy as np
import pytest

from sim_harness.judging.comfort import (
    count_reversals,
    max_lateral_jerk_mps3,
    max_r79_jerk_mps3,
    steering_reversals_per_min,
)
from sim_harness.judging.trace import Trace

T_S = np.arange(0.0, 60.0 + 1e-9, 0.01)
RATIO = 16.0


def trace(t_s=T_S, *, accel=0.0, wheel_rad=0.0, interventions=0.0):
    columns = {
        "lateral_accel_mps2": accel,
        "road_wheel_angle_rad": np.asarray(wheel_rad) / RATIO,
        "interventions": interventions,
    }
    spread = {name: np.broadcast_to(np.asarray(v, float), len(t_s)) for name, v in columns.items()}
    return Trace({"t_s": t_s, **spread}, {})


def test_a_long_ramp_has_its_slope_as_jerk():
    assert max_lateral_jerk_mps3(trace(accel=-0.05 * T_S)) == pytest.approx(0.05)
    # The filter answers the step of slope with its overshoot: 10.9 % for the fourth order, less in the mean.
    assert 0.05 * 1.05 < max_r79_jerk_mps3(trace(accel=-0.05 * T_S)) < 0.05 * 1.109
    assert max_r79_jerk_mps3(trace(accel=2.0)) == pytest.approx(0.0, abs=1e-9)


def test_the_filter_of_r79_takes_a_sine_at_its_cut_off_down_by_three_decibels():
    sine = trace(accel=np.sin(2 * math.pi * 0.5 * T_S))
    # The mean over w of the derivative of sin(ωt) has the amplitude 2·sin(ωw/2)/w.
    unfiltered = 2 * math.sin(2 * math.pi * 0.5 * 0.25) / 0.5
    assert max_lateral_jerk_mps3(sine) == pytest.approx(unfiltered, rel=1e-3)
    steady = trace(T_S[T_S < 30], accel=np.sin(2 * math.pi * 0.5 * T_S[T_S < 30]))
    assert max_r79_jerk_mps3(steady) == pytest.approx(unfiltered / math.sqrt(2), rel=0.05)


def test_the_filter_of_r79_removes_vibration():
    shaken = trace(accel=np.sin(2 * math.pi * 5.0 * T_S))
    assert max_lateral_jerk_mps3(shaken) == pytest.approx(4.0, rel=1e-3)  # 2·sin(2.5π)/0.5
    assert max_r79_jerk_mps3(shaken) < 0.4


@pytest.mark.parametrize("jerk", [max_lateral_jerk_mps3, max_r79_jerk_mps3])
def test_the_jump_of_an_intervention_does_not_count_as_jerk(jerk):
    later = T_S > 20.0
    assert jerk(trace(accel=2.0 * later, interventions=later)) == pytest.approx(0.0, abs=1e-9)
    assert jerk(trace(accel=2.0 * later)) > 1.0


def test_reversals_are_swings_by_the_gap_between_stationary_points():
    assert count_reversals(np.array([0.0, 3.0, 0.0, 1.0, 0.5, 3.0, 2.9]), 2.0) == 3  # up, down, up
    assert count_reversals(np.array([0.0, 1.0, 2.0, 3.0]), 2.0) == 1
    assert count_reversals(np.array([0.0, 1.9, 0.0, 1.9]), 2.0) == 0
    assert count_reversals(np.array([1.0, 1.0, 1.0]), 2.0) == 0


def test_a_sine_at_the_wheel_reverses_twice_per_period_if_it_is_wide_enough():
    def slow(degrees):
        return trace(wheel_rad=np.radians(degrees) * np.cos(2 * math.pi * 0.1 * T_S))

    assert steering_reversals_per_min(slow(1.2)) == pytest.approx(12.0)  # 6 periods a minute, 2.4 deg wide
    assert steering_reversals_per_min(slow(0.9)) == 0.0


def test_noise_of_the_angle_sensor_is_no_steering():
    noise = np.random.default_rng(0).normal(0.0, np.radians(0.5), len(T_S))
    assert steering_reversals_per_min(trace(wheel_rad=noise)) == 0.0


def test_runs_too_short_to_filter_have_no_rate():
    assert steering_reversals_per_min(trace(T_S[:50])) is None
    assert steering_reversals_per_min(trace(T_S[:101])) == 0.0
