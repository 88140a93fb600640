"""The limiter: bounded for any input, a stop without usable inputs, never an empty feasible set."""

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limiter_rig import SHIPPED, state
from message_rig import SHUTTLE, command, vehicle

from controller.limiter import Limiter, build
from controller.model.bicycle import angle_from_curvature, critical_speed, curvature_from_angle
from trepid.messages import Command

DT_S = 0.01
# The full limits: shares of 1, no fading in, no driver override by deviation.
NO_HANDS = SHIPPED.override.model_copy(update=dict(fade_in_s=1e-9, angle_rad=9.0))
LIMITS = SHIPPED.model_copy(update=dict(lateral_accel_share=1.0, lateral_jerk_share=1.0, override=NO_HANDS))
RATE = SHUTTLE.max_road_wheel_rate_radps
AY, JERK = LIMITS.lateral_accel_mps2, LIMITS.lateral_jerk_mps3


def limiter(car=SHUTTLE):
    return Limiter(car, LIMITS)


def curvature(angle_rad, speed_mps, car=SHUTTLE):
    return curvature_from_angle(angle_rad, speed_mps=speed_mps, vehicle=car)


def lateral(angle_rad, speed_mps):
    return curvature(angle_rad, speed_mps) * speed_mps**2


def angle_for(lateral_mps2, speed_mps, car=SHUTTLE):
    return angle_from_curvature(lateral_mps2 / speed_mps**2, speed_mps=speed_mps, vehicle=car)


def run(one, seconds, requested=None, known=None, from_s=0.0):
    """Outputs while ``requested(t)`` and ``known(t)`` are fresh at every step."""
    requested = requested or command
    known = known or state
    times = [from_s + DT_S * n for n in range(round(seconds / DT_S))]
    return [one.step(requested(t), t, known(t), now_s=t) for t in times]


def test_a_calm_command_passes_unchanged():
    requested = command(0.0, road_wheel_angle_rad=0.0, accel_mps2=0.5)
    assert limiter().step(requested, 0.0, state(), now_s=0.0) == requested


moves = st.tuples(
    st.floats(-2.0, 2.0),  # wanted angle
    st.floats(0.0, 40.0),  # speed
    st.floats(0.0, 0.2),  # time since the last step
)


@settings(max_examples=200)
@given(st.floats(-0.55, 0.55), st.lists(moves, min_size=1, max_size=12))
def test_for_any_speed_the_wheel_is_within_its_limits_and_moves_towards_less_acceleration(start_rad, scenes):
    one, now_s = limiter(), 0.0
    last = one.step(
        command(road_wheel_angle_rad=start_rad), 0.0, state(road_wheel_angle_rad=start_rad), now_s=0.0
    ).road_wheel_angle_rad
    for wanted, speed, pause in scenes:
        now_s += pause
        out = one.step(
            command(now_s, road_wheel_angle_rad=wanted, accel_mps2=1.0),
            now_s,
            state(now_s, speed_mps=speed),
            now_s=now_s,
        )
        angle, reach = out.road_wheel_angle_rad, RATE * min(pause, LIMITS.max_step_s)
        assert abs(angle) <= SHUTTLE.max_road_wheel_angle_rad
        assert abs(angle - last) <= reach + 1e-12
        if abs(lateral(angle, speed)) > AY + 1e-9:
            assert angle == pytest.approx(last - math.copysign(reach, angle), abs=1e-12)
            assert out.accel_mps2 <= -LIMITS.comfort_decel_mps2
        last = angle


@given(st.floats(-2.0, 2.0), st.floats(1.0, 40.0), st.floats(-1.0, 1.0))
def test_at_constant_speed_acceleration_and_jerk_are_never_exceeded(wanted, speed, start_share):
    start = angle_for(start_share * AY, speed)
    start = max(-0.55, min(0.55, start))
    one = limiter()
    last = lateral(start, speed)
    for n in range(30):
        t = DT_S * n
        known = state(t, speed_mps=speed, road_wheel_angle_rad=start)
        out = one.step(command(t, road_wheel_angle_rad=wanted), t, known, now_s=t)
        now = lateral(out.road_wheel_angle_rad, speed)
        assert abs(now) <= AY + 1e-9
        assert abs(now - last) <= JERK * DT_S + 1e-9
        last = now


