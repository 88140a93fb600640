"""Offset and understeer are learned from drives of known truth, within bounds, and never upset the loop."""

import math

import numpy as np
import pytest
from controller_rig import SETTINGS
from hypothesis import given, settings
from hypothesis import strategies as st
from identification_rig import check_learned
from identification_rig import drive as weave
from message_rig import state, vehicle

from controller.model.bicycle import angle_from_curvature
from controller.steering_learner import SteeringLearner, yaw_lag_s
from trepid.messages import VehicleState

CAR = vehicle(max_road_wheel_rate_radps=3.0)
GRADIENT = CAR.understeer_gradient_rad_per_mps2
LEARNING = SETTINGS.learning


def learner(car=CAR, **changes):
    return SteeringLearner(car, LEARNING.model_copy(update=changes))


def moving(t_s, speed_mps, angle_rad, rate, **changes):
    return VehicleState(
        **(
            dict(
                t_s=t_s,
                speed_mps=speed_mps,
                road_wheel_angle_rad=angle_rad,
                yaw_rate_radps=rate,
                driver_override=False,
            )
            | changes
        )
    )


def steady(t_s, *, speed_mps=10.0, curvature_1pm=0.0, offset_rad=0.0, car=CAR, zero_radps=0.0):
    """A car that fulfils the relation exactly."""
    angle_rad = angle_from_curvature(curvature_1pm, speed_mps=speed_mps, vehicle=car) - offset_rad
    return moving(t_s, speed_mps, angle_rad, speed_mps * curvature_1pm + zero_radps)


def test_with_excitation_it_finds_the_truth_as_identification_does():
    check_learned(2.7, 0.0087)


def test_the_zero_of_the_yaw_rate_is_read_at_standstill_and_spoils_nothing_after():
    one = learner()
    for n in range(150):
        one.step(moving(n * 0.02, 0.0, 0.0, 0.005))
    assert one.yaw_rate_offset_radps == pytest.approx(0.005, abs=3e-4)
    for n in range(150, 400):
        one.step(steady(n * 0.02, offset_rad=0.01, zero_radps=0.005))
    assert one.offset_rad == pytest.approx(0.01, abs=2e-4)


def test_on_a_straight_with_noise_the_understeer_stays_where_it_is():
    """The noise of the yaw rate is in both sides of the relation: least squares alone would pull K to -L/v²."""
    noise = np.random.default_rng(5).standard_normal((6000, 2))
    one = learner()
    for n, (of_angle, of_rate) in enumerate(noise):
        one.step(moving(n * 0.02, 20.0, 5e-4 * of_angle, 2e-3 * of_rate))
    assert one.understeer == GRADIENT
    assert abs(one.offset_rad) < 2e-4


@pytest.mark.parametrize("sign", [1, -1])
def test_bank_reads_as_an_offset_that_vanishes_within_three_seconds_after_it(sign):
    angle_rad = angle_from_curvature(0.0, speed_mps=15.0, vehicle=CAR, roll_rad=sign * 0.06)
    one = learner()
    for n in range(300):
        one.step(moving(n * 0.02, 15.0, angle_rad, 0.0))
    assert one.offset_rad == pytest.approx(-sign * GRADIENT * 9.80665 * 0.06, rel=0.03)
    for n in range(300, 450):
        one.step(moving(n * 0.02, 15.0, 0.0, 0.0))
    assert abs(one.offset_rad) < 2e-4


@pytest.mark.parametrize("speed_mps", [5.0, 10.0, 20.0])
def test_yaw_lags_a_ramp_of_the_wheels_by_the_lag_of_the_tyres(speed_mps):
    """Against the two axles of controller/model/tyres.py, integrated."""
    rear, wheelbase_m = 0.0051, CAR.wheelbase_m
    front = rear + GRADIENT
    car = vehicle(rear_slip_gradient_rad_per_mps2=rear)
    drift = direction = rate = t_s = 0.0
    dt_s, ramp = 1e-4, 0.02
    for _ in range(30_000):
        t_s += dt_s
        drift += dt_s * (-drift / (rear * speed_mps) - rate)
        direction += dt_s * ((ramp * t_s - direction) / (front * speed_mps) - rate)
        rate = speed_mps * (direction - drift) / wheelbase_m
    steady = speed_mps / (wheelbase_m + GRADIENT * speed_mps**2)
    assert yaw_lag_s(car, speed_mps) == pytest.approx(t_s - rate / (steady * ramp), abs=5e-4)
    assert yaw_lag_s(CAR, speed_mps) == 0.0


