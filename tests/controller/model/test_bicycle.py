"""The bicycle model against closed forms, its own inverse and its mirror image."""

import math

import pytest
from controller_rig import G
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE, vehicle

from controller.model.bicycle import (
    angle_from_curvature,
    critical_speed,
    curvature_from_angle,
    transposed_angle,
    understeer_angle,
)

PER_DEG_PER_G = math.radians(1.0) / G
curvatures = st.floats(-0.35, 0.35)
speeds = st.floats(-40.0, 40.0)
understeers = st.floats(0.0, 5.0 * PER_DEG_PER_G)
rolls = st.floats(-0.35, 0.35)


@given(curvatures, speeds, understeers, rolls)
def test_the_inverse_returns_the_curvature(curvature, speed, gradient, roll):
    car = vehicle(understeer_gradient_rad_per_mps2=gradient)
    angle = angle_from_curvature(curvature, speed_mps=speed, vehicle=car, roll_rad=roll)
    back = curvature_from_angle(angle, speed_mps=speed, vehicle=car, roll_rad=roll)
    assert back == pytest.approx(curvature, abs=1e-12)


@given(st.floats(-0.5, 0.5), speeds)
def test_the_inverse_returns_the_angle(angle, speed):
    curvature = curvature_from_angle(angle, speed_mps=speed, vehicle=SHUTTLE)
    assert angle_from_curvature(curvature, speed_mps=speed, vehicle=SHUTTLE) == pytest.approx(
        angle, abs=1e-12
    )


@given(curvatures, speeds)
def test_the_mirror_image_needs_the_mirrored_angle(curvature, speed):
    left = angle_from_curvature(curvature, speed_mps=speed, vehicle=SHUTTLE, roll_rad=0.03)
    right = angle_from_curvature(-curvature, speed_mps=speed, vehicle=SHUTTLE, roll_rad=-0.03)
    assert left == -right
    inverse = curvature_from_angle(left, speed_mps=speed, vehicle=SHUTTLE)
    assert curvature_from_angle(-left, speed_mps=speed, vehicle=SHUTTLE) == -inverse


@given(curvatures, st.floats(0.0, 40.0))
def test_reverse_needs_the_same_angle(curvature, speed):
    forward = angle_from_curvature(curvature, speed_mps=speed, vehicle=SHUTTLE)
    assert angle_from_curvature(curvature, speed_mps=-speed, vehicle=SHUTTLE) == forward


@given(curvatures, speeds)
def test_without_understeer_the_angle_is_independent_of_speed(curvature, speed):
    car = vehicle(understeer_gradient_rad_per_mps2=0.0)
    angle = angle_from_curvature(curvature, speed_mps=speed, vehicle=car)
    assert angle == math.atan(1.75 * curvature)
    assert curvature_from_angle(angle, speed_mps=speed, vehicle=car) == pytest.approx(
        math.tan(angle) / 1.75, abs=1e-12
    )


def test_at_standstill_the_angle_is_kinematic():
    assert angle_from_curvature(0.1, speed_mps=0.0, vehicle=SHUTTLE) == pytest.approx(math.atan(0.175))
    assert curvature_from_angle(math.atan(0.175), speed_mps=0.0, vehicle=SHUTTLE) == pytest.approx(0.1)


def test_understeer_is_the_linear_bicycle_in_steady_state():
    """K_us = m_f/C_f - m_r/C_r from axle masses and cornering stiffnesses; slip angles α = F/C at each axle."""
    front_kg, rear_kg, front_npr, rear_npr = 300.0, 400.0, 40e3, 60e3
    car = vehicle(understeer_gradient_rad_per_mps2=front_kg / front_npr - rear_kg / rear_npr)
    for curvature, speed in ((0.02, 10.0), (-0.004, 25.0)):
        lateral = curvature * speed**2
        slip_front, slip_rear = front_kg * lateral / front_npr, rear_kg * lateral / rear_npr
        assert understeer_angle(curvature, speed_mps=speed, vehicle=car) == pytest.approx(
            slip_front - slip_rear, abs=1e-15
        )


