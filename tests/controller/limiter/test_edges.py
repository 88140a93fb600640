"""The limiter's step in closed form: the result of each limit where it alone is active."""

import math

import pytest
from limiter_rig import AT_ONCE, DT_S, EXACT, limiter, seen_state, state
from message_rig import SHUTTLE, command, vehicle

from controller.limiter.turn import Excess, SteadyTurn
from trepid.causes import NO_COMMAND, NO_SPEED

TURN = SteadyTurn(SHUTTLE)
QUICK = vehicle(max_road_wheel_rate_radps=1e6)  # the wheel goes anywhere at once, ...
ANY_JERK = AT_ONCE.model_copy(update=dict(lateral_jerk_mps3=1e6))  # ... and the jerk does not matter
LATE_S = SHUTTLE.steering_delay_s + SHUTTLE.steering_lag_s
AY = AT_ONCE.lateral_accel_mps2


def edge_rad(speed_mps, lateral_mps2=AY):
    """The angle of a turn of ``lateral_mps2``."""
    return TURN.angle_rad(lateral_mps2 / speed_mps**2, speed_mps)


def step_fresh(one, now_s, *, wanted=0.0, accel=0.0, speed=10.0, **changes):
    """One step with everything fresh."""
    requested = command(now_s, road_wheel_angle_rad=wanted, accel_mps2=accel)
    return one.step(requested, now_s, state(now_s, speed_mps=speed, **changes), now_s=now_s)


def test_the_first_state_is_neither_stopped_nor_handed_over_nor_saturated():
    one = limiter()
    assert (one.stopping, one.handed_over, one.is_saturated) == (False, False, False)
    assert one.stopping is one.handed_over is one.is_saturated is False
    assert one.step(None, None, None, now_s=0.0).road_wheel_angle_rad == 0.0


def test_the_report_carries_override_and_saturation_and_keeps_the_rest_of_the_state():
    one, reported = limiter(EXACT), state(3.0, speed_mps=7.0, driver_torque_nm=0.5)
    step_fresh(one, 0.0)
    assert one.report(reported) == state(3.0, speed_mps=7.0, driver_torque_nm=0.5, saturated=False)
    for n in range(80):
        step_fresh(one, n / 64, wanted=0.5)
    assert one.is_saturated
    assert one.report(reported).saturated is True
    step_fresh(one, 1.5, driver_override=True)
    assert one.report(reported).driver_override is True
    assert one.handed_over is True


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_angle_is_that_of_the_limit_at_the_speed_to_come(sign):
    """A drive of 1.2 m/s² makes 0.18 m/s while the wheel follows."""
    out = step_fresh(limiter(ANY_JERK, QUICK), 0.0, wanted=sign * 0.99 * edge_rad(10.0), accel=1.2)
    assert out.accel_mps2 == 1.2
    still = step_fresh(limiter(ANY_JERK, QUICK), 0.0, wanted=sign * 2.0)
    assert still.road_wheel_angle_rad == 0.0  # a first step has no time to move the wheel
    one = limiter(ANY_JERK, QUICK)
    step_fresh(one, 0.0, accel=1.2)
    out = step_fresh(one, DT_S, wanted=sign * 0.99 * edge_rad(10.0), accel=1.2)
    assert out.road_wheel_angle_rad == pytest.approx(sign * edge_rad(10.0 + 1.2 * LATE_S), rel=1e-12)
    assert out.accel_mps2 == 1.2


@pytest.mark.parametrize("accel", [0.0, -0.5])
def test_without_drive_the_speed_to_come_is_that_of_now(accel):
    one = limiter(ANY_JERK, QUICK)
    step_fresh(one, 0.0, accel=accel)
    out = step_fresh(one, DT_S, wanted=2.0, accel=accel)
    assert out.road_wheel_angle_rad == pytest.approx(edge_rad(10.0), rel=1e-12)
    assert out.accel_mps2 == -1.0


