"""The parts of the limiter, each on its edges."""

import ast
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limiter_rig import DT_S, EXACT, EXACT_CAR, seen_state, state
from message_rig import SHUTTLE, command, vehicle

import controller.limiter
from controller.limiter.inputs import COUNTED, Arrivals, fresh, is_finite, plausible_state
from controller.limiter.limits import clip, inside, narrow
from controller.limiter.turn import FILTER_S, LEAD_S, SLOPE, Excess, SteadyTurn
from controller.limiter.watches import DriverWatch, SaturationWatch
from controller.model import bicycle

BAD = (math.nan, math.inf, -math.inf)


def test_the_limiter_depends_on_nothing_of_ours_but_the_shared_vocabulary():
    files = list(Path(controller.limiter.__file__).parent.glob("*.py"))
    imported = {
        node.module
        for file in files
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ImportFrom)
    }
    ours = {name.split(".")[0] for name in imported} & {
        "perception",
        "supervisor",
        "controller",
        "sim_harness",
    }
    assert len(files) > 5
    assert ours == {"controller"}
    assert all(name.startswith("controller.limiter") for name in imported if name.startswith("controller"))


# --- intervals

interval = st.tuples(st.floats(-10, 10), st.floats(-10, 10)).map(sorted).map(tuple)


@given(interval, interval)
def test_narrowing_is_the_intersection_or_the_nearest_point_and_never_empty(outer, inner):
    low, high = narrow(outer, inner)
    assert outer[0] <= low <= high <= outer[1]
    overlap = max(outer[0], inner[0]), min(outer[1], inner[1])
    if overlap[0] <= overlap[1]:
        assert (low, high) == overlap
    else:
        assert low == high in outer


def test_the_nearest_point_and_the_edges_belong_to_an_interval():
    assert [clip(x, (1.0, 2.0)) for x in (0.0, 1.5, 3.0)] == [1.0, 1.5, 2.0]
    assert [inside(x, (1.0, 2.0)) for x in (0.9, 1.0, 2.0, 2.1)] == [False, True, True, False]


# --- the steady turn


@given(st.floats(-0.55, 0.55), st.floats(0.0, 60.0), st.sampled_from([0.0, 0.00356, 0.01]))
def test_angle_and_curvature_are_inverse_and_the_car_understeers(angle_rad, speed_mps, gradient):
    turn = SteadyTurn(vehicle(understeer_gradient_rad_per_mps2=gradient))
    curvature_1pm = turn.curvature_1pm(angle_rad, speed_mps)
    assert turn.angle_rad(curvature_1pm, speed_mps) == pytest.approx(angle_rad, abs=1e-9)
    equation = math.atan(1.75 * curvature_1pm) + gradient * curvature_1pm * speed_mps**2
    assert equation == pytest.approx(angle_rad, abs=1e-9)


@given(st.floats(-0.55, 0.55), st.floats(0.0, 30.0), st.floats(0.0, 0.01))
def test_the_steady_turn_is_that_of_the_bicycle_of_the_controller(angle_rad, speed_mps, gradient):
    car = vehicle(understeer_gradient_rad_per_mps2=gradient)
    theirs = bicycle.curvature_from_angle(angle_rad, speed_mps=speed_mps, vehicle=car)
    assert SteadyTurn(car).curvature_1pm(angle_rad, speed_mps) == pytest.approx(theirs, abs=1e-8)


@given(st.floats(-2.0, 2.0), st.floats(0.0, 1.0), st.floats(0.0, 60.0))
def test_a_car_that_oversteers_has_a_tightest_turn_and_angles_that_rise_up_to_it(
    curvature_1pm, more, speed_mps
):
    turn = SteadyTurn(vehicle(understeer_gradient_rad_per_mps2=-0.00356))
    assert turn.angle_rad(curvature_1pm, speed_mps) <= turn.angle_rad(curvature_1pm + more, speed_mps)
    back_1pm = turn.curvature_1pm(turn.angle_rad(curvature_1pm, speed_mps), speed_mps)
    assert abs(back_1pm) <= abs(curvature_1pm) + 1e-4


