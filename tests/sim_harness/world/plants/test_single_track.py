"""The dynamic plant against closed forms, scipy's integrator, the kinematic plant and its mirror image."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_rig import SHUTTLE
from plant_rig import command, drive
from scipy.integrate import solve_ivp

from sim_harness.world.plants.actuators import Actuation
from sim_harness.world.plants.axles import axles_of
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.single_track import SHAPE, SingleTrackPlant
from sim_harness.world.plants.state import PlantState
from trepid.config import InputError

G = 9.80665
IDEAL = SHUTTLE.model_copy(
    update=dict(steering_delay_s=0.0, steering_lag_s=0.0, max_road_wheel_rate_radps=1e6)
)


def settle(plant, angle_rad, speed_mps, seconds=12.0):
    """The state after ``seconds`` at a constant angle."""
    start = PlantState(speed_mps=speed_mps, road_wheel_angle_rad=angle_rad, acting_demand_rad=angle_rad)
    return drive(plant, start, command(angle_rad), seconds)


@pytest.mark.parametrize("gradient", [0.0, 0.00356, 0.009, -0.002])
@pytest.mark.parametrize("speed_mps", [5.0, 12.0, 20.0])
def test_the_steady_state_has_the_understeer_of_the_vehicle_file(gradient, speed_mps):
    """For small accelerations δ - L·κ = K_us·v²·κ."""
    vehicle = IDEAL.model_copy(update=dict(understeer_gradient_rad_per_mps2=gradient))
    plant = SingleTrackPlant(vehicle)
    end = settle(plant, 1e-4, speed_mps)
    curvature = end.inner[1]
    steering = 1e-4 - vehicle.wheelbase_m * curvature
    assert steering == pytest.approx(gradient * curvature * speed_mps**2, abs=1e-9)


@pytest.mark.parametrize("lateral_mps2", [2.0, -5.0, 8.0])
def test_near_the_grip_understeer_grows_as_the_inverse_magic_formula(lateral_mps2):
    """Both axles use the same share of their grip, so the difference of slip angles grows by one factor."""
    plant, speed_mps = SingleTrackPlant(IDEAL), 15.0
    curvature = lateral_mps2 / speed_mps**2
    angle_rad = plant.steady_angle_rad(curvature, speed_mps)
    used = lateral_mps2 / G
    growth = SHAPE * math.tan(math.asin(used) / SHAPE) / used
    understeer_rad = IDEAL.understeer_gradient_rad_per_mps2 * lateral_mps2 * growth
    assert angle_rad == pytest.approx(IDEAL.wheelbase_m * curvature + understeer_rad, rel=0.03)
    end = settle(plant, angle_rad, speed_mps)
    assert end.inner[1] == pytest.approx(curvature, rel=1e-9)
    assert plant.lateral_accel_mps2(end) == pytest.approx(lateral_mps2, rel=1e-9)


@pytest.mark.parametrize("speed_mps", [0.3, 1.0, 2.0])
def test_at_low_speed_the_plant_moves_as_the_kinematic_one(speed_mps):
    """The remaining difference is the drift, which grows with the square of the speed."""
    seconds, demand = 4.0, command(0.2)
    start = PlantState(speed_mps=speed_mps)
    dynamic = drive(SingleTrackPlant(SHUTTLE), start, demand, seconds)
    kinematic = drive(KinematicPlant(SHUTTLE), start, demand, seconds)
    apart_m = math.hypot(dynamic.x_m - kinematic.x_m, dynamic.y_m - kinematic.y_m)
    assert apart_m <= 0.004 * speed_mps**2 * seconds


@pytest.mark.parametrize("rear_stiffness_per_rad", [8.0, 40.0])
def test_soft_and_stiff_tyres_settle_down_to_standstill(rear_stiffness_per_rad):
    """The steps shrink with the fastest mode."""
    chassis = {"rear_stiffness_per_rad": rear_stiffness_per_rad}
    plant = SingleTrackPlant(SHUTTLE, PlantSettings(chassis=chassis))
    for speed_mps in (0.0, 0.5, 1.0):
        end = settle(plant, 0.1, speed_mps, seconds=1.0)
        assert end.inner[1] == pytest.approx(math.tan(0.1) / SHUTTLE.wheelbase_m, rel=5e-3)


def test_the_plant_starts_turns_and_stops_without_a_jump():
    plant, state = SingleTrackPlant(SHUTTLE), PlantState()
    rates = []
    for k in range(900):
        state = plant.step(state, command(0.3, 1.5 if k < 300 else -3.0), 0.01)
        rates.append(plant.yaw_rate_radps(state))
    assert state.speed_mps == 0.0
    assert max(rates) > 0.5
    assert max(abs(b - a) for a, b in pairwise(rates)) <= 0.05
    standing = drive(plant, state, command(-0.3, -3.0), 2.0)
    assert (standing.x_m, standing.y_m, standing.yaw_rad) == (state.x_m, state.y_m, state.yaw_rad)


@given(
    friction=st.floats(0.1, 1.2),
    speed_mps=st.floats(0.0, 30.0),
    demands=st.lists(st.tuples(st.floats(-0.55, 0.55), st.floats(-9.0, 2.0)), min_size=1, max_size=6),
)
@settings(max_examples=25, deadline=None)
def test_the_tyres_never_accelerate_the_car_by_more_than_the_grip(friction, speed_mps, demands):
    plant = SingleTrackPlant(SHUTTLE, PlantSettings(friction=friction))
    state = plant.initial(speed_mps=speed_mps)
    for angle_rad, accel_mps2 in demands:
        for _ in range(20):
            state = plant.step(state, command(angle_rad, accel_mps2), 0.01)
            total = math.hypot(plant.lateral_accel_mps2(state), state.accel_mps2)
            assert total <= friction * G * (1 + 1e-9)


def test_a_coasting_car_gains_no_energy_from_steering():
    """Kinetic energy with u' given: the tyres can only reduce the energy of the lateral and the yaw motion."""
    plant = SingleTrackPlant(IDEAL)
    axles, state = plant.axles, plant.initial(speed_mps=15.0, curvature_1pm=0.02)
    energies = []
    for _ in range(100):
        drift, curvature = state.inner
        sideways = state.speed_mps * (drift + axles.cg_to_rear_m * curvature)
        turning = state.speed_mps * curvature
        energies.append(axles.mass_kg * sideways**2 + axles.yaw_inertia_kgm2 * turning**2)
        state = plant.step(state, command(0.0), 0.01)
    assert energies[-1] < 1e-4 * energies[0]
    assert energies[40] < 0.1 * energies[0]