def test_a_drive_just_let_go_still_makes_speed():
    """It follows with a lag of first order: after n steps of 1.2 m/s², 1.2·(1 - (1 - dt/(τ + dt))ⁿ)."""
    one = limiter(ANY_JERK, QUICK)
    step_fresh(one, 0.0, accel=1.2)  # no time has passed: the drive has no effect yet
    for n in range(1, 21):
        step_fresh(one, n * DT_S, accel=1.2)
    gaining = 1.2 * (1.0 - (1.0 - DT_S / (SHUTTLE.accel_lag_s + DT_S)) ** 20)
    assert 0.5 < gaining < 1.0
    out = step_fresh(one, 21 * DT_S, wanted=0.99 * edge_rad(10.0), accel=-0.5)
    assert out.road_wheel_angle_rad == pytest.approx(edge_rad(10.0 + gaining * LATE_S), rel=1e-12)


def test_a_drive_without_lag_follows_at_once_and_with_no_time_not_at_all():
    prompt = vehicle(max_road_wheel_rate_radps=1e6, accel_lag_s=0.0)
    one = limiter(ANY_JERK, prompt)
    step_fresh(one, 0.0, accel=1.2)
    step_fresh(one, DT_S, accel=1.2)
    out = step_fresh(one, 2 * DT_S, wanted=0.99 * edge_rad(10.0), accel=-0.5)
    assert out.road_wheel_angle_rad == pytest.approx(edge_rad(10.0 + 1.2 * LATE_S), rel=1e-12)
    one = limiter(ANY_JERK, prompt)
    step_fresh(one, 0.0, accel=1.2)
    out = step_fresh(one, DT_S, wanted=0.99 * edge_rad(10.0), accel=-0.5)
    assert out.road_wheel_angle_rad == pytest.approx(0.99 * edge_rad(10.0), rel=1e-12)


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_excess_of_the_yaw_rate_narrows_its_own_side_only(sign):
    yaw_rate_radps = sign * 0.02
    excess = Excess(TURN, ANY_JERK)
    excess.step(seen_state(speed_mps=10.0, yaw_rate_radps=yaw_rate_radps), 0.0)
    e_mps2 = abs(excess.step(seen_state(speed_mps=10.0, yaw_rate_radps=yaw_rate_radps), DT_S))
    assert 0.3 < e_mps2 < 1.0
    for side, lateral_mps2 in ((sign, AY - e_mps2), (-sign, AY)):
        one = limiter(ANY_JERK, QUICK)
        step_fresh(one, 0.0, yaw_rate_radps=yaw_rate_radps)
        out = step_fresh(one, DT_S, wanted=side * 2.0, yaw_rate_radps=yaw_rate_radps)
        assert out.road_wheel_angle_rad == pytest.approx(side * edge_rad(10.0, lateral_mps2), rel=1e-9)


@pytest.mark.parametrize("lateral_mps2", [-2.0, 1.0])
def test_a_bend_leaves_as_much_brake_and_drive_as_its_jerk_allows(lateral_mps2):
    """2·a·(κ·v²)/v ≤ J·v/(v + L/2); with J = 0.5 m/s³, v = 4 m/s and L/2 = 0.875 m: a ≤ 8/(9.75·κ·v²)."""
    little = AT_ONCE.model_copy(update=dict(lateral_jerk_mps3=0.5))
    most = 8.0 / (9.75 * abs(lateral_mps2))
    start = edge_rad(4.0, lateral_mps2)
    for requested in (1.4, -3.0):
        out = step_fresh(
            limiter(little), 0.0, wanted=start, accel=requested, speed=4.0, road_wheel_angle_rad=start
        )
        assert out.accel_mps2 == pytest.approx(math.copysign(most, requested), rel=1e-6)


