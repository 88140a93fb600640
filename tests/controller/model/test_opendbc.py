"""The bicycle model against opendbc's VehicleModel, over all of its platforms."""

import math
from functools import cache

import pytest
from controller_rig import G
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE

from controller.model.bicycle import angle_from_curvature, curvature_from_angle, understeer_angle
from trepid.car.vehicle import Chassis, Vehicle

WHY = "opendbc is not installed (pip install 'trepid[test]')"
car_helpers = pytest.importorskip("opendbc.car.car_helpers", reason=WHY)
vehicle_model = pytest.importorskip("opendbc.car.vehicle_model", reason=WHY)

PLATFORMS = sorted(car_helpers.interfaces)
OF_THEIR_G = 9.81 / G  # a roll that is as heavy here as in opendbc, whose g is 9.81 m/s²
STEEPEST_RAD = math.radians(20.0)
SPEEDS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
SHARES = (-1.0, -0.5, -0.01, 0.0, 0.3, 1.0)  # of 20°, for the roll and for the angle of the wheels

platforms = st.sampled_from(PLATFORMS)
speeds = st.floats(1.0, 40.0)
angles = st.floats(-STEEPEST_RAD, STEEPEST_RAD)


@cache
def theirs(platform):
    """opendbc's model of the platform."""
    return vehicle_model.VehicleModel(car_helpers.interfaces[platform].get_non_essential_params(platform))


@cache
def ours(platform) -> Vehicle:
    """The same vehicle in a vehicle file that gives mass and tyres."""
    model = theirs(platform)
    chassis = Chassis(
        mass_kg=model.m,
        cg_to_front_m=model.aF,
        front_stiffness_nprad=model.cF,
        rear_stiffness_nprad=model.cR,
    )
    fields = SHUTTLE.model_dump() | {"wheelbase_m": model.l, "steering_ratio": model.sR, "chassis": chassis}
    del fields["understeer_gradient_rad_per_mps2"], fields["rear_slip_gradient_rad_per_mps2"]
    return Vehicle.model_validate(fields)


def difference(platform, speed_mps, roll_rad, angle_rad):
    """Our understeer term minus opendbc's [rad], on the curvature that opendbc drives at this road-wheel angle."""
    model, car = theirs(platform), ours(platform)
    curvature_1pm = model.calc_curvature(angle_rad * model.sR, speed_mps, roll_rad)
    their_rad = model.get_steer_from_curvature(curvature_1pm, speed_mps, roll_rad) / model.sR
    our_rad = understeer_angle(
        curvature_1pm, speed_mps=speed_mps, vehicle=car, roll_rad=roll_rad * OF_THEIR_G
    )
    return our_rad - (their_rad - model.l * curvature_1pm)


@pytest.mark.parametrize("speed_mps", SPEEDS)
def test_the_understeer_term_is_that_of_opendbc_on_every_platform(speed_mps):
    worst = max(
        abs(difference(platform, speed_mps, roll * STEEPEST_RAD, angle * STEEPEST_RAD))
        for platform in PLATFORMS
        for roll in SHARES
        for angle in SHARES
    )
    assert worst < 1e-10


@given(platforms, speeds, angles, angles)
def test_the_understeer_term_is_that_of_opendbc_anywhere_between(platform, speed_mps, roll_rad, angle_rad):
    assert abs(difference(platform, speed_mps, roll_rad, angle_rad)) < 1e-10


@pytest.mark.parametrize("platform", PLATFORMS)
def test_the_slip_factor_is_minus_the_gradient_over_the_wheelbase(platform):
    model = theirs(platform)
    gradient = ours(platform).understeer_gradient_rad_per_mps2
    assert gradient == pytest.approx(-vehicle_model.calc_slip_factor(model) * model.l, rel=1e-12)
    assert 0.5 < math.degrees(gradient * G) < 3.0  # or axles and signs would be mixed up on both sides


@given(platforms, speeds, st.floats(-0.05, 0.05), st.floats(-0.2, 0.2))
def test_the_steady_turn_is_where_the_differential_equations_of_opendbc_settle(
    platform, speed_mps, angle_rad, roll_rad
):
    """An oracle without a slip factor: its 2x2 system solved for standstill of drift and yaw."""
    model, car = theirs(platform), ours(platform)
    settled = vehicle_model.dyn_ss_sol(angle_rad * model.sR, speed_mps, roll_rad, model)
    curvature_1pm = float(settled[1, 0]) / speed_mps
    linear_rad = model.l * curvature_1pm + understeer_angle(
        curvature_1pm, speed_mps=speed_mps, vehicle=car, roll_rad=roll_rad * OF_THEIR_G
    )
    assert linear_rad == pytest.approx(angle_rad, abs=1e-10)


@given(platforms, st.floats(-1.0, 1.0), st.floats(-0.15, 0.15), angles)
def test_below_walking_speed_nothing_jumps_and_reverse_is_the_same_path(
    platform, speed_mps, curvature_1pm, roll_rad
):
    """opendbc switches to another model at 0.1 m/s; ours has one for all speeds."""
    car = ours(platform)
    gradient = car.understeer_gradient_rad_per_mps2

    def angle(speed_mps):
        return angle_from_curvature(curvature_1pm, speed_mps=speed_mps, vehicle=car, roll_rad=roll_rad)

    assert angle(speed_mps) == angle(-speed_mps)
    standing = math.atan(car.wheelbase_m * curvature_1pm) + gradient * G * roll_rad
    assert angle(0.0) == pytest.approx(standing, abs=1e-15)
    assert abs(angle(speed_mps) - angle(0.0)) <= gradient * abs(curvature_1pm) * speed_mps**2 + 1e-15
    back = curvature_from_angle(angle(speed_mps), speed_mps=speed_mps, vehicle=car, roll_rad=roll_rad)
    assert back == pytest.approx(curvature_1pm, abs=1e-12)