@given(angles=st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=6), speed_mps=st.floats(0.0, 25.0))
@settings(max_examples=20, deadline=None)
def test_mirrored_demands_drive_the_mirrored_path(angles, speed_mps):
    friction = PlantSettings(steering_friction_rad=0.01)
    plant = SingleTrackPlant(SHUTTLE, friction)
    left = right = PlantState(speed_mps=speed_mps)
    for angle_rad in angles:
        left = drive(plant, left, command(angle_rad), 0.1)
        right = drive(plant, right, command(-angle_rad), 0.1)
    assert (right.x_m, right.y_m, right.yaw_rad) == (left.x_m, -left.y_m, -left.yaw_rad)
    assert right.inner == (-left.inner[0], -left.inner[1])


def smooth(t_s):
    """A speed, an acceleration and a tyre angle that are smooth in time."""
    return Actuation(10.0 + math.sin(t_s), math.cos(t_s), 0.08 * math.sin(1.5 * t_s), 0.0, 0.0)


def integrate(plant, seconds, h):
    """x, y, ψ, β, κ after ``seconds`` of :func:`smooth` in steps of ``h``."""
    state = (0.0,) * 5
    for k in range(round(seconds / h)):
        state = rk4(plant.rates, state, smooth(k * h), smooth((k + 0.5) * h), smooth((k + 1) * h), h)
    return np.array(state)


def test_halving_the_step_divides_the_error_by_sixteen():
    plant = SingleTrackPlant(SHUTTLE)
    truth = integrate(plant, 2.0, 0.000625)
    errors = [np.abs(integrate(plant, 2.0, h) - truth)[:2].max() for h in (0.01, 0.005, 0.0025)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.1)