@pytest.mark.parametrize("sign", [1, -1])
def test_accelerating_in_a_bend_counts_into_the_jerk(sign):
    """The jerk due to the change of speed reduces the jerk left to the wheel."""
    one, accel, speed = limiter(), 4.0, 20.0
    start = angle_for(sign * 0.6 * AY / 3.0, speed)
    one.step(
        command(road_wheel_angle_rad=start),
        0.0,
        state(speed_mps=speed, road_wheel_angle_rad=start),
        now_s=0.0,
    )
    last = lateral(start, speed)
    for n in range(1, 20):
        t = DT_S * n
        known = state(t, speed_mps=speed + accel * t)
        out = one.step(command(t, road_wheel_angle_rad=sign * 0.5), t, known, now_s=t)
        now = lateral(out.road_wheel_angle_rad, speed + accel * t)
        assert 0.9 * JERK * DT_S < abs(now - last) <= JERK * DT_S  # understeer gives a little of 2·v·a·κ back
        last = now


def test_acceleration_comes_before_jerk_and_the_brake_is_applied():
    """A jump of the measured speed puts the car at 4 m/s²: it unwinds at full wheel rate, for any jerk."""
    one = limiter()
    start = angle_for(2.5, 10.0)
    run(one, 0.05, lambda t: command(t, road_wheel_angle_rad=start), lambda t: state(t, speed_mps=10.0))
    one = limiter()
    one.step(
        command(road_wheel_angle_rad=start), 0.0, state(speed_mps=10.0, road_wheel_angle_rad=start), now_s=0.0
    )
    out = one.step(
        command(DT_S, road_wheel_angle_rad=start, accel_mps2=1.0),
        DT_S,
        state(DT_S, speed_mps=13.0),
        now_s=DT_S,
    )
    assert out.road_wheel_angle_rad == pytest.approx(start - RATE * DT_S)
    assert out.accel_mps2 == -LIMITS.comfort_decel_mps2


def test_a_bend_too_tight_for_the_speed_brakes_and_one_that_fits_does_not():
    for ratio, accel in ((0.98, 1.0), (1.02, -LIMITS.comfort_decel_mps2)):
        requested = command(road_wheel_angle_rad=angle_for(ratio * AY, 10.0), accel_mps2=1.0)
        assert limiter().step(requested, 0.0, state(speed_mps=10.0), now_s=0.0).accel_mps2 == accel


def test_a_slower_wheel_is_granted_and_a_faster_one_is_not():
    for asked_rate, rate in ((0.1, 0.1), (9.0, RATE), (0.0, RATE), (-1.0, RATE)):
        requested = lambda t, r=asked_rate: command(t, road_wheel_angle_rad=0.5, road_wheel_rate_radps=r)  # noqa: E731
        out = run(limiter(), 0.11, requested, lambda t: state(t, speed_mps=0.0))
        assert out[-1].road_wheel_angle_rad == pytest.approx(rate * 0.1)


def test_at_standstill_the_wheel_may_turn_to_its_stop():
    out = run(
        limiter(), 2.0, lambda t: command(t, road_wheel_angle_rad=3.0), lambda t: state(t, speed_mps=0.0)
    )
    assert out[-1].road_wheel_angle_rad == SHUTTLE.max_road_wheel_angle_rad


@pytest.mark.parametrize(
    "requested,given_out", [(9.0, LIMITS.max_accel_mps2), (-9.0, -LIMITS.max_decel_mps2), (-0.3, -0.3)]
)
def test_drive_and_brakes_are_bounded(requested, given_out):
    assert limiter().step(command(accel_mps2=requested), 0.0, state(), now_s=0.0).accel_mps2 == given_out


@pytest.mark.parametrize("frame_s", [None, -0.6, 0.2])
def test_a_command_on_no_old_or_future_frame_brakes_at_least_gently(frame_s):
    for requested, accel in ((1.0, -LIMITS.comfort_decel_mps2), (-2.0, -2.0)):
        out = limiter().step(command(t_s=frame_s, accel_mps2=requested), 0.0, state(), now_s=0.0)
        assert out.accel_mps2 == accel
        assert out.t_s == frame_s


def test_until_the_first_command_it_brakes_gently_then_stops():
    one = limiter()
    out = [one.step(None, None, state(DT_S * n), now_s=DT_S * n) for n in range(40)]
    assert {c.accel_mps2 for c in out[:30]} == {-LIMITS.comfort_decel_mps2}
    assert out[-1].accel_mps2 == -LIMITS.stop_decel_mps2
    assert one.stopping
    assert out[-1].t_s is None