def test_the_tightest_turn_is_where_the_angle_rises_by_the_smallest_slope():
    """c = -1/2: 1/(1 + u²) = 1/2 + SLOPE."""
    car = vehicle(wheelbase_m=2.0, understeer_gradient_rad_per_mps2=-0.01)
    u = math.sqrt(1.0 / (0.5 + SLOPE) - 1.0)
    angle_rad = math.atan(u) - 0.5 * u
    turn = SteadyTurn(car)
    for sign in (-1, 1):
        assert turn.angle_rad(sign * 9.0, 10.0) == pytest.approx(sign * angle_rad, abs=1e-12)
        assert turn.curvature_1pm(sign * 0.5, 10.0) == pytest.approx(sign * u / 2.0, abs=1e-12)


def test_beyond_95_percent_of_the_critical_speed_the_car_is_taken_for_no_faster():
    turn = SteadyTurn(vehicle(wheelbase_m=2.0, understeer_gradient_rad_per_mps2=-0.01))
    fastest_mps = 0.95 * math.sqrt(200.0)
    u = math.sqrt(1.0 / (0.9025 + SLOPE) - 1.0)
    for speed_mps in (fastest_mps, 2 * fastest_mps):
        assert turn.angle_rad(9.0, speed_mps) == pytest.approx(math.atan(u) - 0.9025 * u, abs=1e-12)
        assert turn.angle_rad(0.01, speed_mps) == pytest.approx(math.atan(0.02) - 0.9025 * 0.02, abs=1e-12)


def test_no_angle_is_beyond_88_degrees_for_a_car_that_does_not_oversteer():
    turn = SteadyTurn(vehicle(understeer_gradient_rad_per_mps2=0.00356))
    assert turn.angle_rad(1e9, 0.0) == pytest.approx(math.atan(math.sqrt(1 / SLOPE - 1)))
    fast = turn.angle_rad(1e9, 20.0)
    compliance = 0.00356 * 400 / 1.75
    assert fast == pytest.approx(math.atan(math.sqrt(999.0)) + compliance * math.sqrt(999.0))


# --- inputs


@pytest.mark.parametrize(
    "t_s,good",
    [
        (None, False),
        (math.nan, False),
        (10.0, True),
        (9.75, True),
        (9.74, False),
        (10.0625, True),
        (10.07, False),
    ],
)
def test_a_stamp_is_fresh_from_a_little_ahead_to_its_timeout(t_s, good):
    assert fresh(t_s, 10.0, 0.25, EXACT) is good


def test_a_plausible_state_is_used_unchanged():
    full = state(
        1.0,
        speed_mps=-4.0,
        road_wheel_angle_rad=0.1,
        yaw_rate_radps=0.2,
        driver_torque_nm=-1.0,
        driver_override=True,
    )
    assert plausible_state(full, 1.0, EXACT) == seen_state(
        speed_mps=4.0, wheel_rad=0.1, driver=True, torque_nm=-1.0, yaw_rate_radps=0.2
    )
    assert plausible_state(state(1.0), 1.0, EXACT) == seen_state()


@pytest.mark.parametrize(
    "changes,good",
    [
        *(
            ({name: value}, False)
            for name in ("t_s", "speed_mps", "road_wheel_angle_rad")
            for value in (*BAD, None)
        ),
        *(({name: value}, False) for name in ("yaw_rate_radps", "driver_torque_nm") for value in BAD),
        ({"yaw_rate_radps": None, "driver_torque_nm": None}, True),
        ({"speed_mps": 100.0}, True),
        ({"speed_mps": -100.0}, True),
        ({"speed_mps": 100.1}, False),
        ({"road_wheel_angle_rad": 1.4}, True),
        ({"road_wheel_angle_rad": -1.41}, False),
        ({"t_s": 0.875}, True),
        ({"t_s": 0.87}, False),
    ],
    ids=str,
)
def test_a_state_is_used_when_it_is_fresh_and_plausible(changes, good):
    assert (plausible_state(replace(state(1.0), **changes), 1.0, EXACT) is not None) is good


def test_a_missing_state_is_none():
    assert plausible_state(None, 1.0, EXACT) is None


