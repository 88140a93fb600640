"""Arbitration between driver, controller and a stop."""

import math
from dataclasses import replace

import pytest
from vehicle_driver_rig import INPUT, TIMEOUT_S

from trepid.messages import Command, VehicleState
from vehicle.driver.arbitration import Demand, arbitrate, report_override

COMMAND = Command(t_s=9.9, road_wheel_angle_rad=0.1, speed_mps=2.0, accel_mps2=0.5)
BY_HAND = replace(INPUT, override=True, road_wheel_angle_rad=-0.2, accel_mps2=0.3, speed_mps=1.0)
NOW_S = 10.0


def decide(driver, *, age_s: float = 0.0, required: bool = False) -> Demand:
    received_s = None if driver is None else NOW_S - age_s
    return arbitrate(COMMAND, 9.95, driver, received_s, required=required, timeout_s=TIMEOUT_S, now_s=NOW_S)


def test_without_a_driver_the_controller_drives() -> None:
    assert decide(None) == Demand(COMMAND, 9.95, False, "")


def test_a_held_dead_mans_switch_lets_the_controller_drive() -> None:
    assert decide(INPUT, required=True) == Demand(COMMAND, 9.95, False, "")


@pytest.mark.parametrize(
    "driver, age_s, required, reason",
    [
        (None, 0.0, True, "no input"),
        (INPUT, TIMEOUT_S + 0.01, False, "old"),
        (BY_HAND, TIMEOUT_S + 0.01, False, "old"),
        (INPUT, -TIMEOUT_S - 0.01, False, "old"),
        (replace(INPUT, t_s=NOW_S - TIMEOUT_S - 0.01), 0.0, False, "old"),  # read long ago, delivered late
        (replace(INPUT, t_s=math.nan), 0.0, False, "old"),
        (replace(INPUT, connected=False), 0.0, False, "gone"),
        (replace(INPUT, allowed=False), 0.0, False, "released"),
        (replace(BY_HAND, allowed=False), 0.0, False, "released"),
        (replace(BY_HAND, accel_mps2=None), 0.0, False, "without a demand"),
    ],
)
def test_nobody_drives_without_a_present_permitting_driver(driver, age_s, required, reason) -> None:
    demand = decide(driver, age_s=age_s, required=required)
    assert demand.command is None
    assert not demand.override
    assert reason in demand.reason


def test_the_demand_of_an_overriding_driver_replaces_the_command() -> None:
    demand = decide(BY_HAND)
    assert demand.override
    assert demand.received_s == NOW_S
    assert demand.command == Command(
        t_s=BY_HAND.t_s, road_wheel_angle_rad=-0.2, speed_mps=1.0, accel_mps2=0.3
    )


def test_a_driver_who_does_not_steer_leaves_the_angle_and_its_stamps_to_the_controller() -> None:
    demand = decide(replace(BY_HAND, road_wheel_angle_rad=None, accel_mps2=-1.0))
    assert demand == Demand(replace(COMMAND, speed_mps=1.0, accel_mps2=-1.0), 9.95, True, "")


def test_a_driver_who_does_not_steer_does_not_drive_without_a_controller() -> None:
    throttle = replace(BY_HAND, road_wheel_angle_rad=None)
    demand = arbitrate(None, None, throttle, NOW_S, required=False, timeout_s=TIMEOUT_S, now_s=NOW_S)
    assert (demand.command, demand.override) == (None, False)
    assert "the controller sends nothing" in demand.reason


def test_an_override_is_reported_in_the_state() -> None:
    state = VehicleState(
        t_s=NOW_S, speed_mps=1.0, road_wheel_angle_rad=0.0, yaw_rate_radps=None, driver_override=False
    )
    assert report_override(state, decide(BY_HAND)).driver_override
    assert report_override(state, decide(INPUT)) == state
    assert report_override(replace(state, driver_override=True), decide(INPUT)).driver_override