def turning(one, speed_mps=10.0, seconds=1.0):
    """Into a bend of 1 m/s²; returns its angle and the time after that."""
    angle = angle_for(1.0, speed_mps)
    run(
        one,
        seconds,
        lambda t: command(t, road_wheel_angle_rad=angle, accel_mps2=0.5),
        lambda t: state(t, speed_mps=speed_mps, road_wheel_angle_rad=angle),
    )
    return angle, seconds


def test_when_commands_cease_the_limiter_stops_the_car_on_the_last_curvature():
    one = limiter()
    angle, now_s = turning(one)
    last = command(now_s - DT_S, road_wheel_angle_rad=angle, accel_mps2=0.5)
    accels, speed = [], 10.0
    for n in range(500):
        t = now_s + DT_S * n
        out = one.step(last, now_s - DT_S, state(t, speed_mps=speed), now_s=t)
        accels.append(out.accel_mps2)
        speed = max(0.0, speed + DT_S * out.accel_mps2)
    assert accels[int((LIMITS.command_late_s - 0.03) / DT_S)] == 0.5
    assert accels[int((LIMITS.command_timeout_s - 0.03) / DT_S)] == -LIMITS.comfort_decel_mps2
    assert accels[int((LIMITS.command_timeout_s + 0.01) / DT_S)] == -LIMITS.stop_decel_mps2
    assert speed == 0.0
    assert curvature(out.road_wheel_angle_rad, 0.0) == pytest.approx(curvature(angle, 10.0), rel=0.01)
    assert (out.accel_mps2, out.speed_mps) == (-LIMITS.stop_decel_mps2, 0.0)


@pytest.mark.parametrize(
    ("speed_mps", "goal_mps", "frame_age_s", "accel_mps2", "out"),
    [
        (5.0, 9.0, 0.0, 1.0, (1.0, 9.0)),  # within the limits: as demanded
        (5.0, 9.0, 1.0, 1.0, (-1.0, 4.0)),  # old frame: comfort brake
        (5.0, 3.0, 1.0, 1.0, (-1.0, 3.0)),
        (0.5, 9.0, 1.0, 1.0, (-1.0, 0.0)),
        (5.0, 9.0, 0.0, 3.0, (1.5, 6.5)),
        (None, 9.0, 0.0, 1.0, (-1.0, 0.0)),
    ],
)
def test_where_the_acceleration_is_limited_so_is_the_target_speed(
    speed_mps, goal_mps, frame_age_s, accel_mps2, out
):
    """For cars that follow the speed of a command and not its acceleration."""
    order = command(10.0 - frame_age_s, speed_mps=goal_mps, accel_mps2=accel_mps2)
    given = limiter().step(order, 10.0, state(10.0, speed_mps=speed_mps), now_s=10.0)
    assert (given.accel_mps2, given.speed_mps) == out


def test_the_limited_target_speed_is_that_of_the_response_time_later(monkeypatch):
    monkeypatch.setattr("controller.limiter.limiter.SOON_S", 2.0)
    order = command(9.0, speed_mps=9.0, accel_mps2=1.0)  # of an old frame: comfort brake
    given = limiter().step(order, 10.0, state(10.0, speed_mps=5.0), now_s=10.0)
    assert (given.accel_mps2, given.speed_mps) == (-1.0, 5.0 - 1.0 * 2.0)


def test_a_wheel_is_seen_from_the_first_plausible_state_on():
    one = limiter()
    assert not one.has_seen_wheel
    one.step(command(), 0.0, None, now_s=0.0)
    assert not one.has_seen_wheel
    one.step(command(), 0.0, state(0.01), now_s=0.01)
    one.step(command(), 0.0, None, now_s=0.02)
    assert one.has_seen_wheel


def test_the_stop_is_steered_but_not_ended_by_new_commands():
    one = limiter()
    _, now_s = turning(one)
    now_s += 0.5
    assert one.step(None, None, state(now_s, speed_mps=8.0), now_s=now_s).accel_mps2 < 0
    requested = lambda t: command(t, road_wheel_angle_rad=0.0, accel_mps2=1.0)  # noqa: E731
    moving = run(one, 1.0, requested, lambda t: state(t, speed_mps=3.0), from_s=now_s)
    assert {c.accel_mps2 for c in moving} == {-LIMITS.stop_decel_mps2}
    assert moving[-1].road_wheel_angle_rad == 0.0
    standing = run(one, 0.02, requested, lambda t: state(t, speed_mps=0.0), from_s=now_s + 1.0)
    assert standing[-1].accel_mps2 == 1.0
    assert not one.stopping