@pytest.mark.parametrize(
    "name", ["t_s", "road_wheel_angle_rad", "road_wheel_rate_radps", "speed_mps", "accel_mps2", "jerk_mps3"]
)
def test_a_command_is_finite_when_every_number_is(name):
    assert is_finite(command())
    assert is_finite(command(None))
    for value in BAD:
        assert not is_finite(replace(command(), **{name: value}))


def test_commands_come_too_seldom_when_eight_of_them_take_longer_than_the_rate_allows():
    arrivals = Arrivals(EXACT)  # 8 / 16 Hz = 0.5 s
    gap_s = 0.0625
    for n in range(COUNTED - 1):
        assert not arrivals.too_seldom(gap_s * n, 100.0)  # fewer than eight are not enough
    last_s = gap_s * (COUNTED - 1)
    assert not arrivals.too_seldom(last_s, 0.5)
    assert arrivals.too_seldom(last_s, 0.5 + 1e-9)
    assert arrivals.too_seldom(None, 0.5 + 1e-9)
    assert not arrivals.too_seldom(last_s, 0.5)  # the same one again is no arrival
    assert not arrivals.too_seldom(0.5, 0.5625)  # the oldest is dropped
    assert arrivals.too_seldom(0.5, 0.5626)


def test_eight_commands_that_never_arrived_do_not_count():
    arrivals = Arrivals(EXACT)
    assert not any(arrivals.too_seldom(None, 1.0 * n) for n in range(20))
    assert not any(arrivals.too_seldom(20.0 + n / 16, 20.0 + n / 16) for n in range(40))


# --- the excess of yaw


def test_a_car_in_a_steady_turn_has_no_excess():
    turn = SteadyTurn(SHUTTLE)
    excess = Excess(turn, EXACT)
    for speed_mps, wheel_rad in ((5.0, 0.1), (20.0, -0.01), (0.0, 0.3)):
        yaw_rate_radps = speed_mps * turn.curvature_1pm(wheel_rad, speed_mps)
        known = seen_state(speed_mps=speed_mps, wheel_rad=wheel_rad, yaw_rate_radps=yaw_rate_radps)
        assert excess.step(known, DT_S) == pytest.approx(0.0, abs=1e-12)


def test_the_excess_is_filtered_led_and_bounded():
    """After the first step of an excess e of 0.4 m/s²: filtered e·dt/(τ + dt), led by T·e/(τ + dt)."""
    excess = Excess(SteadyTurn(SHUTTLE), EXACT)
    known = seen_state(speed_mps=4.0, yaw_rate_radps=0.1)
    first = excess.step(known, 0.025)
    assert first == pytest.approx(0.4 * (0.025 + LEAD_S) / (FILTER_S + 0.025))
    filtered = 0.4 * 0.025 / 0.125
    second = excess.step(known, 0.025)
    rate = (0.4 - filtered) / 0.125
    assert second == pytest.approx(filtered + 0.025 * rate + LEAD_S * rate)
    for _ in range(2000):
        last = excess.step(known, 0.025)
    assert last == pytest.approx(0.4)
    assert excess.step(seen_state(speed_mps=4.0, yaw_rate_radps=9.0), 0.025) == 1.5
    assert excess.step(seen_state(speed_mps=4.0, yaw_rate_radps=-9.0), 0.025) == -1.5


@pytest.mark.parametrize("absent", ["yaw_rate_radps", "wheel_rad", "measures_speed"])
def test_without_a_yaw_rate_wheel_angle_or_speed_there_is_no_excess_and_the_filter_is_reset(absent):
    one, fresh_one = Excess(SteadyTurn(SHUTTLE), EXACT), Excess(SteadyTurn(SHUTTLE), EXACT)
    known = seen_state(speed_mps=4.0, yaw_rate_radps=0.1)
    one.step(known, 0.025)
    without = {absent: False if absent == "measures_speed" else None}
    assert one.step(seen_state(**(dict(speed_mps=4.0, yaw_rate_radps=0.1) | without)), 0.025) == 0.0
    assert one.step(known, 0.025) == fresh_one.step(known, 0.025)