@pytest.mark.parametrize("lateral_mps2,most", [(-2.4, 3.2), (2.4, 3.2), (0.0, 4.0)])
def test_brake_and_bend_together_are_no_more_than_the_hardest_brake(lateral_mps2, most):
    """2.4² + 3.2² = 4²."""
    start = edge_rad(10.0, lateral_mps2)
    for requested, given_out in ((-4.0, -most), (-3.0, -3.0), (1.5, 1.5)):
        one = limiter(ANY_JERK)
        out = step_fresh(one, 0.0, wanted=start, accel=requested, speed=10.0, road_wheel_angle_rad=start)
        assert out.accel_mps2 == pytest.approx(given_out, rel=1e-6)


def test_a_bend_as_hard_as_the_hardest_brake_leaves_the_comfort_brake():
    weak = ANY_JERK.model_copy(update=dict(max_decel_mps2=3.1, comfort_decel_mps2=1.5))
    for lateral_mps2, most in ((2.9, 1.5), (2.0, math.sqrt(3.1**2 - 4.0))):
        start = edge_rad(10.0, lateral_mps2)
        one = limiter(weak)
        out = step_fresh(one, 0.0, wanted=start, accel=-4.0, speed=10.0, road_wheel_angle_rad=start)
        assert out.accel_mps2 == pytest.approx(-most, rel=1e-6)


def test_in_a_bend_too_tight_for_the_speed_the_brake_is_that_of_the_limit():
    """However tight the bend: of the jerk, and of the grip."""
    little = AT_ONCE.model_copy(update=dict(lateral_jerk_mps3=1.0))
    for limits, most in (
        (little, 1.0 * 10.0 / 10.875 * 10.0 / (2.0 * AY)),
        (ANY_JERK, math.sqrt(16.0 - AY**2)),
    ):
        out = step_fresh(limiter(limits), 0.0, wanted=0.3, accel=-4.0, speed=10.0, road_wheel_angle_rad=0.3)
        assert out.accel_mps2 == pytest.approx(-most)


def test_the_wheel_is_handed_back_as_it_is_and_its_rate_grows_from_nothing():
    """At standstill only the rate limits: share n/64 of rate·dt in the n-th step of 0.5 s of 64 steps."""
    one = limiter(EXACT)
    step_fresh(one, 0.0, speed=0.0)
    for n in range(1, 100):
        step_fresh(one, n * DT_S, speed=0.0, wanted=0.0, road_wheel_angle_rad=0.2, driver_override=True)
    assert one.handed_over
    reach_rad, angle_rad = SHUTTLE.max_road_wheel_rate_radps * DT_S, 0.2
    for n in range(1, 70):
        out = step_fresh(one, (99 + n) * DT_S, speed=0.0, wanted=0.5, road_wheel_angle_rad=0.2)
        angle_rad += reach_rad * min(n / 64, 1.0)
        assert out.road_wheel_angle_rad == pytest.approx(angle_rad, rel=1e-12)


def test_when_the_driver_takes_over_drive_and_brake_fade_and_the_command_stays_that_of_its_frame():
    one = limiter(EXACT)
    step_fresh(one, 0.0, accel=-2.0)
    accels = []
    for n in range(1, 70):
        out = step_fresh(one, n * DT_S, accel=-2.0, driver_override=True, road_wheel_angle_rad=0.1, speed=6.0)
        accels.append(out.accel_mps2)
        assert (out.t_s, out.road_wheel_angle_rad, out.speed_mps) == (n * DT_S, 0.1, 6.0)
    assert accels[:2] == [-2.0 + 4.0 * DT_S, -2.0 + 8.0 * DT_S]
    assert accels[-6:] == [0.0] * 6
    one = limiter(EXACT)
    step_fresh(one, 0.0, accel=1.0)
    out = step_fresh(one, DT_S, accel=1.0, driver_override=True)
    assert out.accel_mps2 == 1.0 - 4.0 * DT_S
    assert step_fresh(limiter(EXACT), 0.0, accel=1.0, driver_override=True).accel_mps2 == 0.0


