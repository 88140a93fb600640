"""Lane motion, prediction and the lateral law against closed forms and mirror images."""

import math

import numpy as np
import pytest
from controller_rig import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE, state, vehicle

from controller.laws.feedforward import gains, path_curvature
from controller.model.bicycle import angle_from_curvature
from controller.prediction import Predictor
from trepid.clothoid import Lane, lane_after

LATERAL = SETTINGS.lateral.feedforward
finite = st.floats(-1.0, 1.0)


def lane(offset_m=0.0, heading_rad=0.0, curvature_1pm=0.0, curvature_rate_1pm2=0.0, lookahead_m=20.0):
    return Lane(
        offset_m=offset_m,
        heading_rad=heading_rad,
        curvature_1pm=curvature_1pm,
        curvature_rate_1pm2=curvature_rate_1pm2,
        lookahead_m=lookahead_m,
    )


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("speed_mps", [0.0, 1.0, 5.5, 10.0, 30.0])
def test_the_gains_place_all_three_poles_at_the_bandwidth_and_damping(speed_mps, lag_s):
    gain = gains(speed_mps, lag_s=lag_s, settings=LATERAL)
    speed_mps = max(speed_mps, 0.1)
    lag_m = speed_mps * lag_s
    poles = np.roots(np.trim_zeros([lag_m, 1.0, gain.heading_1pm, gain.offset_1pm2], "f"))
    slow = LATERAL.bandwidth_radpm, LATERAL.bandwidth_radps / speed_mps
    omega = min(*slow, 0.25 / (LATERAL.damping * lag_m) if lag_m else math.inf)
    assert (poles.real < 0).all()
    pair = np.roots([1.0, 2 * LATERAL.damping * omega, omega**2])
    for pole in pair:
        assert np.min(abs(poles - pole)) == pytest.approx(0.0, abs=1e-6)


def test_in_time_the_gain_on_the_offset_does_not_grow_with_speed():
    """A loop designed in time with fixed curvature gains speeds up with v² and leaves the lane."""
    fast, faster = (gains(v, lag_s=0.1, settings=LATERAL) for v in (10.0, 30.0))
    assert fast.offset_1pm2 * 10.0**2 == pytest.approx(faster.offset_1pm2 * 30.0**2)


def mirror(one):
    return Lane(*(-value for value in one[:4]), one.lookahead_m)


def curvature_for(one, speed_mps=5.5):
    return path_curvature(one, speed_mps=speed_mps, lag_s=0.1, settings=LATERAL)


def test_on_the_centre_of_a_clothoid_the_law_demands_the_curvature_one_lag_ahead():
    assert curvature_for(lane(curvature_1pm=0.02, curvature_rate_1pm2=0.005)) == pytest.approx(
        0.02 + 0.005 * 0.55
    )


def test_left_of_the_centre_it_steers_right_and_pointing_right_it_steers_left():
    assert curvature_for(lane(offset_m=0.2)) < 0 < curvature_for(lane(heading_rad=-0.02))


def test_far_from_the_centre_it_demands_at_most_the_largest_approach_angle():
    approach_rad = math.asin(LATERAL.max_approach_mps / 10.0)
    for far in (2.0, 5.0):
        assert curvature_for(lane(offset_m=far, heading_rad=-approach_rad), 10.0) == pytest.approx(
            0.0, abs=1e-12
        )
        assert curvature_for(lane(offset_m=far), 10.0) == curvature_for(lane(offset_m=8.0), 10.0)


@given(finite, finite, finite, finite, st.floats(0, 30))
def test_the_law_is_mirror_symmetric(offset, heading, curvature, rate, speed):
    one = lane(offset, heading, 0.1 * curvature, 0.01 * rate)
    assert curvature_for(one, speed) == -curvature_for(mirror(one), speed)


def predictor(car=SHUTTLE):
    return Predictor(car, command_delay_s=0.01, memory_s=1.0)


