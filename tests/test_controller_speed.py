"""Speed targets and acceleration demands against closed forms, on a car with drive lag."""

import math

import pytest
from controller_rig import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from controller.lane import Lane
from controller.speed import SpeedControl, SpeedSettings, Target, target
from trepid.messages import Stop

SPEED = SETTINGS.speed
DT_S = 0.02


def lane(curvature_1pm=0.0, curvature_rate_1pm2=0.0, lookahead_m=20.0):
    return Lane(
        offset_m=0.0,
        heading_rad=0.0,
        curvature_1pm=curvature_1pm,
        curvature_rate_1pm2=curvature_rate_1pm2,
        lookahead_m=lookahead_m,
    )


def goal(one, cap_mps=20.0, speed_mps=5.0):
    return target(one, cap_mps=cap_mps, speed_mps=speed_mps, settings=SPEED)


def ride(demand, speed_mps, seconds, lag_s=0.15, accel_mps2=0.0):
    """(speed, demand) over time on a car with first-order drive lag; ``demand(v)`` is called every DT_S."""
    trace = []
    for _ in range(round(seconds / DT_S)):
        asked = demand(speed_mps)
        accel_mps2 = asked + (accel_mps2 - asked) * math.exp(-DT_S / lag_s)
        speed_mps = max(0.0, speed_mps + accel_mps2 * DT_S)
        trace.append((speed_mps, asked))
    return trace


def test_a_straight_lane_is_driven_at_the_cap():
    assert goal(lane(), cap_mps=12.0) == Target(12.0, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_in_a_bend_lateral_acceleration_is_within_its_budget(sign):
    bend = goal(lane(curvature_1pm=sign / 15))
    assert bend == Target(pytest.approx(math.sqrt(2.0 * 15)), 0.0)


def test_before_a_bend_the_speed_falls_as_braking_with_the_planned_deceleration():
    bend = goal(lane(curvature_rate_1pm2=1 / 300, lookahead_m=20.0))
    allowed = [math.sqrt(2.0 / (ahead / 300) + 2.0 * SPEED.curve_decel_mps2 * ahead) for ahead in (17.5, 20)]
    assert bend.speed_mps == pytest.approx(min(allowed))
    assert bend.accel_mps2 == pytest.approx(-SPEED.curve_decel_mps2 * 5.0 / min(allowed))


@pytest.mark.parametrize("cap_mps", [0.5, 2.0, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("start_mps", [0.0, 1.0])
def test_the_speed_reaches_its_cap_and_never_overshoots_it(cap_mps, start_mps):
    control = SpeedControl(SPEED)
    trace = ride(
        lambda v: control.track(Target(cap_mps, 0.0), speed_mps=v, dt_s=DT_S), start_mps, cap_mps + 12.0
    )
    assert max(v for v, _ in trace) <= max(cap_mps, start_mps) + 1e-3
    assert trace[-1][0] == pytest.approx(cap_mps, abs=0.01)


def test_a_lower_cap_is_reached_from_above_within_the_braking_limit():
    control = SpeedControl(SPEED)
    trace = ride(lambda v: control.track(Target(3.0, 0.0), speed_mps=v, dt_s=DT_S), 12.0, 14.0)
    assert trace[-1][0] == pytest.approx(3.0, abs=0.02)
    assert min(v for v, _ in trace) >= 3.0 - 0.02
    assert min(a for _, a in trace) >= -SPEED.max_decel_mps2


@given(st.lists(st.tuples(st.floats(0, 30), st.floats(0, 30)), min_size=2, max_size=30))
def test_the_demand_never_changes_faster_than_its_jerk(targets):
    control = SpeedControl(SPEED)
    last = control.accel_mps2
    for cap_mps, speed_mps in targets:
        if cap_mps <= SPEED.standstill_mps:
            continue
        demand = control.track(Target(cap_mps, 0.0), speed_mps=speed_mps, dt_s=DT_S)
        assert -SPEED.brake_jerk_mps3 * DT_S <= demand - last + 1e-12
        assert demand - last <= SPEED.jerk_mps3 * DT_S + 1e-12
        last = demand


@pytest.mark.parametrize("how", [Stop.COMFORT, Stop.EMERGENCY])
@pytest.mark.parametrize("start_mps", [0.3, 5.0, 30.0])
def test_a_stop_reaches_standstill_within_its_deceleration_and_holds(how, start_mps):
    profile = SPEED.emergency if how is Stop.EMERGENCY else SPEED.comfort
    control = SpeedControl(SPEED)
    control.accel_mps2 = 0.8
    braking_s = start_mps / profile.decel_mps2 + 4.0
    trace = ride(
        lambda v: control.stop(how, speed_mps=v, dt_s=DT_S), start_mps, braking_s + 2.0, accel_mps2=0.8
    )
    assert all(-max(profile.decel_mps2, SPEED.hold_decel_mps2) <= a <= 0.0 for _, a in trace)
    standing = [(v, a) for v, a in trace if v == 0.0]
    assert len(standing) * DT_S >= 1.5
    assert trace[-1] == (0.0, -SPEED.hold_decel_mps2)


def test_a_comfort_stop_from_5_mps_takes_the_distance_of_its_profile():
    """v²/2a, plus jerk-up v·a/2j and lag v·τ, plus a soft end of less than half a metre."""
    control = SpeedControl(SPEED)
    control.accel_mps2 = 0.0
    trace = ride(lambda v: control.stop(Stop.COMFORT, speed_mps=v, dt_s=DT_S), 5.0, 10.0)
    least_m = 5.0**2 / 2.0 + 5.0 / (2.0 * SPEED.comfort.jerk_mps3) + 5.0 * 0.15
    assert least_m - 0.2 <= sum(v for v, _ in trace) * DT_S <= least_m + 0.5


def test_an_unknown_speed_brakes_without_end():
    control = SpeedControl(SPEED)
    for _ in range(100):
        demand = control.stop(Stop.COMFORT, speed_mps=None, dt_s=DT_S)
    assert demand == -SPEED.comfort.decel_mps2


def test_a_cap_of_zero_is_a_comfort_stop():
    control = SpeedControl(SPEED)
    control.accel_mps2 = 0.5
    assert control.track(Target(0.0, 0.0), speed_mps=5.0, dt_s=DT_S) == -SPEED.comfort.jerk_mps3 * DT_S


def test_a_tuning_that_would_overshoot_is_refused():
    with pytest.raises(ValidationError, match="overshoot"):
        SpeedSettings.model_validate(SPEED.model_dump() | {"gain_1ps": 4.0})