def test_a_bank_up_on_the_left_is_like_lateral_acceleration_of_its_weight_component():
    flat = angle_from_curvature(0.5 / 100.0, speed_mps=10.0, vehicle=SHUTTLE)
    kinematic = math.atan(1.75 * 0.005)
    banked = angle_from_curvature(0.005, speed_mps=0.0, vehicle=SHUTTLE, roll_rad=0.5 / G)
    assert banked == pytest.approx(flat, rel=1e-5)
    assert banked > kinematic


def test_from_5_to_20_mph_the_angle_grows_by_15_percent():
    """Deep Steer: L = 1.75 m, K = 2 deg/g (inventory V01)."""
    car = vehicle(understeer_gradient_rad_per_mps2=2.0 * PER_DEG_PER_G)
    slow, fast = 5 * 0.44704, 20 * 0.44704
    ratio = transposed_angle(0.01, from_speed_mps=slow, to_speed_mps=fast, vehicle=car) / 0.01
    k = 2.0 * PER_DEG_PER_G
    assert ratio == pytest.approx((1.75 + k * fast**2) / (1.75 + k * slow**2), rel=1e-4)
    assert ratio == pytest.approx(1.15, abs=0.005)


@given(st.floats(-0.4, 0.4), st.floats(0.0, 30.0), st.floats(0.0, 30.0))
def test_transposing_there_and_back_changes_nothing(angle, one, other):
    there = transposed_angle(angle, from_speed_mps=one, to_speed_mps=other, vehicle=SHUTTLE)
    back = transposed_angle(there, from_speed_mps=other, to_speed_mps=one, vehicle=SHUTTLE)
    assert back == pytest.approx(angle, abs=1e-12)


OVERSTEER = vehicle(understeer_gradient_rad_per_mps2=-0.00356)


def test_only_oversteer_has_a_critical_speed():
    assert critical_speed(SHUTTLE) == math.inf
    assert critical_speed(OVERSTEER) == pytest.approx(math.sqrt(1.75 / 0.00356))


@given(st.floats(0.0, 0.95), st.floats(-0.9, 0.9))
def test_an_oversteering_car_is_inverted_below_its_critical_speed(speed_share, curvature_share):
    speed = speed_share * critical_speed(OVERSTEER)
    tightest = math.sqrt(max(0.0, 1.75 / (0.00356 * speed**2) - 1.0)) / 1.75 if speed > 1.0 else 0.3
    curvature = curvature_share * min(tightest, 0.3)
    angle = angle_from_curvature(curvature, speed_mps=speed, vehicle=OVERSTEER)
    back = curvature_from_angle(angle, speed_mps=speed, vehicle=OVERSTEER)
    assert back == pytest.approx(curvature, abs=1e-9)


@pytest.mark.parametrize("speed_share", [1.0001, 1.5])
def test_above_the_critical_speed_there_is_no_steady_turn(speed_share):
    speed = speed_share * critical_speed(OVERSTEER)
    assert curvature_from_angle(0.01, speed_mps=speed, vehicle=OVERSTEER) is None
    assert transposed_angle(0.01, from_speed_mps=speed, to_speed_mps=5.0, vehicle=OVERSTEER) is None


def test_beyond_the_tightest_steady_turn_there_is_none():
    speed = 0.9 * critical_speed(OVERSTEER)
    assert curvature_from_angle(0.3, speed_mps=speed, vehicle=OVERSTEER) is None


@pytest.mark.parametrize("angle", [1.6, 3.0, math.inf, math.nan])
def test_no_kinematic_path_goes_with_wheels_across(angle):
    assert curvature_from_angle(angle, speed_mps=0.0, vehicle=SHUTTLE) is None
