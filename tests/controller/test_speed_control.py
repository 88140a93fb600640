"""Speed targets and acceleration demands against closed forms, on a car with drive lag."""

import math
from itertools import pairwise
from typing import NamedTuple

import pytest
from controller_rig import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE
from pydantic import ValidationError

from controller.speed_control import LoadObserver, SpeedControl
from controller.speed_limits import SpeedSettings, Target, target
from trepid.clothoid import Lane
from trepid.messages import Stop

SPEED = SETTINGS.speed
DT_S = 0.02
LAG_S = 0.15
CAR = SHUTTLE.model_copy(update={"accel_lag_s": LAG_S})
REACT_S = LAG_S + SPEED.curve_decel_mps2 / (2 * SPEED.brake_jerk_mps3)


def lane(curvature_1pm=0.0, curvature_rate_1pm2=0.0, lookahead_m=20.0):
    return Lane(
        offset_m=0.0,
        heading_rad=0.0,
        curvature_1pm=curvature_1pm,
        curvature_rate_1pm2=curvature_rate_1pm2,
        lookahead_m=lookahead_m,
    )


def goal(one, cap_mps=20.0, speed_mps=5.0):
    return target(one, cap_mps=cap_mps, speed_mps=speed_mps, drive_lag_s=LAG_S, settings=SPEED)


def speed_control(accel_mps2=None):
    control = SpeedControl(SPEED, CAR)
    if accel_mps2 is not None:
        control.accel_mps2 = control._given_mps2 = control._load.acting_mps2 = accel_mps2
    return control


class Ride(NamedTuple):
    """A car over time: speed, demand and true acceleration after every step, metres in all."""

    speed_mps: list[float]
    demand_mps2: list[float]
    accel_mps2: list[float]
    metres: float


def ride(demand, speed_mps, seconds, lag_s=LAG_S, accel_mps2=0.0, hill_mps2=0.0):
    """A car with first-order drive lag on a hill; ``demand(v, t)`` is called every DT_S. Brakes never push."""
    trace: tuple = ([], [], [])
    metres, fine_s = 0.0, DT_S / 20
    for n in range(round(seconds / DT_S)):
        demanded = demand(speed_mps, n * DT_S)
        for _ in range(20):
            accel_mps2 = demanded + (accel_mps2 - demanded) * math.exp(-fine_s / lag_s)
            true_mps2 = accel_mps2 + hill_mps2
            after_mps = max(0.0, speed_mps + true_mps2 * fine_s)
            metres += 0.5 * (speed_mps + after_mps) * fine_s
            speed_mps = after_mps
        for column, value in zip(trace, (speed_mps, demanded, true_mps2), strict=True):
            column.append(value)
    return Ride(*trace, metres)


def tracking(control, cap_mps):
    """Demand towards ``cap_mps``, a number or a function of time."""
    cap = cap_mps if callable(cap_mps) else lambda _: cap_mps
    return lambda v, t: control.track(Target(cap(t), None), speed_mps=v, dt_s=DT_S)


def stopping(control, how):
    return lambda v, _: control.stop(how, speed_mps=v, dt_s=DT_S)


def profile_of(how):
    return SPEED.emergency if how is Stop.EMERGENCY else SPEED.comfort


def test_a_straight_lane_is_driven_at_the_cap():
    assert goal(lane(), cap_mps=12.0) == Target(12.0, None)


@pytest.mark.parametrize("sign", [1, -1])
def test_in_a_bend_lateral_acceleration_is_within_its_budget(sign):
    bend = goal(lane(curvature_1pm=sign / 15))
    assert bend == Target(pytest.approx(math.sqrt(2.0 * 15)), None)


def test_before_a_bend_the_speed_falls_as_braking_with_the_planned_deceleration():
    """A bend that does not tighten further needs no margin beyond the sight."""
    sight_m = 20.0
    bend = goal(lane(curvature_1pm=1 / 15, curvature_rate_1pm2=-1 / 3000, lookahead_m=sight_m))
    assert bend == Target(pytest.approx(math.sqrt(2.0 * 15)), None)
    sight_m, rate_1pm2 = 40.0, 1 / 1500
    bend = goal(lane(curvature_rate_1pm2=rate_1pm2, lookahead_m=sight_m))
    looks = [sight_m * n / 8 for n in range(1, 9)]
    allowed = [
        math.sqrt(2.0 / (ahead * rate_1pm2) + 2.0 * SPEED.curve_decel_mps2 * max(0.0, ahead - 5.0 * REACT_S))
        for ahead in looks
    ]
    assert bend.speed_mps == pytest.approx(min(allowed))
    assert bend.accel_mps2 == pytest.approx(-SPEED.curve_decel_mps2 * min(1.0, 5.0 / min(allowed)))


