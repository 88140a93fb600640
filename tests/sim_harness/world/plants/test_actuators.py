"""Friction and offset of the steering; load and grip limits of the drive."""

import math
from itertools import pairwise

import pytest
from message_rig import SHUTTLE
from plant_rig import command, drive

from sim_harness.world.plants.actuators import Actuators
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState

QUICK = SHUTTLE.model_copy(
    update=dict(steering_delay_s=0.0, steering_lag_s=0.0, accel_lag_s=0.0, max_road_wheel_rate_radps=1e6)
)
FRICTION_RAD = 0.01


def tyre_angles(demands_rad, **settings):
    """Tyre angle of a steering without lag after each of ``demands_rad``."""
    plant, state, angles = KinematicPlant(QUICK, PlantSettings(**settings)), PlantState(), []
    for demand_rad in demands_rad:
        state = plant.step(state, command(demand_rad), 0.01)
        angles.append(plant.actuators.at(state).tyre_angle_rad)
    return angles


def test_tyres_stick_within_the_friction_then_follow_with_that_offset():
    up = [0.002 * k for k in range(1, 16)]
    expected = [max(0.0, demand_rad - FRICTION_RAD) for demand_rad in up]
    assert tyre_angles(up, steering_friction_rad=FRICTION_RAD) == pytest.approx(expected, abs=1e-15)


def test_at_a_reversal_the_tyres_stick_for_twice_the_friction():
    there = [0.03, 0.021, 0.011, 0.009, 0.0]
    expected = [0.02, 0.02, 0.02, 0.019, 0.01]
    assert tyre_angles(there, steering_friction_rad=FRICTION_RAD) == pytest.approx(expected, abs=1e-15)


def test_a_full_turn_of_the_steering_encloses_the_area_of_the_play_loop():
    """Hysteresis of the play operator between ±A: 2·f wide, 2·(A - f) high; independent of the rate."""
    amplitude, areas = 0.05, []
    for points in (400, 4000):
        turn = [amplitude * math.sin(math.tau * k / points) for k in range(2 * points + 1)]
        tyres = tyre_angles(turn, steering_friction_rad=FRICTION_RAD)
        loop = list(zip(turn, tyres, strict=True))[points:]
        areas.append(abs(sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in pairwise(loop))))
    assert areas[1] == pytest.approx(2 * FRICTION_RAD * 2 * (amplitude - FRICTION_RAD), rel=1e-3)
    assert areas[0] == pytest.approx(areas[1], rel=0.01)


def test_the_measured_angle_excludes_friction_and_offset():
    plant = KinematicPlant(QUICK, PlantSettings(steering_friction_rad=0.01, steering_offset_rad=0.02))
    state = plant.step(PlantState(), command(0.05), 0.01)
    assert state.road_wheel_angle_rad == 0.05
    assert plant.actuators.at(state).tyre_angle_rad == pytest.approx(0.05 - 0.01 + 0.02)


def test_an_offset_turns_the_car_and_the_steady_angle_compensates_it():
    plant = KinematicPlant(SHUTTLE, PlantSettings(steering_offset_rad=0.01))
    turned = drive(plant, PlantState(speed_mps=8.0), command(0.0), 2.0)
    assert turned.yaw_rad == pytest.approx(2.0 * 8.0 * plant.curvature_1pm(0.01, 8.0))
    start = plant.initial(speed_mps=8.0)
    assert start.road_wheel_angle_rad == pytest.approx(-0.01)
    assert drive(plant, start, command(-0.01), 2.0).yaw_rad == pytest.approx(0.0, abs=1e-15)


def test_a_load_of_the_vehicles_own_mass_halves_the_acceleration_limits():
    loaded = Actuators(SHUTTLE, PlantSettings(load_kg=700.0), grip_mps2=9.0)
    assert loaded.max_accel_mps2 == pytest.approx(SHUTTLE.max_accel_mps2 / 2)
    assert loaded.max_decel_mps2 == pytest.approx(SHUTTLE.max_decel_mps2 / 2)


def test_on_ice_the_brakes_need_the_distance_that_the_grip_allows():
    plant = KinematicPlant(QUICK, PlantSettings(friction=0.1))
    stopped = drive(plant, PlantState(speed_mps=5.0), command(accel_mps2=-6.0), 7.0)
    grip_mps2 = 0.95 * 0.1 * 9.80665
    assert stopped.speed_mps == 0.0
    assert stopped.x_m == pytest.approx(
        5.0**2 / (2 * grip_mps2), abs=1e-3
    )  # the last step ends before it does