# --- the driver


def watch(**changes):
    """A watch after a long time of straight demands, at 0 s."""
    one = DriverWatch(EXACT_CAR, EXACT)
    one.add_demand(0.0, 0.0)
    assert not one.step(seen_state(), 0.0)
    return one


def test_the_override_lasts_while_the_vehicle_reports_it():
    one = watch()
    assert one.step(seen_state(driver=True), 1.0)
    assert not one.step(seen_state(), 1.0)


@pytest.mark.parametrize("torque_nm,driver", [(3.0, False), (3.01, True), (-3.0, False), (-3.01, True)])
def test_the_driver_has_the_car_at_once_by_torque_and_for_a_while_after(torque_nm, driver):
    one = watch()
    assert one.step(seen_state(torque_nm=torque_nm), 1.0) is driver
    assert one.step(seen_state(torque_nm=0.0), 2.0 - DT_S) is driver
    assert not one.step(seen_state(torque_nm=0.0), 2.0)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_wheel_that_stays_outside_all_demands_is_held_by_the_driver(sign):
    one, odd = watch(), seen_state(wheel_rad=sign * 0.04)
    for n in range(4):
        one.add_demand(0.0, n / 16)
        assert not one.step(odd, n / 16)
    assert one.step(odd, 0.25)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_wheel_on_the_edge_of_the_tolerance_is_explained(sign):
    one, edge = watch(), seen_state(wheel_rad=sign * 0.03125)
    assert not any(one.step(edge, n / 16) for n in range(50))


def test_a_moment_within_the_demands_restarts_the_count():
    one, odd = watch(), seen_state(wheel_rad=0.04)
    assert not one.step(odd, 0.1875)
    assert not one.step(seen_state(), 0.25)
    assert not one.step(odd, 0.4375)
    assert one.step(odd, 0.5)


def test_a_standing_car_with_a_turned_wheel_is_no_driver_override():
    for speed_mps, held in ((0.125, False), (0.13, True)):
        one = watch()
        out = [one.step(seen_state(wheel_rad=0.3, speed_mps=speed_mps), n / 16) for n in range(10)]
        assert any(out) is held


def test_a_wheel_never_within_the_demands_is_no_override():
    one = DriverWatch(EXACT_CAR, EXACT)
    one.add_demand(0.0, 0.0)
    assert not any(one.step(seen_state(wheel_rad=0.3), n / 16) for n in range(50))


def test_a_demand_explains_the_wheel_for_twice_the_lateness_of_the_steering():
    """2·(0.05 s + 4·0.1 s) = 0.9 s; here 2·(0.0625 + 4·0.109375) = 1 s, exact in binary."""
    car = vehicle(steering_delay_s=0.0625, steering_lag_s=0.109375)
    one = DriverWatch(car, EXACT)
    one.add_demand(0.5, 0.0)
    assert not one.step(seen_state(wheel_rad=0.5), 0.0)
    for t_s in (0.5, 1.0):
        one.add_demand(0.0, t_s)
        assert not one.step(seen_state(wheel_rad=0.5), t_s)  # 1 s after it is just remembered
    one.add_demand(0.0, 1.0625)
    assert not one.step(seen_state(wheel_rad=0.5), 1.0625)
    assert one.step(seen_state(wheel_rad=0.5), 1.25)


def test_a_wheel_on_its_way_between_two_demands_is_explained():
    one = watch()
    one.add_demand(0.5, 0.25)
    assert not any(
        one.step(seen_state(wheel_rad=wheel), 0.25 + wheel) for wheel in (0.0, 0.1, 0.25, 0.4, 0.5)
    )


def test_the_driver_keeps_the_car_until_the_wheel_has_been_still():
    one = watch()
    assert one.step(seen_state(torque_nm=9.0), 1.0)
    assert one.step(seen_state(wheel_rad=0.02), 1.5)  # turned: a second from here
    assert one.step(seen_state(wheel_rad=0.0278), 1.75)  # about as it was
    assert one.step(seen_state(wheel_rad=0.02), 2.5 - DT_S)
    assert not one.step(seen_state(wheel_rad=0.02), 2.5)
    assert not one.step(seen_state(wheel_rad=0.03), 2.5)  # afterwards a turned wheel has no effect