def when_steering_acts(ahead: Predictor, seen: Lane, *, path_t_s: float, now_s: float) -> Lane:
    """``seen``, valid at ``path_t_s``, when a command given at ``now_s`` acts."""
    measured, valid_s = ahead.at_last_state(seen, valid_s=path_t_s)
    return ahead.when_steering_acts(measured, valid_s=valid_s, now_s=now_s).lane


def test_a_late_path_is_brought_forward_along_the_measured_circle():
    curvature = 1 / 20
    angle = angle_from_curvature(curvature, speed_mps=5.0, vehicle=SHUTTLE)
    ahead = predictor()
    for n in range(20):
        measured = state(0.01 * n, road_wheel_angle_rad=angle, yaw_rate_radps=5.0 * curvature)
        ahead.add_state(measured, 5.0)
        ahead.add_command(angle, now_s=0.01 * n)
    seen = lane(offset_m=0.1, curvature_1pm=curvature, curvature_rate_1pm2=0.001)
    there = when_steering_acts(ahead, seen, path_t_s=0.05, now_s=0.19)
    expected = seen
    for _ in range(1000):
        expected = Lane(*lane_after(expected, (0.19 + 0.06 - 0.05) / 1000, 5.0, 5.0 * curvature))
    assert there.offset_m == pytest.approx(expected.offset_m, abs=1e-6)
    assert there.heading_rad == pytest.approx(expected.heading_rad, abs=1e-6)
    assert there.curvature_1pm == pytest.approx(expected.curvature_1pm, abs=1e-6)


def test_commands_on_their_way_are_counted_in():
    """A step sent 50 ms ago begins to act in 10 ms: by then + 60 ms the heading has turned with the lag."""
    ahead = predictor(vehicle(understeer_gradient_rad_per_mps2=0.0, max_road_wheel_rate_radps=100.0))
    ahead.add_state(state(0.0), 5.0)
    ahead.add_command(0.1, now_s=0.0)
    ahead.add_state(state(0.05), 5.0)
    there = when_steering_acts(ahead, lane(), path_t_s=0.05, now_s=0.05)
    acting_s, lag_s = 0.05, 0.1
    turned = 5.0 * math.tan(0.1) / 1.75 * (acting_s - lag_s * (1 - math.exp(-acting_s / lag_s)))
    assert there.heading_rad == pytest.approx(turned, rel=0.03)
    assert when_steering_acts(predictor(), lane(offset_m=1.0), path_t_s=0.0, now_s=0.0).offset_m == 1.0


def test_unknown_yaw_rate_and_wheel_angle_are_taken_from_the_model_and_the_commands():
    blind, seeing = predictor(), predictor()
    for n in range(10):
        t, rate = 0.01 * n, 5.0 * 0.05
        angle = angle_from_curvature(0.05, speed_mps=5.0, vehicle=SHUTTLE)
        blind.add_command(angle, now_s=t)
        seeing.add_command(angle, now_s=t)
        blind.add_state(state(t, road_wheel_angle_rad=None, yaw_rate_radps=None), 5.0)
        seeing.add_state(state(t, road_wheel_angle_rad=angle, yaw_rate_radps=rate), 5.0)
    ends = [when_steering_acts(p, lane(), path_t_s=0.0, now_s=0.09) for p in (blind, seeing)]
    assert ends[0].heading_rad == pytest.approx(ends[1].heading_rad, abs=1e-9)


def test_a_state_older_than_the_newest_changes_nothing():
    ahead = predictor()
    ahead.add_state(state(0.1), 5.0)
    before = when_steering_acts(ahead, lane(heading_rad=0.1), path_t_s=0.1, now_s=0.1)
    ahead.add_state(state(0.05, road_wheel_angle_rad=0.3, yaw_rate_radps=3.0), 9.0)
    assert when_steering_acts(ahead, lane(heading_rad=0.1), path_t_s=0.1, now_s=0.1) == before