def test_scipys_integrator_drives_the_textbook_equations_to_the_same_place():
    """Rajamani's equations in lateral speed and yaw rate at the centre of gravity, written independently."""
    plant, vehicle = SingleTrackPlant(SHUTTLE), SHUTTLE
    axles, front_m, rear_m = plant.axles, plant.axles.cg_to_front_m, plant.axles.cg_to_rear_m

    def tyre(slip, stiffness, mass, accel):
        peak = mass * math.sqrt(G**2 - accel**2)
        return peak * math.sin(1.3 * math.atan(stiffness * slip / (1.3 * peak)))

    def rates(t_s, state):
        _, _, yaw, sideways, turning = state
        speed, accel, angle, _, _ = smooth(t_s)
        slip = angle - math.atan((sideways + front_m * turning) / speed)
        front = tyre(slip, axles.front_stiffness_nprad, axles.front_mass_kg, accel)
        rear_slip = -math.atan((sideways - rear_m * turning) / speed)
        rear = tyre(rear_slip, axles.rear_stiffness_nprad, axles.rear_mass_kg, accel)
        return (
            speed * math.cos(yaw) - sideways * math.sin(yaw),
            speed * math.sin(yaw) + sideways * math.cos(yaw),
            turning,
            (front * math.cos(angle) + rear) / axles.mass_kg - speed * turning,
            (front_m * front * math.cos(angle) - rear_m * rear) / axles.yaw_inertia_kgm2,
        )

    start = (rear_m, 0.0, 0.0, 0.0, 0.0)  # of the centre of gravity
    x_m, y_m, yaw, sideways, turning = solve_ivp(rates, (0.0, 3.0), start, rtol=1e-11, atol=1e-12).y[:, -1]
    plant_end = integrate(plant, 3.0, 0.005)
    speed = smooth(3.0).speed_mps
    expected = (x_m - rear_m * math.cos(yaw), y_m - rear_m * math.sin(yaw), yaw)
    assert plant_end[:3] == pytest.approx(expected, abs=1e-6)
    assert plant_end[4] * speed == pytest.approx(turning, abs=1e-6)
    assert (plant_end[3] + rear_m * plant_end[4]) * speed == pytest.approx(sideways, abs=1e-6)
    assert vehicle.wheelbase_m == pytest.approx(front_m + rear_m)


@pytest.mark.parametrize("kind", [KinematicPlant, SingleTrackPlant])
@pytest.mark.parametrize("bank_rad", [0.06, -0.03])
def test_a_bank_shifts_the_straight_ahead_angle_by_the_lateral_weight(kind, bank_rad):
    """δ = K_us·g·sin φ, to 2 % for the nonlinear tyres."""
    plant = kind(SHUTTLE, PlantSettings(bank_rad=bank_rad))
    angle_rad = plant.steady_angle_rad(0.0, 12.0)
    shift_rad = SHUTTLE.understeer_gradient_rad_per_mps2 * G * math.sin(bank_rad)
    assert angle_rad == pytest.approx(shift_rad, rel=0.02)
    end = drive(plant, plant.initial(speed_mps=12.0), command(angle_rad), 3.0)
    assert plant.yaw_rate_radps(end) == pytest.approx(0.0, abs=1e-12)
    pulled = drive(plant, plant.initial(speed_mps=12.0), command(0.0), 3.0)
    assert math.copysign(1.0, pulled.yaw_rad) == -math.copysign(1.0, bank_rad)  # downhill


def test_a_load_at_the_rear_reduces_understeer_and_the_empty_vehicle_keeps_that_of_its_file():
    empty, loaded = (axles_of(SHUTTLE, PlantSettings(load_kg=load_kg)) for load_kg in (0.0, 300.0))
    gradient = SHUTTLE.understeer_gradient_rad_per_mps2
    assert empty.understeer_gradient_rad_per_mps2 == pytest.approx(gradient, rel=1e-12)
    assert loaded.understeer_gradient_rad_per_mps2 < gradient
    assert loaded.mass_kg == 1000.0
    assert loaded.front_mass_kg == pytest.approx(700.0 * 0.45 + 300.0 * 0.2)
    assert KinematicPlant(SHUTTLE, PlantSettings(load_kg=300.0)).understeer_rad_per_mps2 == pytest.approx(
        loaded.understeer_gradient_rad_per_mps2
    )


def test_a_vehicle_that_oversteers_more_than_its_rear_tyres_slip_is_refused():
    with pytest.raises(InputError, match="rear tyres softer"):
        axles_of(SHUTTLE.model_copy(update=dict(understeer_gradient_rad_per_mps2=-0.01)), PlantSettings())