def test_at_standstill_it_keeps_braking_while_nothing_comes():
    one = limiter()
    run(one, 0.1, known=lambda t: state(t, speed_mps=0.0))
    out = [one.step(None, None, state(t, speed_mps=0.0), now_s=t) for t in (1.0, 2.0, 3.0)]
    assert all(c.accel_mps2 < 0 for c in out)


BAD = (math.nan, math.inf, -math.inf)
COMMAND_NUMBERS = [f.name for f in fields(Command)]
STATE_NUMBERS = ("t_s", "speed_mps", "road_wheel_angle_rad", "yaw_rate_radps")


@pytest.mark.parametrize("name", COMMAND_NUMBERS)
@pytest.mark.parametrize("value", BAD)
def test_a_command_that_is_not_finite_stops_the_car(name, value):
    one = limiter()
    angle, now_s = turning(one)
    bad = replace(command(now_s, accel_mps2=1.0), **{name: value})
    out = one.step(bad, now_s, state(now_s, speed_mps=10.0), now_s=now_s)
    assert out.accel_mps2 == -LIMITS.stop_decel_mps2
    assert out.road_wheel_angle_rad == pytest.approx(angle)
    assert out.speed_mps == 0.0
    assert out.t_s is None
    assert one.stopping


@pytest.mark.parametrize("received_s", [None, math.nan, math.inf, 5.0])
def test_a_command_with_an_impossible_arrival_stops_the_car(received_s):
    one = limiter()
    _, now_s = turning(one)
    one.step(command(now_s), received_s, state(now_s), now_s=now_s)
    assert one.stopping


@pytest.mark.parametrize(
    "known",
    [
        None,
        *({name: value} for name in STATE_NUMBERS for value in BAD),
        {"speed_mps": None},
        {"road_wheel_angle_rad": None},
        {"speed_mps": 200.0},
        {"road_wheel_angle_rad": -1.5},
        {"t_s": 0.7},
    ],
    ids=str,
)
def test_without_a_plausible_state_it_brakes_holds_the_wheel_and_after_a_while_stops(known):
    one = limiter()
    angle, now_s = turning(one)
    out = []
    for n in range(40):
        t = now_s + DT_S * n
        bad = None if known is None else replace(state(t, speed_mps=10.0), **known)
        out.append(one.step(command(t, accel_mps2=1.0), t, bad, now_s=t))
    assert out[0].accel_mps2 == -LIMITS.comfort_decel_mps2
    assert out[-1].accel_mps2 == -LIMITS.stop_decel_mps2
    assert [c.road_wheel_angle_rad for c in out] == pytest.approx([angle] * len(out))


def test_without_any_wheel_angle_the_limiter_keeps_the_wheel_straight():
    assert limiter().step(command(road_wheel_angle_rad=0.3), 0.0, None, now_s=0.0).road_wheel_angle_rad == 0.0


def test_an_unknown_yaw_rate_is_no_fault():
    assert (
        limiter().step(command(accel_mps2=1.0), 0.0, state(yaw_rate_radps=None), now_s=0.0).accel_mps2 == 1.0
    )


def test_the_driver_gets_the_car_at_once_and_gives_it_back_without_a_step():
    one = limiter()
    _, now_s = turning(one)
    wheel = -0.1
    for n in range(20):
        t = now_s + DT_S * n
        driver = state(t, speed_mps=6.0, road_wheel_angle_rad=wheel, driver_override=True)
        out = one.step(command(t, road_wheel_angle_rad=0.2, accel_mps2=-2.0), t, driver, now_s=t)
        assert (out.road_wheel_angle_rad, out.speed_mps) == (wheel, 6.0)
    assert out.accel_mps2 == 0.0
    t += DT_S
    back = one.step(command(t, road_wheel_angle_rad=0.2), t, state(t, speed_mps=6.0), now_s=t)
    assert 0.0 < back.road_wheel_angle_rad - wheel <= RATE * DT_S + 1e-12
    assert abs(lateral(back.road_wheel_angle_rad, 6.0) - lateral(wheel, 6.0)) <= JERK * DT_S + 1e-9


def test_the_driver_ends_a_stop():
    one = limiter()
    one.step(command(accel_mps2=math.nan), 0.0, state(), now_s=0.0)
    assert one.stopping
    one.step(None, None, state(DT_S, driver_override=True), now_s=DT_S)
    assert not one.stopping