def test_the_driver_ends_a_stop_and_the_count_of_cuts_falls():
    one = limiter(EXACT)
    for n in range(80):
        step_fresh(one, n / 64, wanted=0.5)
    assert one.is_saturated
    one.step(command(accel_mps2=math.nan), 1.25, state(1.25), now_s=1.25)
    assert one.stopping is True
    step_fresh(one, 1.265625, driver_override=True)
    assert one.stopping is False
    for n in range(1, 40):
        step_fresh(one, 1.265625 + n / 64, driver_override=True)
    assert one.is_saturated is False


def test_the_driver_is_found_by_a_wheel_that_does_not_follow():
    one = limiter(EXACT)
    for n in range(16):
        step_fresh(one, n / 64)
    found = [step_fresh(one, 0.25 + n / 64, road_wheel_angle_rad=0.1) and one.handed_over for n in range(20)]
    assert found == [False] * 15 + [True] * 5
    assert step_fresh(one, 0.5625, wanted=0.3, road_wheel_angle_rad=0.12).road_wheel_angle_rad == 0.12


def test_without_a_state_the_driver_does_not_have_the_car():
    one = limiter(EXACT)
    step_fresh(one, 0.0, driver_override=True)
    assert one.handed_over is True
    one.step(command(DT_S), DT_S, None, now_s=DT_S)
    assert one.handed_over is False


def test_commands_at_too_low_a_rate_brake_the_car():
    """Required: eight commands in 0.5 s. A command arrives every 0.125 s, within the timeout."""
    one, accels = limiter(AT_ONCE.model_copy(update=dict(command_late_s=0.25))), []
    for n in range(16 * 8):
        received_s = math.floor(n / 8) * 0.125
        requested = command(received_s, accel_mps2=1.0)
        accels.append(one.step(requested, received_s, state(n / 64), now_s=n / 64).accel_mps2)
    assert accels[0] == 1.0
    assert accels[-1] == -1.0
    assert one.stopping is False


@pytest.mark.parametrize("age_s,accel", [(0.0625, 1.0), (0.0626, -1.0)])
def test_a_late_command_brakes_until_the_next_one_comes(age_s, accel):
    one = limiter()
    step_fresh(one, 0.0, accel=1.0)
    assert one.step(command(accel_mps2=1.0), 0.0, state(age_s), now_s=age_s).accel_mps2 == accel
    assert step_fresh(one, 0.125, accel=1.0, speed=5.0).accel_mps2 == 1.0
    assert one.stopping is False


@pytest.mark.parametrize("age_s,stops", [(0.25, False), (0.2501, True)])
def test_commands_are_lost_after_their_timeout(age_s, stops):
    one = limiter()
    step_fresh(one, 0.0)
    one.step(command(), 0.0, state(age_s), now_s=age_s)
    assert one.stopping is stops


@pytest.mark.parametrize("age_s,stops", [(0.125, False), (0.1251, True)])
def test_states_are_lost_after_their_timeout(age_s, stops):
    one = limiter()
    step_fresh(one, 0.0)
    one.step(command(age_s), age_s, None, now_s=age_s)
    assert one.stopping is stops


def test_the_limiter_says_why_it_stops_the_car_until_it_does_so_no_more():
    one = limiter()
    said = []
    for now_s, received_s in ((0.0, 0.0), (0.3, 0.0), (0.31, 0.31), (0.32, 0.32)):
        speed_mps = 0.0 if now_s == 0.32 else 5.0
        one.step(command(received_s), received_s, state(now_s, speed_mps=speed_mps), now_s=now_s)
        said.append(one.stop_reason)
    assert said == ["", NO_COMMAND, NO_COMMAND, ""]
    one.step(command(0.5), 0.5, None, now_s=0.5)
    assert one.stop_reason == NO_SPEED
    step_fresh(one, 0.51, driver_override=True)
    assert one.stop_reason == ""


