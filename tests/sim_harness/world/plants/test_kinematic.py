"""The kinematic plant against closed forms and its mirror image."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from message_rig import SHUTTLE
from plant_rig import command, drive
from scipy.special import fresnel

from sim_harness.world.plants.actuators import Actuation
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.state import PlantState

IDEAL = SHUTTLE.model_copy(
    update=dict(steering_delay_s=0.0, steering_lag_s=0.0, accel_lag_s=0.0, max_road_wheel_rate_radps=1e6)
)


def test_twenty_metres_per_second_for_two_seconds_is_forty_metres():
    end = drive(KinematicPlant(SHUTTLE), PlantState(speed_mps=20.0), command(), 2.0)
    assert end.x_m == pytest.approx(40.0, abs=1e-9)
    assert (end.y_m, end.yaw_rad, end.speed_mps) == (0.0, 0.0, 20.0)


@pytest.mark.parametrize("gradient", [0.0, 0.00356, 0.009])
@pytest.mark.parametrize("speed_mps", [3.0, 9.0, 15.0])
def test_a_constant_wheel_angle_drives_the_circle_of_the_understeer_equation(gradient, speed_mps):
    vehicle = IDEAL.model_copy(update=dict(understeer_gradient_rad_per_mps2=gradient))
    radius_m = 25.0
    angle_rad = math.atan(vehicle.wheelbase_m / radius_m) + gradient * speed_mps**2 / radius_m
    start = PlantState(speed_mps=speed_mps, road_wheel_angle_rad=angle_rad, acting_demand_rad=angle_rad)
    seconds = 3.0
    end = drive(KinematicPlant(vehicle), start, command(angle_rad), seconds)
    turned_rad = speed_mps * seconds / radius_m
    assert end.yaw_rad == pytest.approx(turned_rad, abs=1e-9)
    assert end.x_m == pytest.approx(radius_m * math.sin(turned_rad), abs=1e-6)
    assert end.y_m == pytest.approx(radius_m * (1 - math.cos(turned_rad)), abs=1e-6)
    assert KinematicPlant(vehicle).lateral_accel_mps2(end) == pytest.approx(speed_mps**2 / radius_m)


@given(
    angle_rad=st.floats(-1.1, 1.1),
    speed_mps=st.floats(0.0, 40.0),
    gradient=st.floats(0.0, 0.01),
)
@settings(max_examples=200, deadline=None)
def test_curvature_solves_the_understeer_equation(angle_rad, speed_mps, gradient):
    vehicle = SHUTTLE.model_copy(update=dict(understeer_gradient_rad_per_mps2=gradient))
    kappa = KinematicPlant(vehicle).curvature_1pm(angle_rad, speed_mps)
    assume(abs(kappa) * speed_mps**2 < 9.8)  # within the grip
    back_rad = math.atan(vehicle.wheelbase_m * kappa) + gradient * kappa * speed_mps**2
    assert back_rad == pytest.approx(angle_rad, abs=1e-9)


def test_an_oversteering_vehicle_has_no_steady_state_above_its_critical_speed():
    vehicle = SHUTTLE.model_copy(update=dict(understeer_gradient_rad_per_mps2=-0.00356))
    critical_mps = math.sqrt(vehicle.wheelbase_m / 0.00356)
    assert KinematicPlant(vehicle).curvature_1pm(0.001, 0.9 * critical_mps) > 0.001 / vehicle.wheelbase_m
    with pytest.raises(ValueError, match="no steady state"):
        KinematicPlant(vehicle).curvature_1pm(0.001, 1.01 * critical_mps)
    with pytest.raises(ValueError, match="no steady state"):
        KinematicPlant(vehicle).curvature_1pm(0.5, 0.9 * critical_mps)


def test_halving_the_step_divides_the_error_by_sixteen():
    """Order 4, with lag but without dead time and saturation, which are exact by themselves."""
    vehicle = SHUTTLE.model_copy(update=dict(steering_delay_s=0.0, max_road_wheel_rate_radps=1e6))

    def end_of(dt_s):
        end = drive(KinematicPlant(vehicle), PlantState(speed_mps=8.0), command(0.1, 1.0), 1.6, dt_s)
        return complex(end.x_m, end.y_m)

    truth = end_of(0.00125)
    errors = [abs(end_of(dt_s) - truth) for dt_s in (0.04, 0.02, 0.01)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("speed_mps", [1.0, 8.0, 20.0])
def test_the_exact_wheel_angle_along_a_clothoid_ends_within_a_micrometre_of_fresnels_integrals(speed_mps):
    """κ = s/A² from κ = 0: x = A·√π·C(s/(A·√π)), y = A·√π·S(…), ψ = s²/(2·A²)."""
    plant, end_1pm, seconds, h = KinematicPlant(SHUTTLE), 3.0 / speed_mps**2, 6.0, 0.01
    length_m = speed_mps * seconds
    scale_m = math.sqrt(math.pi * length_m / end_1pm)

    def motion(t_s):
        kappa = end_1pm * t_s / seconds
        understeer_rad = SHUTTLE.understeer_gradient_rad_per_mps2 * kappa * speed_mps**2
        return Actuation(speed_mps, 0.0, math.atan(SHUTTLE.wheelbase_m * kappa) + understeer_rad, 0.0, 0.0)

    pose = (0.0, 0.0, 0.0)
    for k in range(round(seconds / h)):
        pose = plant.pose_after(pose, motion(k * h), motion((k + 0.5) * h), motion((k + 1) * h), h)
    y_m, x_m = scale_m * np.array(fresnel(length_m / scale_m))
    assert math.hypot(pose[0] - x_m, pose[1] - y_m) <= 1e-6
    assert pose[2] == pytest.approx(end_1pm * length_m / 2, abs=1e-12)


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.123])
def test_a_steering_demand_acts_exactly_after_the_dead_time(delay_s):
    vehicle = IDEAL.model_copy(update=dict(steering_delay_s=delay_s, max_road_wheel_rate_radps=0.5))
    end = drive(KinematicPlant(vehicle), PlantState(), command(0.3), 0.3)
    assert end.road_wheel_angle_rad == pytest.approx(0.5 * (0.3 - delay_s), abs=1e-12)


def test_demands_keep_their_order_and_spacing_through_the_dead_time():
    vehicle = IDEAL.model_copy(update=dict(steering_delay_s=0.05))
    plant, state, angles = KinematicPlant(vehicle), PlantState(), []
    for k in range(20):
        state = plant.step(state, command(0.01 * (k + 1)), 0.01)
        angles.append(state.road_wheel_angle_rad)
    assert angles == pytest.approx([0.0] * 5 + [0.01 * (k + 1) for k in range(15)])


def test_the_wheel_lags_by_a_first_order_and_respects_rate_and_angle_limits():
    lagging = IDEAL.model_copy(update=dict(steering_lag_s=0.1))
    after_tau = drive(KinematicPlant(lagging), PlantState(), command(0.2), 0.1)
    assert after_tau.road_wheel_angle_rad == pytest.approx(0.2 * (1 - math.exp(-1)), abs=1e-9)

    plant, state, previous = KinematicPlant(SHUTTLE), PlantState(), 0.0
    for _ in range(300):
        state = plant.step(state, command(9.9), 0.01)
        assert state.road_wheel_angle_rad - previous <= SHUTTLE.max_road_wheel_rate_radps * 0.01 + 1e-12
        previous = state.road_wheel_angle_rad
    assert previous == pytest.approx(SHUTTLE.max_road_wheel_angle_rad, abs=1e-6)
    assert previous <= SHUTTLE.max_road_wheel_angle_rad


def test_acceleration_lags_by_a_first_order_and_is_limited():
    end = drive(KinematicPlant(SHUTTLE), PlantState(), command(accel_mps2=99.0), SHUTTLE.accel_lag_s)
    assert end.accel_mps2 == pytest.approx(SHUTTLE.max_accel_mps2 * (1 - math.exp(-1)), abs=1e-9)
    assert end.speed_mps == pytest.approx(
        SHUTTLE.max_accel_mps2 * SHUTTLE.accel_lag_s * math.exp(-1), abs=1e-9
    )


def test_braking_ends_in_an_exact_standstill_and_never_reverses():
    plant = KinematicPlant(SHUTTLE)
    stopped = drive(plant, PlantState(speed_mps=5.0), command(0.1, accel_mps2=-99.0), 3.0)
    assert stopped.speed_mps == 0.0
    assert stopped.accel_mps2 == 0.0
    later = drive(plant, stopped, command(0.1, accel_mps2=-99.0), 1.0)
    assert (later.x_m, later.y_m, later.yaw_rad) == (stopped.x_m, stopped.y_m, stopped.yaw_rad)


def test_the_brakes_stop_in_the_distance_of_the_closed_form():
    vehicle = SHUTTLE.model_copy(update=dict(accel_lag_s=0.0))
    stopped = drive(KinematicPlant(vehicle), PlantState(speed_mps=9.0), command(accel_mps2=-3.0), 4.0)
    assert stopped.x_m == pytest.approx(9.0**2 / (2 * 3.0), abs=1e-9)


@given(angles=st.lists(st.floats(-0.7, 0.7), min_size=1, max_size=8), speed_mps=st.floats(0.0, 20.0))
@settings(max_examples=30, deadline=None)
def test_mirrored_demands_drive_the_mirrored_path(angles, speed_mps):
    plant = KinematicPlant(SHUTTLE)
    left = right = PlantState(speed_mps=speed_mps)
    for angle_rad in angles:
        left = drive(plant, left, command(angle_rad), 0.1)
        right = drive(plant, right, command(-angle_rad), 0.1)
    assert (right.x_m, right.y_m, right.yaw_rad) == (left.x_m, -left.y_m, -left.yaw_rad)


def test_a_demand_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        KinematicPlant(SHUTTLE).step(PlantState(), replace(command(), road_wheel_angle_rad=math.nan), 0.01)