def test_an_override_in_an_implausible_state_is_ignored():
    one = limiter()
    out = one.step(command(accel_mps2=1.0), 0.0, state(speed_mps=None, driver_override=True), now_s=0.0)
    assert out.accel_mps2 < 0.0


def test_a_long_pause_or_a_clock_that_runs_backwards_opens_no_limit():
    one = limiter()
    run(one, 0.05, known=lambda t: state(t, speed_mps=0.0))
    for now_s, reach in ((10.0, RATE * LIMITS.max_step_s), (9.0, 0.0)):
        before = one.step(command(now_s), now_s, state(now_s, speed_mps=0.0), now_s=now_s)
        assert before.road_wheel_angle_rad == 0.0
        after_s = now_s + (5.0 if reach else -5.0)
        out = one.step(
            command(after_s, road_wheel_angle_rad=0.5), after_s, state(after_s, speed_mps=0.0), now_s=after_s
        )
        assert out.road_wheel_angle_rad == pytest.approx(reach)
        one = limiter()


OVERSTEER = vehicle(understeer_gradient_rad_per_mps2=-0.00356)


@given(st.floats(-0.55, 0.55), st.floats(-0.55, 0.55), st.floats(0.0, 60.0))
def test_an_oversteering_car_unwinds_too_and_gets_bounded_commands_at_any_speed(start, wanted, speed):
    one = limiter(OVERSTEER)
    last = start
    for n in range(5):
        t = DT_S * n
        known = state(t, speed_mps=speed, road_wheel_angle_rad=start)
        angle = one.step(command(t, road_wheel_angle_rad=wanted), t, known, now_s=t).road_wheel_angle_rad
        assert abs(angle - last) <= RATE * DT_S + 1e-12
        trusted = min(speed, 0.95 * critical_speed(OVERSTEER))
        steady = curvature(angle, trusted, OVERSTEER)
        if steady is None or abs(steady) * speed**2 > AY + 1e-9:
            assert n == 0 or abs(angle) < abs(last)
        last = angle


numbers = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-5.0, 5.0))


@settings(max_examples=200)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.none(), st.tuples(*(numbers,) * 6)),
            st.one_of(st.none(), numbers),
            st.one_of(st.none(), st.tuples(*(st.one_of(st.none(), numbers),) * 3, st.booleans())),
            st.floats(0.0, 0.3),
        ),
        min_size=1,
        max_size=6,
    )
)
def test_any_input_gives_a_bounded_command(scenes):
    one, now_s = limiter(), 0.0
    for requested, received_s, known, pause in scenes:
        now_s += pause
        out = one.step(
            None if requested is None else Command(**dict(zip(COMMAND_NUMBERS, requested, strict=True))),
            received_s,
            None
            if known is None
            else state(
                now_s,
                speed_mps=known[0],
                road_wheel_angle_rad=known[1],
                yaw_rate_radps=known[2],
                driver_override=known[3],
            ),
            now_s=now_s,
        )
        assert abs(out.road_wheel_angle_rad) <= SHUTTLE.max_road_wheel_angle_rad
        assert -LIMITS.max_decel_mps2 <= out.accel_mps2 <= LIMITS.max_accel_mps2
        assert math.isfinite(out.speed_mps)
        assert out.t_s is None or math.isfinite(out.t_s)
        if requested is None or not all(map(math.isfinite, requested)):
            assert out.accel_mps2 <= 0.0


signed = st.floats(-1.0, 1.0)


@given(st.lists(st.tuples(signed, signed, st.floats(0.0, 30.0)), min_size=1, max_size=10))
def test_the_mirrored_world_gets_the_mirrored_command(scenes):
    left, right = limiter(), limiter()
    for n, (wanted, wheel, speed) in enumerate(scenes):
        t = DT_S * n
        out = [
            one.step(
                command(t, road_wheel_angle_rad=sign * wanted, accel_mps2=1.0),
                t,
                state(t, speed_mps=speed, road_wheel_angle_rad=sign * wheel),
                now_s=t,
            )
            for one, sign in ((left, 1), (right, -1))
        ]
        assert out[0].road_wheel_angle_rad == -out[1].road_wheel_angle_rad
        assert out[0].accel_mps2 == out[1].accel_mps2


def test_the_shipped_limits_are_those_of_the_standards():
    assert build().step(command(), 0.0, state(), now_s=0.0) == command()
    assert (AY, JERK, LIMITS.max_decel_mps2) == (3.0, 5.0, 4.0)
