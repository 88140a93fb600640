"""Margins to contact and to the lane edge, against values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_harness.judging.margins import (
    lane_edge_distance_m,
    time_gap_s,
    time_to_collision_s,
    time_to_crossing_s,
)
from sim_harness.judging.trace import Trace

CENTRED = dict(
    lateral_offset_m=0.0,
    heading_error_rad=0.0,
    curvature_1pm=0.0,
    lane_width_m=3.4,
    speed_mps=10.0,
    yaw_rate_radps=0.0,
    lead_gap_m=math.nan,
)


def trace(n=1, **columns):
    values = {name: np.broadcast_to(np.asarray(v, float), n) for name, v in (CENTRED | columns).items()}
    return Trace({"t_s": np.arange(float(n)), **values}, {})


def test_the_time_gap_is_zero_in_contact_infinite_at_standstill_and_absent_without_a_vehicle():
    gaps = trace(4, lead_gap_m=[20.0, -0.1, 5.0, math.nan], speed_mps=[10.0, 10.0, 0.0, 10.0])
    assert time_gap_s(gaps).tolist()[:3] == [2.0, 0.0, math.inf]
    assert np.isnan(time_gap_s(gaps)[3])


def test_time_to_collision_is_the_gap_over_its_closing_rate():
    gaps = trace(5, lead_gap_m=[30.0, 25.0, 25.0, 27.0, -1.0])
    assert time_to_collision_s(gaps).tolist()[1:] == [5.0, math.inf, math.inf, 0.0]
    assert np.isnan(time_to_collision_s(gaps)[0])


def test_the_lane_edge_distance_is_that_of_the_outermost_wheel():
    assert lane_edge_distance_m(trace())[0] == pytest.approx(1.0)  # 3.4/2 - 1.4/2
    assert lane_edge_distance_m(trace(lateral_offset_m=-0.3))[0] == pytest.approx(0.7)
    turned = trace(lateral_offset_m=0.3, heading_error_rad=0.1)  # the front left wheel leads
    assert lane_edge_distance_m(turned)[0] == pytest.approx(
        1.7 - 0.3 - 1.75 * math.sin(0.1) - 0.7 * math.cos(0.1)
    )
    assert lane_edge_distance_m(trace(lateral_offset_m=1.1))[0] == pytest.approx(-0.1)


def test_on_a_straight_the_crossing_comes_after_distance_over_drift():
    drifting = trace(heading_error_rad=0.02, lateral_offset_m=0.1)
    room_m = 1.7 - 0.7 * math.cos(0.02) - 0.1 - 1.75 * math.sin(0.02)
    assert time_to_crossing_s(drifting)[0] == pytest.approx(room_m / (10 * math.sin(0.02)))


def test_in_a_bend_driven_straight_on_the_crossing_comes_after_the_fall_towards_the_edge():
    straight_on = trace(
        curvature_1pm=0.01
    )  # a = κ·v² = 1 m/s², front axle starts with L·κ·v towards the edge
    front_s = -0.175 + math.sqrt(0.175**2 + 2.0)
    assert time_to_crossing_s(straight_on)[0] == pytest.approx(front_s)


def test_a_car_that_follows_its_lane_never_crosses_and_a_car_beyond_the_edge_has_crossed():
    assert time_to_crossing_s(trace(curvature_1pm=0.01, yaw_rate_radps=0.1))[0] == math.inf
    assert time_to_crossing_s(trace(speed_mps=0.0))[0] == math.inf
    assert time_to_crossing_s(trace(lateral_offset_m=1.2))[0] == 0.0


def test_a_drift_that_is_steered_back_in_time_does_not_cross():
    drift = dict(heading_error_rad=0.05, lateral_offset_m=-0.5)  # u = 0.5 m/s, room 1.4 m at the front
    assert time_to_crossing_s(trace(**drift, yaw_rate_radps=0.0))[0] < 4.0
    back = time_to_crossing_s(trace(**drift, yaw_rate_radps=-0.05))[0]  # a = -0.5 m/s²: turns after 0.25 m
    right_edge_s = (0.5 + math.sqrt(0.25 + 2 * 0.5 * 0.5)) / 0.5
    assert back == pytest.approx(right_edge_s, rel=0.1)


lateral = st.floats(-0.9, 0.9)
small = st.floats(-0.2, 0.2)


@given(lateral, small, small, st.floats(-0.05, 0.05))
def test_left_and_right_are_alike(offset_m, error_rad, rate_radps, curvature_1pm):
    here = dict(
        lateral_offset_m=offset_m,
        heading_error_rad=error_rad,
        yaw_rate_radps=rate_radps,
        curvature_1pm=curvature_1pm,
    )
    there = {name: -value for name, value in here.items()}
    for margin in (lane_edge_distance_m, time_to_crossing_s):
        assert margin(trace(**here))[0] == margin(trace(**there))[0]


@given(lateral, small, small, st.floats(-0.02, 0.02))
def test_the_crossing_is_where_a_wheel_path_of_constant_curvature_meets_the_edge(
    offset_m, error_rad, rate_radps, curvature_1pm
):
    """Brute force: the same motion, sampled."""
    found_s = time_to_crossing_s(
        trace(
            lateral_offset_m=offset_m,
            heading_error_rad=error_rad,
            yaw_rate_radps=rate_radps,
            curvature_1pm=curvature_1pm,
        )
    )[0]
    t_s = np.arange(0.0, 20.0, 0.002)
    turn = rate_radps - 10.0 * curvature_1pm
    room_m = 1.7 - 0.7 * math.cos(error_rad)
    outside = np.zeros(len(t_s), bool)
    for ahead_m in (0.0, 1.75):
        start_m = offset_m + ahead_m * math.sin(error_rad)
        drift_mps = 10 * math.sin(error_rad) + ahead_m * math.cos(error_rad) * turn
        outside |= np.abs(start_m + drift_mps * t_s + 10 * turn * t_s**2 / 2) >= room_m
    expected_s = t_s[outside][0] if outside.any() else math.inf
    if math.isfinite(found_s) and found_s < 19.0:
        assert expected_s == pytest.approx(found_s, abs=0.0021)
    else:
        assert expected_s > 18.9