@given(st.floats(-0.1, 0.1), st.floats(-0.02, 0.02), st.floats(1, 50), st.floats(0, 30), st.floats(0.1, 30))
def test_no_bend_in_sight_raises_the_target_and_none_is_taken_above_its_budget(
    kappa, rate, sight, speed, cap
):
    seen = lane(kappa, rate, sight)
    bend = goal(seen, cap_mps=cap, speed_mps=speed)
    assert bend.speed_mps <= cap
    assert bend.speed_mps**2 * abs(kappa) <= SPEED.lateral_accel_mps2 * (1 + 1e-9)
    assert bend.accel_mps2 is None or -SPEED.max_decel_mps2 <= bend.accel_mps2 <= 0.0
    mirrored = goal(lane(-kappa, -rate, sight), cap_mps=cap, speed_mps=speed)
    assert mirrored == bend


@pytest.mark.parametrize("rate_1pm2", [0.012, -0.012])
def test_a_bend_that_begins_soon_or_ends_soon_is_driven_within_its_jerk(rate_1pm2):
    """|c|·v³ = 1.5 m/s³ at 5 m/s."""
    begins = goal(lane(0.0, rate_1pm2, lookahead_m=6.0))
    ends = goal(lane(-6.0 * rate_1pm2, rate_1pm2, lookahead_m=6.0))
    assert begins == Target(pytest.approx(5.0), None)
    assert ends.speed_mps == pytest.approx(min(5.0, math.sqrt(2.0 / 0.072)))


@given(st.floats(-0.02, 0.02), st.floats(0, 50), st.floats(0.1, 30))
def test_a_rate_that_bends_no_more_than_an_estimate_s_error_slows_nothing(rate_1pm2, sight_m, cap_mps):
    """Jerk counts from 1 m/s² of lateral acceleration on, between here and the look-ahead."""
    target_mps = goal(lane(0.0, rate_1pm2, sight_m), cap_mps=cap_mps, speed_mps=0.0).speed_mps
    jerk_mps3, change_mps2 = abs(rate_1pm2) * target_mps**3, abs(rate_1pm2) * sight_m * target_mps**2
    assert jerk_mps3 <= SPEED.lateral_jerk_mps3 * (1 + 1e-6) or change_mps2 <= 1.0 + 1e-6
    if abs(rate_1pm2) * 2.0 * sight_m * cap_mps**2 <= 1.0:
        assert target_mps == cap_mps


def test_a_bend_that_tightens_out_of_sight_slows_one_that_opens_does_not():
    tightening, opening = lane(0.02, 0.004, 8.0), lane(0.084, -0.004, 8.0)
    held = lane(0.02 + 8 * 0.004, 0.0, 8.0)
    at_mps = 7.0
    beyond = 0.02 + 16 * 0.004
    react_m = at_mps * (LAG_S + SPEED.max_decel_mps2 / (2 * SPEED.brake_jerk_mps3))
    assert goal(tightening, speed_mps=at_mps).speed_mps < goal(held, speed_mps=at_mps).speed_mps + 3.0
    assert goal(tightening, cap_mps=30.0, speed_mps=at_mps).speed_mps ** 2 <= 2.0 / beyond + 5.0 * (
        16 - react_m
    )
    assert goal(opening, speed_mps=at_mps).speed_mps == pytest.approx(math.sqrt(2.0 / 0.084))