@pytest.mark.parametrize("turned_rad,longer", [(0.0078125, False), (0.0079, True), (-0.0079, True)])
def test_a_wheel_is_still_up_to_a_tolerance(turned_rad, longer):
    one = watch()
    assert one.step(seen_state(torque_nm=9.0), 1.0)
    assert one.step(seen_state(wheel_rad=turned_rad), 1.5)
    assert one.step(seen_state(wheel_rad=turned_rad), 2.0) is longer


def test_at_first_the_wheel_counts_as_held_straight():
    one = watch()
    assert one.step(seen_state(torque_nm=9.0), 1.0)
    assert one.step(seen_state(wheel_rad=0.005), 1.5)
    assert not one.step(seen_state(wheel_rad=0.005), 2.0)


# --- saturation


def watch_after(seconds, *, wanted_rad=0.0, given_rad=0.0, speed_mps=10.0, car=SHUTTLE):
    one = SaturationWatch(car, EXACT)
    for _ in range(round(seconds * 16)):
        one.step(wanted_rad, given_rad, speed_mps, 1 / 16)
    return one


def test_a_demand_cut_for_long_enough_saturates_and_recovers_at_the_same_pace():
    cut = dict(wanted_rad=0.1, given_rad=0.0)
    assert not watch_after(0.4375, **cut).is_saturated
    one = watch_after(5.0, **cut)
    assert one.is_saturated
    one.step(0.0, 0.0, 10.0, 1 / 16)
    assert not one.is_saturated
    one.step(0.1, 0.0, 10.0, 1 / 16)
    assert one.is_saturated


def test_a_car_that_was_calm_for_long_saturates_no_later():
    one = watch_after(5.0)
    for _ in range(8):
        assert not one.is_saturated
        one.step(0.1, 0.0, 10.0, 1 / 16)
    assert one.is_saturated


@pytest.mark.parametrize("share,cut", [(0.99, False), (1.01, True), (-0.99, False), (-1.01, True)])
def test_the_cut_is_measured_in_lateral_acceleration(share, cut):
    """a_y = v²·δ/(L + K·v²) with v = 10 m/s: 100/(1.75 + 0.356) per radian."""
    edge_rad = 0.25 * (1.75 + 0.356) / 100.0
    assert watch_after(1.0, wanted_rad=0.01 + share * edge_rad, given_rad=0.01).is_saturated is cut


def test_exactly_the_tolerance_is_not_cut():
    """L = 1, K = 0, v = 2: 4 per radian."""
    car = vehicle(wheelbase_m=1.0, understeer_gradient_rad_per_mps2=0.0)
    assert not watch_after(1.0, wanted_rad=0.0625, speed_mps=2.0, car=car).is_saturated
    assert watch_after(1.0, wanted_rad=0.0626, speed_mps=2.0, car=car).is_saturated


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_demand_of_the_largest_angle_counts_as_cut(sign):
    for wanted_rad, cut in ((0.55, True), (0.549, False)):
        one = watch_after(1.0, wanted_rad=sign * wanted_rad, given_rad=sign * wanted_rad)
        assert one.is_saturated is cut


def test_a_slow_car_is_not_saturated():
    for speed_mps, cut in ((2.0, True), (1.99, False)):
        assert watch_after(1.0, wanted_rad=0.5, speed_mps=speed_mps).is_saturated is cut


def test_saturation_begins_exactly_at_its_time():
    assert watch_after(0.5, wanted_rad=0.1).is_saturated


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 30), st.floats(0, 0.1)), max_size=20)
)
def test_left_and_right_saturate_alike(scenes):
    left, right = SaturationWatch(SHUTTLE, EXACT), SaturationWatch(SHUTTLE, EXACT)
    for wanted, given_, speed, dt in scenes:
        left.step(wanted, given_, speed, dt)
        right.step(-wanted, -given_, speed, dt)
        assert left.is_saturated == right.is_saturated