def test_steering_by_a_driver_gives_the_same_estimates():
    one = learner()
    for n in range(200):
        one.step(moving(n * 0.02, 10.0, -0.0087, 0.0, driver_override=True))
    assert one.offset_rad == pytest.approx(0.0087, rel=0.02)


WRONG = [
    ("slow", dict(speed_mps=1.0)),
    ("reversing", dict(speed_mps=-5.0)),
    ("no angle", dict(road_wheel_angle_rad=None)),
    ("no yaw rate", dict(yaw_rate_radps=None)),
    ("hard", dict(speed_mps=15.0, yaw_rate_radps=0.3)),
    ("saturated", dict(saturated=True)),
]


@pytest.mark.parametrize("changes", [changes for _, changes in WRONG], ids=[why for why, _ in WRONG])
def test_where_the_relation_does_not_hold_nothing_is_learned(changes):
    one = learner()
    for n in range(200):
        one.step(state(n * 0.02, **(dict(speed_mps=8.0, road_wheel_angle_rad=0.03) | changes)))
    assert (one.offset_rad, one.understeer) == (0.0, GRADIENT)


def test_a_high_yaw_acceleration_holds_the_estimates():
    one = learner()
    for n in range(200):
        one.step(moving(n * 0.02, 5.0, 0.03, 0.6 * math.copysign(1.0, math.sin(n * 0.3))))
    assert one.offset_rad == 0.0


def test_switched_off_it_gives_the_state_back_untouched():
    one = learner(enabled=False)
    seen = steady(0.0, offset_rad=0.02)
    assert one.step(seen) is seen
    assert one.command_rad(0.1) == 0.1


def test_the_corrected_state_is_that_of_the_tyres_and_the_command_undoes_it():
    one = learner()
    for n in range(300):
        seen = one.step(steady(n * 0.02, curvature_1pm=0.01, offset_rad=0.01))
    truth = angle_from_curvature(0.01, speed_mps=10.0, vehicle=CAR)
    assert seen.road_wheel_angle_rad == pytest.approx(truth, abs=3e-4)
    assert one.command_rad(seen.road_wheel_angle_rad) == pytest.approx(truth - 0.01, abs=1e-12)


def test_mirrored_states_give_mirrored_estimates():
    log = weave(offset_rad=0.006, duration_s=25.0)
    one, other = learner(), learner()
    for t, v, angle, rate in zip(log.t_s, log.speed_mps, log.angle_rad, log.yaw_rate_radps, strict=True):
        one.step(moving(t, v, angle, rate))
        other.step(moving(t, v, -angle, -rate))
    assert one.offset_rad == pytest.approx(-other.offset_rad, abs=1e-12)
    assert one.understeer == pytest.approx(other.understeer, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.4), st.floats(-5, 60), st.floats(-0.6, 0.6), st.floats(-3, 3)),
        min_size=2,
        max_size=60,
    ),
    st.sampled_from([0.0, 0.00356, -0.0005]),
)
def test_estimates_stay_within_their_bounds_and_jerk_for_any_input(states, gradient):
    car = vehicle(understeer_gradient_rad_per_mps2=gradient)
    one, t_s = learner(car), 0.0
    span = max(LEARNING.understeer_share * abs(gradient), LEARNING.understeer_span)
    before = (0.0, gradient)
    for dt_s, speed_mps, angle_rad, rate in states:
        t_s += dt_s
        one.step(moving(t_s, speed_mps, angle_rad, rate))
        assert abs(one.offset_rad) <= LEARNING.max_offset_rad
        assert max(gradient - span, min(gradient, 0.0)) <= one.understeer <= gradient + span
        v2 = max(abs(speed_mps), LEARNING.slowest_mps) ** 2
        per_jerk_rad = max(car.wheelbase_m / v2 + before[1], 0.0) * min(dt_s, 0.25)
        assert abs(one.offset_rad - before[0]) <= LEARNING.max_jerk_mps3 * per_jerk_rad + 1e-12
        assert abs(one.understeer - before[1]) * 3.0 <= LEARNING.max_jerk_mps3 / 4 * per_jerk_rad + 1e-12
        assert all(map(math.isfinite, one.deviations()))
        before = one.offset_rad, one.understeer