@pytest.mark.parametrize("speed_mps", [6.0, 8.0])
def test_a_bend_behind_a_clothoid_is_entered_within_its_budget(speed_mps):
    """Straight, then κ = c·(s - 40 m) up to 1/15; sight of one second, at least 8 m, straight on beyond."""
    control, place = speed_control(0.0), [0.0]
    entry_m, begin_m, worst = 12.0, 40.0, [0.0]

    def kappa(s_m):
        return min(max(s_m - begin_m, 0.0) / entry_m, 1.0) / 15

    def demand(v, _):
        sight_m = max(8.0, v)
        place[0] += v * DT_S
        here, there = kappa(place[0]), kappa(place[0] + sight_m)
        worst[0] = max(worst[0], v * v * here)
        seen = lane(here, (there - here) / sight_m, sight_m)
        return control.track(goal(seen, cap_mps=speed_mps, speed_mps=v), speed_mps=v, dt_s=DT_S)

    ride(demand, speed_mps, 12.0)
    assert place[0] > begin_m + entry_m
    assert worst[0] <= 1.15 * SPEED.lateral_accel_mps2


@pytest.mark.parametrize("cap_mps", [0.5, 2.0, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("start_mps", [0.0, 1.0])
def test_the_speed_reaches_its_cap_and_never_overshoots_it(cap_mps, start_mps):
    run = ride(tracking(speed_control(), cap_mps), start_mps, cap_mps + 12.0)
    assert max(run.speed_mps) <= max(cap_mps, start_mps) + 0.01
    assert run.speed_mps[-1] == pytest.approx(cap_mps, abs=0.01)


def test_a_lower_cap_is_reached_from_above_within_the_braking_limit():
    run = ride(tracking(speed_control(0.0), 3.0), 12.0, 14.0)
    assert run.speed_mps[-1] == pytest.approx(3.0, abs=0.02)
    assert min(run.speed_mps) >= 3.0 - 0.02
    assert min(run.demand_mps2) >= -SPEED.max_decel_mps2 - 0.05


@pytest.mark.parametrize("rate_mps2", [-2.0, -1.0, 0.7])
def test_a_cap_that_falls_steadily_is_followed_without_lag_and_a_rising_one_from_below(rate_mps2):
    start_mps = 12.0 if rate_mps2 < 0 else 2.0
    run = ride(tracking(speed_control(0.0), lambda t: start_mps + rate_mps2 * t), start_mps, 5.0)
    lag = [v - (start_mps + rate_mps2 * (n + 1) * DT_S) for n, v in enumerate(run.speed_mps)]
    behind_mps = 0.0 if rate_mps2 < 0 else -rate_mps2 * 3.0 * (LAG_S + DT_S)
    assert lag[-1] == pytest.approx(behind_mps, abs=0.1)
    assert max(map(abs, lag)) <= 0.52 * abs(rate_mps2)  # without the rate: 1.25·|rate|


@pytest.mark.parametrize("step_mps", [-1.0, -0.5, 0.5, 1.0])
def test_a_string_of_cap_steps_is_followed_without_swinging(step_mps):
    """One step in two seconds, as fear rises and falls: never more than 2 cm/s beyond the next."""
    start_mps = 12.0 if step_mps < 0 else 4.0
    sign = math.copysign(1.0, step_mps)

    def cap(t):
        return start_mps + step_mps * min(6, math.floor(t / 2.0))

    run = ride(tracking(speed_control(0.0), cap), start_mps, 20.0)
    beyond = [sign * (v - cap((n + 1) * DT_S)) for n, v in enumerate(run.speed_mps)]
    assert max(beyond) <= 0.02
    assert run.speed_mps[-1] == pytest.approx(start_mps + 6 * step_mps, abs=0.02)


@pytest.mark.parametrize("cap_mps", [0.4, 1.0, 5.0])
def test_a_cap_that_rises_again_does_not_drive_the_car_beyond_it(cap_mps):
    """A cap of zero for one decision, as of a frame without a lane, and back by 1 m/s²."""

    def cap(t):
        return cap_mps if t < 2.0 else min(t - 2.0, cap_mps)

    run = ride(tracking(speed_control(0.0), cap), cap_mps, cap_mps + 8.0)
    assert max(run.speed_mps) <= cap_mps + 0.01
    rising = [
        (v, demand)
        for n, (v, demand) in enumerate(zip(run.speed_mps, run.demand_mps2[1:], strict=False))
        if n * DT_S > 2.3 and v > cap((n + 1) * DT_S) + 0.01
    ]
    assert all(demand <= 0.01 for _, demand in rising)
    assert run.speed_mps[-1] == pytest.approx(cap_mps, abs=0.01)


def follow(leader, seconds, *, gap_m, speed_mps, time_gap_s=1.5, standstill_m=3.0, decel_mps2=2.0):
    """(gap, speed) behind ``leader(t)`` at the speed cap of following, at 25 Hz and 60 ms late."""
    control, gaps, caps = speed_control(0.0), [gap_m], []

    def demand(v, t):
        gaps.append(gaps[-1] + (leader(t) - v) * DT_S)
        if round(t / DT_S) % 2 == 0:
            free_m = max(0.0, gaps[-1] - standstill_m)
            braking_mps = math.sqrt(leader(t) ** 2 + 2 * decel_mps2 * free_m)
            caps.append(min(free_m / time_gap_s, braking_mps, 20.0))
        return control.track(Target(caps[max(0, len(caps) - 3)], None), speed_mps=v, dt_s=DT_S)

    return gaps, ride(demand, speed_mps, seconds)


def test_behind_a_leader_that_slows_down_the_gap_settles_without_swinging():
    gaps, run = follow(lambda t: max(6.0, 10.0 - 2.0 * max(0.0, t - 2.0)), 30.0, gap_m=18.0, speed_mps=10.0)
    assert gaps[-1] == pytest.approx(3.0 + 1.5 * 6.0, abs=0.1)
    assert min(run.speed_mps) >= 6.0 - 0.25
    assert min(gaps) >= gaps[-1] - 0.4
    turns = sum(1 for a, b in zip(run.speed_mps[200:], run.speed_mps[201:], strict=False) if b > a + 1e-3)
    assert turns <= 150  # comes up once after the dip and stays


@pytest.mark.parametrize("brakes_mps2", [2.0, 4.0])
def test_behind_a_leader_that_brakes_to_a_stop_it_stops_in_time(brakes_mps2):
    gaps, run = follow(
        lambda t: max(0.0, 10.0 - brakes_mps2 * max(0.0, t - 1.0)), 25.0, gap_m=18.0, speed_mps=10.0
    )
    assert run.speed_mps[-1] == 0.0
    assert min(gaps) >= 1.0


@given(st.lists(st.tuples(st.floats(0, 30), st.floats(0, 30)), min_size=2, max_size=30))
def test_the_demand_never_changes_faster_than_its_jerk(targets):
    control = speed_control()
    last = control.accel_mps2
    for cap_mps, speed_mps in targets:
        if cap_mps <= CAR.standstill_mps:
            continue
        control.track(Target(cap_mps, None), speed_mps=speed_mps, dt_s=DT_S)
        wanted = control.accel_mps2
        assert -SPEED.brake_jerk_mps3 * DT_S <= wanted - last + 1e-12
        assert wanted - last <= SPEED.jerk_mps3 * DT_S + 1e-12
        last = wanted


@pytest.mark.parametrize("how", [Stop.COMFORT, Stop.EMERGENCY])
@pytest.mark.parametrize("start_mps", [0.3, 5.0, 30.0])
def test_a_stop_reaches_standstill_within_its_deceleration_and_holds(how, start_mps):
    profile = profile_of(how)
    braking_s = start_mps / profile.decel_mps2 + 4.0
    run = ride(stopping(speed_control(0.8), how), start_mps, braking_s + 2.0, accel_mps2=0.8)
    assert all(-max(profile.decel_mps2, SPEED.hold_decel_mps2) - 0.06 <= a <= 0.0 for a in run.demand_mps2)
    assert run.speed_mps.count(0.0) * DT_S >= 1.5
    assert (run.speed_mps[-1], run.demand_mps2[-1]) == (0.0, pytest.approx(-SPEED.hold_decel_mps2, abs=0.06))


@pytest.mark.parametrize("how", [Stop.COMFORT, Stop.EMERGENCY])
@pytest.mark.parametrize("start_mps", [1.0, 5.0, 8.94, 20.0, 30.0])
def test_a_stop_takes_the_distance_and_the_time_of_its_closed_form(how, start_mps):
    """The drive's lag shifts the whole profile by itself."""
    metres, seconds = profile_of(how).metres_and_seconds(start_mps)
    run = ride(stopping(speed_control(0.0), how), start_mps, seconds + 2.0)
    assert run.metres == pytest.approx(metres + start_mps * (LAG_S - DT_S / 2), abs=0.05 + 0.002 * start_mps)
    assert run.speed_mps.index(0.0) * DT_S == pytest.approx(seconds + LAG_S, abs=0.15)


@pytest.mark.parametrize("how", [Stop.COMFORT, Stop.EMERGENCY])
def test_the_jerk_of_a_stop_is_its_profile_s_and_the_lurch_at_the_end_that_of_the_last_deceleration(how):
    profile = profile_of(how)
    run = ride(stopping(speed_control(0.0), how), 8.0, 12.0)
    rolling = run.accel_mps2[: run.speed_mps.index(0.0)]
    jerks = [abs(b - a) / DT_S for a, b in pairwise(rolling)]
    assert max(jerks) <= profile.jerk_mps3 * 1.02
    assert -rolling[-1] <= profile.final_decel_mps2 + 0.04 * profile.jerk_mps3


@pytest.mark.parametrize("grade", [-0.08, 0.08])
def test_on_a_hill_the_speed_is_held_and_a_stop_takes_as_long_as_on_the_level(grade):
    hill = -9.81 * grade
    control = speed_control(0.0)
    held = ride(tracking(control, 8.0), 8.0, 12.0, hill_mps2=hill)
    assert held.speed_mps[-1] == pytest.approx(8.0, abs=0.02)  # without the load: 1 m/s off
    assert max(abs(v - 8.0) for v in held.speed_mps) <= 0.65
    assert control._load.load_mps2 == pytest.approx(hill, abs=0.03)
    stop = ride(stopping(control, Stop.COMFORT), held.speed_mps[-1], 14.0, accel_mps2=-hill, hill_mps2=hill)
    level = ride(stopping(speed_control(0.0), Stop.COMFORT), 8.0, 14.0)
    more_m = stop.metres - level.metres
    assert abs(more_m) <= 0.3 if grade < 0 else -10.0 <= more_m <= 0.0  # uphill the brake does half at least
    assert stop.demand_mps2[-1] <= -SPEED.hold_decel_mps2 - abs(hill) + 0.1


def test_a_brake_of_another_source_is_not_taken_as_a_hill():
    observer = LoadObserver(LAG_S, limit_mps2=1.5)
    speed_mps = 15.0
    for _ in range(200):
        speed_mps -= 3.5 * DT_S
        observer.step(0.0, speed_mps=speed_mps, dt_s=DT_S)
    assert abs(observer.load_mps2) <= 1.5
    for _ in range(300):
        observer.step(0.0, speed_mps=speed_mps, dt_s=DT_S)
    assert abs(observer.load_mps2) <= 0.05


def test_without_a_speed_the_brake_stays_applied():
    control = speed_control()
    for _ in range(100):
        demand = control.stop(Stop.COMFORT, speed_mps=None, dt_s=DT_S)
    assert demand == -SPEED.comfort.decel_mps2


def test_a_cap_of_zero_stops_at_least_as_hard_as_a_comfort_stop():
    """And no softer than a cap of nearly zero would: a leader that stands is no reason to brake less."""
    at_zero, nearly = (
        ride(tracking(speed_control(0.5), cap), 5.0, 8.0, accel_mps2=0.5) for cap in (0.0, 0.06)
    )
    comfort = ride(stopping(speed_control(0.5), Stop.COMFORT), 5.0, 8.0, accel_mps2=0.5)
    assert at_zero.metres <= min(comfort.metres, nearly.metres) + 0.05
    assert at_zero.speed_mps[-1] == 0.0


def test_the_identified_load_is_reset_after_a_driver():
    control = speed_control(0.0)
    ride(tracking(control, 8.0), 8.0, 5.0)
    for n in range(100):
        assert control.release() == 0.0
        control._observe(8.0 - 0.03 * n, DT_S)
    assert abs(control._load.load_mps2) <= 0.6


def test_a_tuning_that_would_overshoot_is_refused():
    with pytest.raises(ValidationError, match="overshoot"):
        SpeedSettings.model_validate(SPEED.model_dump() | {"gain_1ps": 4.0})
