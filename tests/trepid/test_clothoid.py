"""Claims about the lane as a clothoid and its motion."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.clothoid import Lane, Motion, advance_clothoid, lane_after
from trepid.messages import SteeringEstimate

unit = st.floats(-1.0, 1.0)
small = st.floats(-0.5, 0.5)
lanes = st.builds(
    Lane,
    small,
    st.floats(-0.1, 0.1),
    st.floats(-0.05, 0.05),
    st.floats(-0.005, 0.005),
    st.just(math.inf),
)


def lane_at(
    offset_m=0.0, heading_rad=0.0, curvature_1pm=0.0, curvature_rate_1pm2=0.0, lookahead_m=20.0
) -> Lane:
    return Lane(offset_m, heading_rad, curvature_1pm, curvature_rate_1pm2, lookahead_m)


def mirror(one: Lane) -> Lane:
    return Lane(*(-value for value in one[:4]), one.lookahead_m)


def by_arc(lane: Lane, motion: Motion, dt_s: float) -> Lane:
    way_m, turned_rad = motion.speed_mps * dt_s, motion.yaw_rate_radps * dt_s
    moved = advance_clothoid(*lane[:4], way_m=way_m, turned_rad=turned_rad, sin=math.sin)
    return Lane(*moved, lane.curvature_rate_1pm2)


def test_the_pursuit_curvature_of_a_centred_vehicle_on_an_arc_is_that_of_the_arc():
    assert Lane(0.0, 0.0, 0.03, 0.0).pursuit_curvature(8.0) == pytest.approx(0.03)


@given(e=small, psi=small)
def test_left_of_the_lane_or_turned_left_steers_right(e, psi):
    assert Lane(e, psi, 0.0, 0.0).pursuit_curvature(8.0) == pytest.approx(-2 * (e + 8 * psi) / 64)


@given(lane=lanes, x=st.floats(1, 15))
def test_the_mirrored_lane_gives_the_opposite_position_and_command(lane, x):
    assert mirror(lane).y_m(x) == -lane.y_m(x)
    assert mirror(lane).pursuit_curvature(x) == -lane.pursuit_curvature(x)


@given(lane=lanes, ahead_m=st.floats(0, 60))
def test_the_curvature_of_a_message_converts_to_the_axle_and_back(lane, ahead_m):
    message = replace(
        SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=ahead_m, reason=""),
        lateral_offset_m=lane.offset_m,
        heading_error_rad=lane.heading_rad,
        curvature_1pm=lane.curvature_at(ahead_m),
        curvature_rate_1pm2=lane.curvature_rate_1pm2,
    )
    assert Lane.of_message(message) == pytest.approx(lane, abs=1e-15)
    arc = Lane.of_message(replace(message, curvature_rate_1pm2=None), known_m=ahead_m)
    assert arc is not None
    assert (arc.curvature_1pm, arc.curvature_rate_1pm2, arc.lookahead_m) == (
        message.curvature_1pm,
        0,
        ahead_m,
    )


@pytest.mark.parametrize("field", ["lateral_offset_m", "heading_error_rad", "curvature_1pm"])
def test_a_message_without_one_of_its_numbers_has_no_lane(field):
    fields = {"lateral_offset_m": 0.1, "heading_error_rad": 0.0, "curvature_1pm": 0.0} | {field: None}
    nothing = SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=8.0, reason="")
    assert Lane.of_message(replace(nothing, **fields)) is None


@given(lane=lanes, x=st.floats(-5, 20), further=st.floats(-5, 10))
def test_a_lane_expressed_from_another_place_is_the_same_curve(lane, x, further):
    moved = lane.in_frame_at(x, 0.2)
    assert -moved.heading_rad == pytest.approx(lane.slope_at(x), abs=1e-12)
    assert moved.y_m(further) == pytest.approx(lane.y_m(x + further) - 0.2, abs=1e-9)


def drive_on(one, seconds, speed_mps, yaw_rate_radps, steps=1000):
    for _ in range(steps):
        one = Lane(*lane_after(one, seconds / steps, speed_mps, yaw_rate_radps))
    return one


def test_driving_straight_across_a_straight_lane_is_trigonometry():
    end = drive_on(lane_at(offset_m=0.2, heading_rad=0.1), 2.0, 5.0, 0.0)
    assert end.offset_m == pytest.approx(0.2 + 10.0 * math.sin(0.1), abs=1e-9)
    assert end.heading_rad == 0.1


def test_driving_the_concentric_circle_keeps_offset_and_heading():
    inside = lane_at(offset_m=1.0, curvature_1pm=1 / 15)
    end = drive_on(inside, 2.0, 5.0, 5.0 / 14.0)
    assert end.offset_m == pytest.approx(1.0, abs=1e-9)
    assert end.heading_rad == pytest.approx(0.0, abs=1e-9)


def test_driving_straight_past_a_circle_leaves_it_as_pythagoras_states():
    end = drive_on(lane_at(curvature_1pm=1 / 15), 1.0, 6.0, 0.0)
    assert end.offset_m == pytest.approx(15.0 - math.hypot(15.0, 6.0), abs=1e-5)
    assert end.heading_rad == pytest.approx(-math.atan2(6.0, 15.0), abs=1e-5)


def test_one_step_is_of_second_order():
    start = lane_at(0.3, 0.2, 0.05, 0.002)
    exact = drive_on(start, 0.2, 8.0, 0.3, steps=4096)
    errors = [abs(drive_on(start, 0.2, 8.0, 0.3, steps=n).offset_m - exact.offset_m) for n in (4, 8)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


def test_the_curvature_is_constant_beyond_the_look_ahead():
    clothoid = lane_at(curvature_rate_1pm2=0.01, lookahead_m=10.0)
    assert clothoid.curvature_at(5.0) == pytest.approx(0.05)
    assert clothoid.curvature_at(50.0) == pytest.approx(0.1)
    end = drive_on(clothoid, 4.0, 5.0, 0.0)
    assert (end.curvature_rate_1pm2, end.lookahead_m) == (0.0, 0.0)
    assert end.curvature_1pm == pytest.approx(0.1, abs=2e-3)


@given(unit, unit, unit, unit, st.floats(0, 30), unit)
def test_the_mirrored_lane_moves_as_the_mirror_image(offset, heading, curvature, rate, speed, yaw):
    one = lane_at(offset, heading, 0.1 * curvature, 0.01 * rate)
    left = Lane(*lane_after(one, 0.1, speed, yaw))
    assert mirror(left) == Lane(*lane_after(mirror(one), 0.1, speed, -yaw))


@pytest.mark.parametrize("yaw_rate_radps", [-0.3, 0.0, 0.4])
def test_the_three_forms_of_the_motion_agree_to_third_order_in_the_step(yaw_rate_radps):
    lane, motion = Lane(0.0, 0.0, 0.03, 0.002), Motion(8.0, yaw_rate_radps)
    differences = []
    for dt_s in (0.04, 0.02):
        exact = Lane(*lane_after(lane, dt_s, *motion))
        forms = [lane.after(motion, dt_s), by_arc(lane, motion, dt_s)]
        differences.append([np.abs(np.subtract(form[:2], exact[:2])).max() for form in forms])
    (chord_m, arc_m), (half_chord_m, half_arc_m) = differences
    assert max(chord_m, arc_m) < 1e-3
    assert half_chord_m < chord_m / 6 and half_arc_m < arc_m / 6
