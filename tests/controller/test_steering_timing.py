"""How late the steering is, learned on a simulated steering with other numbers than the file's."""

import math

import numpy as np
import pytest
from car_rig import Car
from hypothesis import given, settings
from hypothesis import strategies as st
from message_rig import state, vehicle

from controller.steering_timing import SteeringTiming

ASSUMED = vehicle(steering_delay_s=0.1, steering_lag_s=0.1)


def weave(t_s, slope=1.0):
    return slope * 0.02 * math.sin(1.5 * t_s)


def learn_late_s(
    real, seconds=6.0, share=0.6, noise_rad=0.0, sensor_rad=0.0, angle=weave, driver=False, seed=0
):
    """θ after ``seconds`` of commands at 50 Hz and angles at 100 Hz."""
    timing = SteeringTiming(ASSUMED, delay_s=ASSUMED.steering_delay_s, share=share)
    car, demanded = Car(real, speed_mps=10.0), 0.0
    noise = np.random.default_rng(seed).normal(0.0, 1.0, round(seconds / 0.01)) * noise_rad
    for n, disturbance in enumerate(noise):
        now_s = 0.01 * n
        seen_rad = car.wheel_rad + sensor_rad + disturbance
        timing.add_state(state(now_s, road_wheel_angle_rad=seen_rad, driver_override=driver))
        if n % 2 == 0:
            demanded = angle(now_s)
            timing.add_command(demanded, now_s=now_s)
        car.step(demanded, 0.0, 0.01)
    return timing.late_s


def test_a_steering_as_in_the_vehicle_file_has_no_extra_delay():
    assert learn_late_s(ASSUMED) == pytest.approx(0.0, abs=0.002)


@settings(max_examples=10, deadline=None)
@given(st.floats(-0.08, 0.08), st.floats(-0.03, 0.03))
def test_the_sum_of_the_extra_dead_time_and_lag_is_learned(delay_s, lag_s):
    real = vehicle(steering_delay_s=0.1 + delay_s, steering_lag_s=0.1 + lag_s)
    assert learn_late_s(real) == pytest.approx(delay_s + lag_s, abs=0.012)


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_an_offset_of_the_sensor_change_the_estimate_little(seed):
    real = vehicle(steering_delay_s=0.15, steering_lag_s=0.1)
    late_s = learn_late_s(real, noise_rad=0.0005, sensor_rad=0.01, seed=seed)
    assert late_s == pytest.approx(0.05, abs=0.015)


def test_the_delay_is_learned_within_a_second_of_the_first_bend():
    real = vehicle(steering_delay_s=0.15, steering_lag_s=0.1)
    assert learn_late_s(real, seconds=3.0, angle=lambda t_s: 0.006 * max(0.0, t_s - 2.0)) == pytest.approx(
        0.05, abs=0.015
    )


def test_the_estimate_stays_within_its_share():
    assert learn_late_s(vehicle(steering_delay_s=0.5), share=0.4) == pytest.approx(0.4 * 0.2)
    assert learn_late_s(vehicle(steering_delay_s=0.5), share=0.0) == 0.0


def test_the_mirrored_drive_gives_the_same_estimate():
    real = vehicle(steering_delay_s=0.15)
    assert learn_late_s(real) == learn_late_s(real, angle=lambda t_s: weave(t_s, -1.0))


def test_a_straight_road_and_a_driver_leave_the_estimate_at_zero():
    real = vehicle(steering_delay_s=0.15)
    assert learn_late_s(real, angle=lambda _: 0.0) == 0.0
    assert learn_late_s(real, driver=True) == 0.0


def test_a_straight_road_keeps_the_estimate():
    real = vehicle(steering_delay_s=0.15)
    then_straight = learn_late_s(real, seconds=120.0, angle=lambda t_s: weave(t_s) if t_s < 6.0 else 0.0)
    assert then_straight == pytest.approx(0.05, abs=0.02)


def test_a_state_without_a_wheel_angle_or_from_the_past_changes_nothing():
    timing = SteeringTiming(ASSUMED, delay_s=0.1, share=0.5)
    for t_s, angle_rad in ((0.0, 0.1), (0.01, None), (-1.0, 0.3), (0.02, 0.1)):
        timing.add_state(state(t_s, road_wheel_angle_rad=angle_rad))
    assert timing.late_s == 0.0


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_commands_without_a_measured_angle_take_no_memory(share):
    timing = SteeringTiming(ASSUMED, delay_s=ASSUMED.steering_delay_s, share=share)
    for n in range(10_000):
        timing.add_command(0.0, now_s=0.02 * n)
    assert len(timing._coming) <= 100