def test_a_limiter_that_never_got_a_command_or_stops_on_request_names_no_reason_of_its_own():
    one = limiter()
    for now_s in (0.0, 0.3, 0.6):
        one.step(None, None, state(now_s), now_s=now_s)
    assert one.stopping and one.stop_reason == ""
    other = limiter()
    step_fresh(other, 0.0)
    other.stopping = True
    step_fresh(other, DT_S)
    assert other.stopping and other.stop_reason == ""


@pytest.mark.parametrize("speed,stops", [(0.125, False), (0.126, True)])
def test_a_stop_ends_at_standstill(speed, stops):
    one = limiter()
    one.step(command(accel_mps2=math.nan), 0.0, state(), now_s=0.0)
    step_fresh(one, DT_S, speed=speed)
    assert one.stopping is stops


def test_the_last_curvature_is_held_for_the_speed_of_now():
    one = limiter(ANY_JERK, QUICK)
    step_fresh(one, 0.0)
    angle_rad = step_fresh(one, DT_S, wanted=0.05).road_wheel_angle_rad
    out = one.step(None, None, state(2 * DT_S, speed_mps=8.0), now_s=2 * DT_S)
    expected = TURN.angle_rad(TURN.curvature_1pm(angle_rad, 10.0), 8.0)
    assert out.road_wheel_angle_rad == pytest.approx(expected, rel=1e-12)
    assert out.road_wheel_angle_rad < angle_rad


def test_more_commands_open_no_limit():
    """Limits are per elapsed time: eight steps within a tick move the wheel as far as one does."""
    once, often = limiter(), limiter()
    for one in (once, often):
        step_fresh(one, 0.0, speed=0.0)
    for n in range(1, 9):
        many = step_fresh(often, n * DT_S / 8, wanted=0.5, speed=0.0)
        again = step_fresh(often, n * DT_S / 8, wanted=0.5, speed=0.0)
        assert again.road_wheel_angle_rad == many.road_wheel_angle_rad
    single = step_fresh(once, DT_S, wanted=0.5, speed=0.0)
    assert many.road_wheel_angle_rad == pytest.approx(single.road_wheel_angle_rad, rel=1e-9)


def test_the_jerk_is_that_of_the_middle_of_the_car():
    """The wheel may make J·v/(v + L/2): 5 m/s³·5/(5 + 0.875)."""
    one = limiter()
    step_fresh(one, 0.0, speed=5.0)
    out = step_fresh(one, DT_S, wanted=1.0, speed=5.0)
    jerk_mps3 = 5.0 * 5.0 / 5.875
    expected = TURN.angle_rad(jerk_mps3 * DT_S / 25.0, 5.0)
    assert out.road_wheel_angle_rad == pytest.approx(expected, rel=1e-12)


def test_the_first_demands_fade_in_too():
    one = limiter(EXACT)
    step_fresh(one, 0.0, speed=0.0)
    out = step_fresh(one, DT_S, speed=0.0, wanted=0.5)
    assert out.road_wheel_angle_rad == pytest.approx(SHUTTLE.max_road_wheel_rate_radps * DT_S / 64)


@pytest.mark.parametrize("requested,given_out", [(-2.0, -2.0), (-9.0, -4.0), (1.0, -1.0)])
def test_without_a_state_a_command_may_brake_more_than_gently(requested, given_out):
    one = limiter()
    step_fresh(one, 0.0)
    assert one.step(command(DT_S, accel_mps2=requested), DT_S, None, now_s=DT_S).accel_mps2 == given_out


def test_the_hand_back_brakes_for_no_command_that_came_under_the_driver():
    """Commands arrive all the time; eight of them in the last half second are often enough."""
    one = limiter(EXACT)
    for n in range(400):
        hands = 100 <= n < 300
        out = step_fresh(one, n * DT_S, accel=0.0, driver_override=hands)
        assert out.accel_mps2 == 0.0, n
