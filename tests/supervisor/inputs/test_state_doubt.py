"""Odometry goes on with what is left of the vehicle state, and what is missing is rated."""

import math
from dataclasses import replace

import pytest

from supervisor.inputs.validation import motion_of, state_doubt
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import VehicleState

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).validation
CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def state(speed_mps=8.0, wheel_rad=0.1, yaw_radps=0.3, doubted=()):
    return VehicleState(
        t_s=0.0,
        speed_mps=speed_mps,
        road_wheel_angle_rad=wheel_rad,
        yaw_rate_radps=yaw_radps,
        driver_override=False,
        doubted=doubted,
    )


def motion(known, vehicle=CAR):
    return motion_of(known, now_s=0.0, settings=SETTINGS, vehicle=vehicle)


def test_without_a_yaw_rate_the_car_turns_as_the_steady_bicycle():
    length_m = CAR.wheelbase_m + CAR.understeer_gradient_rad_per_mps2 * 64.0
    assert motion(state(yaw_radps=None)).yaw_rate_radps == pytest.approx(8.0 * math.tan(0.1) / length_m)


def test_without_a_wheel_angle_the_measured_yaw_rate_is_the_turn():
    assert motion(state(wheel_rad=None)) == (8.0, 0.3)


@pytest.mark.parametrize("known", [state(speed_mps=None), state(wheel_rad=None, yaw_radps=None), None])
def test_without_a_speed_or_any_turn_there_is_no_motion(known):
    assert motion(known) is None


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e6])
def test_an_impossible_number_is_not_made_up_for(wrong):
    assert motion(state(yaw_radps=wrong)) is None
    assert motion(state(wheel_rad=wrong)) is None


def test_rules_that_do_not_rate_a_doubt_lose_the_motion_as_before():
    assert motion(state(yaw_radps=None), vehicle=None) is None
    assert motion(state(wheel_rad=None), vehicle=None) is None


@pytest.mark.parametrize(
    ("known", "doubt"),
    [
        (state(), 0.0),
        (state(yaw_radps=None), 0.5),
        (state(wheel_rad=None), 1.0),
        (state(speed_mps=None), 1.0),
        (state(doubted=("driver_torque_nm",)), 1.0),
        (None, None),
    ],
)
def test_the_doubt_grows_with_what_is_missing(known, doubt):
    assert state_doubt(known, now_s=0.0, settings=SETTINGS) == doubt


def test_a_silent_car_is_lost_and_not_doubted_and_one_whose_numbers_are_invalid_is_doubted():
    nothing = state(None, None, None)
    assert state_doubt(nothing, now_s=0.0, settings=SETTINGS) is None
    assert state_doubt(replace(nothing, doubted=("speed_mps",)), now_s=0.0, settings=SETTINGS) == 1.0
