"""Which measurements hold: nothing impossible passes, true cars are believed, and wrong sensors are named."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState
from vehicle.measurement.check import SPEED, WHEEL, YAW, build
from vehicle.measurement.doubt import Doubt, Standing
from vehicle.measurement.settings import load_measurement

CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
LIMITS = load_measurement()
PERIOD_S = 0.01
MODELS = ("kinematic", "single_track")


def state(speed_mps=5.0, wheel_rad=0.0, yaw_radps=0.0, t_s=0.0, **others):
    return VehicleState(
        t_s=t_s,
        speed_mps=speed_mps,
        road_wheel_angle_rad=wheel_rad,
        yaw_rate_radps=yaw_radps,
        **{"driver_override": False, **others},
    )


def drive_checked(
    steer, accel=lambda t_s: 0.0, *, duration_s=6.0, wrong=None, from_s=3.0, speed_mps=5.0, plant=None
):
    """A true car under commands of the time, behind sensors that are ``wrong(state, first)`` from ``from_s`` on.

    The sensors have a noise of a millionth, so that no value repeats itself. Returns the judged states by time.
    """
    model = build_plant(plant or PlantSettings(), CAR)
    pose, check = model.initial(speed_mps=speed_mps), build(CAR)
    judged, first = [], None
    for k in range(round(duration_s / PERIOD_S)):
        now_s = k * PERIOD_S
        noise = 1.0 + 1e-6 * math.sin(1000.0 * k)
        true = model.measure(pose, now_s)
        seen = replace(
            true,
            speed_mps=true.speed_mps * noise,
            road_wheel_angle_rad=true.road_wheel_angle_rad + 1e-6 * noise * math.sin(k),
            yaw_rate_radps=true.yaw_rate_radps + 1e-6 * noise * math.cos(k),
        )
        if wrong is not None and now_s >= from_s:
            first = first or seen
            seen = wrong(seen, first)
        judged.append((now_s, check.step(seen, now_s=now_s)))
        order = Command(t_s=now_s, road_wheel_angle_rad=steer(now_s), speed_mps=5.0, accel_mps2=accel(now_s))
        check.add_command(order)
        pose = model.step(pose, order, PERIOD_S)
    return judged


def doubted_names(judged):
    return {name for _, one in judged for name in one.state.doubted}


anything = st.one_of(st.none(), st.floats(), st.floats(-20, 20), st.floats(-0.6, 0.6))


@given(st.lists(st.tuples(anything, anything, anything, anything, st.booleans()), min_size=1, max_size=60))
@settings(max_examples=150, deadline=None)
def test_no_sequence_of_floats_gets_a_value_through_that_no_car_has(values):
    check = build(CAR)
    lock_rad = LIMITS.range.lock_share * CAR.max_road_wheel_angle_rad + LIMITS.range.lock_rad
    most = (LIMITS.range.speed_mps, lock_rad, LIMITS.range.yaw_rate_radps, LIMITS.range.torque_nm)
    for k, (speed, wheel, yaw, torque, driver) in enumerate(values):
        given_state = state(speed, wheel, yaw, k * PERIOD_S, driver_torque_nm=torque, driver_override=driver)
        found = check.step(given_state, now_s=k * PERIOD_S).state
        published = (
            found.speed_mps,
            found.road_wheel_angle_rad,
            found.yaw_rate_radps,
            found.driver_torque_nm,
        )
        for before, after, limit in zip((speed, wheel, yaw, torque), published, most, strict=True):
            assert after is None or (after == before and abs(after) <= limit)
        check.add_command(Command(t_s=0.0, road_wheel_angle_rad=0.0, speed_mps=5.0, accel_mps2=0.0))


@given(st.lists(st.tuples(anything, anything, anything), min_size=1, max_size=60))
@settings(max_examples=100, deadline=None)
def test_a_quantity_is_named_exactly_when_it_has_been_reported_and_is_absent(values):
    check, known = build(CAR), set()
    for k, reported in enumerate(values):
        found = check.step(state(*reported, t_s=0.0), now_s=k * PERIOD_S).state
        published = (found.speed_mps, found.road_wheel_angle_rad, found.yaw_rate_radps)
        triples = list(zip((SPEED, WHEEL, YAW), reported, published, strict=True))
        absent = {name for name, _, after in triples if after is None}
        taken = {name for name, before, after in triples if before is not None and after is None}
        assert set(found.doubted) - taken <= known & absent
        taken |= set(found.doubted)
        known |= {name for name, before, _ in triples if before is not None}
        assert set(found.doubted) == taken


@pytest.mark.parametrize("model", MODELS)
@given(
    amplitude_rad=st.floats(0.0, 0.05),
    frequency_hz=st.floats(0.05, 0.5),
    accel_mps2=st.floats(-0.5, 0.5),
    offset_rad=st.floats(-0.03, 0.03),
)
@settings(max_examples=12, deadline=None)
def test_a_true_car_is_believed_with_any_steering_offset_that_the_learner_takes(
    model, amplitude_rad, frequency_hz, accel_mps2, offset_rad
):
    judged = drive_checked(
        lambda t_s: amplitude_rad * math.sin(2 * math.pi * frequency_hz * t_s) - offset_rad,
        lambda t_s: accel_mps2,
        plant=PlantSettings(model=model, steering_offset_rad=offset_rad),
    )
    assert doubted_names(judged) == set()


def bend(t_s):
    """A wheel that turns in between 1 and 2 s."""
    return 0.08 * min(max(t_s - 1.0, 0.0), 1.0)


WRONG = {
    "yaw rate: signal at its end": (lambda s, _: replace(s, yaw_rate_radps=2.17), {YAW}),
    "yaw rate: offset": (lambda s, _: replace(s, yaw_rate_radps=s.yaw_rate_radps + 0.15), {YAW}),
    "yaw rate: sign": (lambda s, _: replace(s, yaw_rate_radps=-s.yaw_rate_radps), {YAW}),
    "yaw rate: stuck": (lambda s, first: replace(s, yaw_rate_radps=first.yaw_rate_radps), {YAW}),
    "wheel: offset": (lambda s, _: replace(s, road_wheel_angle_rad=s.road_wheel_angle_rad + 0.05), {WHEEL}),
    "wheel: sign": (lambda s, _: replace(s, road_wheel_angle_rad=-s.road_wheel_angle_rad), {WHEEL}),
    "wheel: stuck": (lambda s, first: replace(s, road_wheel_angle_rad=first.road_wheel_angle_rad), {WHEEL}),
    "wheel: degrees": (lambda s, _: replace(s, road_wheel_angle_rad=57.3 * s.road_wheel_angle_rad), {WHEEL}),
    "speed: km/h": (lambda s, _: replace(s, speed_mps=3.6 * s.speed_mps), {SPEED}),
    "speed: backwards": (lambda s, _: replace(s, speed_mps=-s.speed_mps), {SPEED}),
    "speed: offset": (lambda s, _: replace(s, speed_mps=s.speed_mps + 2.0), {SPEED}),
    "speed: stuck": (lambda s, first: replace(s, speed_mps=first.speed_mps), {SPEED}),
    "swapped": (
        lambda s, _: replace(s, yaw_rate_radps=s.road_wheel_angle_rad, road_wheel_angle_rad=s.yaw_rate_radps),
        {YAW, WHEEL},
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_sensor_is_named_within_a_second_and_says_nothing_more(name):
    wrong, names = WRONG[name]

    def steer(t_s):
        return bend(t_s) + 0.02 * math.sin(3.0 * t_s)

    judged = drive_checked(steer, lambda t_s: 0.5 * math.sin(t_s), wrong=wrong)
    assert not doubted_names([pair for pair in judged if pair[0] < 3.0])
    late = [one.state for now_s, one in judged if now_s >= 4.0]
    assert all(names <= set(one.doubted) for one in late)
    assert all(getattr(one, field) is None for one in late for field in names)


SMALL_RAD, SLOW_HZ = 0.0015, 0.6  # lane keeping on a straight road
SMALL = {
    "wheel: sign": (lambda s, _: replace(s, road_wheel_angle_rad=-s.road_wheel_angle_rad), WHEEL),
    "yaw rate: sign": (lambda s, _: replace(s, yaw_rate_radps=-s.yaw_rate_radps), YAW),
    "swapped": (
        lambda s, _: replace(s, yaw_rate_radps=s.road_wheel_angle_rad, road_wheel_angle_rad=s.yaw_rate_radps),
        WHEEL,
    ),
}


def noisy(wrong=lambda s, _: s, seed=0):
    """``wrong`` behind sensors with the noise of the simulated car."""
    noise, generator = load_simulator(), np.random.default_rng(seed)

    def measure(state, first):
        angle, rate = generator.standard_normal(2)
        seen = replace(
            state,
            road_wheel_angle_rad=state.road_wheel_angle_rad + noise.road_wheel_angle_noise_rad * angle,
            yaw_rate_radps=state.yaw_rate_radps + noise.yaw_rate_noise_radps * rate,
        )
        return wrong(seen, first)

    return measure


@pytest.mark.parametrize("speed_mps", [5.0, 15.0])
@pytest.mark.parametrize("name", SMALL)
def test_a_wrong_sign_or_a_swapped_sensor_is_named_from_small_movements(name, speed_mps):
    wrong, field = SMALL[name]
    judged = drive_checked(
        lambda t_s: SMALL_RAD * math.sin(2 * math.pi * SLOW_HZ * t_s),
        wrong=noisy(wrong),
        from_s=0.0,
        duration_s=8.0,
        speed_mps=speed_mps,
    )
    assert field in judged[-1][1].state.doubted
    only = {WHEEL, YAW} if name == "swapped" else {field}
    assert doubted_names(judged) <= only


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("amplitude_rad", [0.0, 0.0003, 0.003])
def test_small_movements_behind_noise_leave_a_true_car_believed(amplitude_rad, seed):
    judged = drive_checked(
        lambda t_s: amplitude_rad * math.sin(2 * math.pi * (0.3 + 0.3 * seed) * t_s),
        wrong=noisy(seed=seed),
        from_s=0.0,
        duration_s=10.0,
    )
    assert doubted_names(judged) == set()


def test_a_single_wrong_value_takes_nothing_but_itself():
    times = iter(range(1_000_000))
    judged = drive_checked(
        bend, wrong=lambda s, _: replace(s, speed_mps=12.0) if next(times) == 0 else s, duration_s=4.0
    )
    assert sum(SPEED in one.state.doubted for _, one in judged) == 1


def test_a_wheel_that_a_driver_holds_is_no_wrong_measurement():
    """The yaw rate agrees with it: the commands are what the car does not do."""
    held = 0.1

    def true_at_the_held_angle(s, first):
        rate = 5.0 * math.tan(held) / (CAR.wheelbase_m + CAR.understeer_gradient_rad_per_mps2 * 25.0)
        wheel = min(held, first.road_wheel_angle_rad + 0.4 * (s.t_s - first.t_s))
        noise = s.road_wheel_angle_rad
        return replace(s, road_wheel_angle_rad=wheel + noise, yaw_rate_radps=rate * wheel / held + noise)

    judged = drive_checked(lambda t_s: 0.0, wrong=true_at_the_held_angle)
    assert doubted_names(judged) == set()


def test_a_standing_car_that_yaws_is_contradicted():
    judged = drive_checked(lambda t_s: 0.0, wrong=lambda s, _: replace(s, yaw_rate_radps=0.3), speed_mps=0.0)
    assert doubted_names(judged) == {YAW}


def test_a_computed_quantity_is_checked_by_its_range_only():
    check = build(CAR, computed={SPEED})
    for k, speed_mps in enumerate((1.0, 9.0, 1000.0)):
        found = check.step(state(speed_mps, t_s=0.0), now_s=k * PERIOD_S).state
        assert found.speed_mps == (speed_mps if speed_mps < 100.0 else None)


def test_a_state_without_a_time_is_no_state_and_no_state_stays_none():
    check = build(CAR)
    assert check.step(state(t_s=math.nan), now_s=0.0).state is None
    assert check.step(None, now_s=0.01).state is None


def test_a_value_that_is_no_number_is_absent_and_the_reason_says_so():
    found, reasons = build(CAR).step(state(yaw_radps="fast"), now_s=0.0)
    assert (found.yaw_rate_radps, found.doubted) == (None, (YAW,))
    assert reasons == ("yaw rate: 'fast' is no measurement",)


def test_a_doubt_lasts_until_a_second_has_passed_without_a_contradiction():
    doubt = Doubt(LIMITS.doubt)
    assert not doubt.step("", now_s=0.0)
    for k in range(20):
        assert doubt.step("jumps", now_s=1.0 + 0.01 * k)
    assert doubt.step("", now_s=1.19 + LIMITS.doubt.trust_after_s - 0.01)
    assert not doubt.step("", now_s=1.19 + LIMITS.doubt.trust_after_s)


def test_a_coarse_value_that_stands_while_nothing_else_moves_is_believed():
    standing = Standing(LIMITS.stands, LIMITS.stands.yaw_rate_radps)
    assert not any(standing.step(0.0, 0.0, moving=True, now_s=0.01 * k) for k in range(500))


def test_a_value_that_stands_while_the_others_move_is_not():
    standing = Standing(LIMITS.stands, LIMITS.stands.yaw_rate_radps)
    found = [standing.step(0.0, 0.001 * k, moving=True, now_s=0.01 * k) for k in range(100)]
    assert found[-1] == pytest.approx(0.05)  # as it was found, until the value changes
    assert not any(found[: round(LIMITS.stands.after_s / 0.01)])


def test_a_quantity_that_the_car_has_reported_and_reports_no_more_is_named():
    check = build(CAR)
    assert check.step(state(yaw_radps=None), now_s=0.0).state.doubted == ()
    check.step(state(), now_s=0.01)
    found, reasons = check.step(state(speed_mps=None), now_s=0.02)
    assert (found.speed_mps, found.doubted) == (None, (SPEED,))
    assert reasons == ("speed: is not reported any more",)


@pytest.mark.parametrize("restarted", [True, False])
def test_a_speed_that_jumps_holds_only_where_the_car_was_moved_by_hand(restarted):
    check, judged = build(CAR), []
    for k in range(300):
        now_s = k * PERIOD_S
        if k == 200 and restarted:
            check.restart()
        speed_mps = 5.0 if k < 200 else 9.0
        seen = state(speed_mps + 1e-6 * math.sin(1000.0 * k), 1e-6 * math.sin(k), 1e-6 * math.cos(k), now_s)
        judged.append((now_s, check.step(seen, now_s=now_s)))
        check.add_command(Command(t_s=now_s, road_wheel_angle_rad=0.0, speed_mps=5.0, accel_mps2=0.0))
    assert (SPEED in doubted_names(judged)) is not restarted
