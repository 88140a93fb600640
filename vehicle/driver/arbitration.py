"""Arbitration between controller, driver and a stop. The limits of the limiter hold for each result."""

from dataclasses import replace
from typing import NamedTuple

from trepid.messages import Command, DriverInput, VehicleState


class Demand(NamedTuple):
    """The command for the limiter."""

    command: Command | None  # None: driving is not permitted; the limiter brakes to standstill
    received_s: float | None  # arrival of ``command``
    override: bool  # the command is that of the driver, or its speed and acceleration are
    reason: str  # why driving is not permitted; "" otherwise


def arbitrate(
    command: Command | None,
    received_s: float | None,
    driver: DriverInput | None,
    driver_received_s: float | None,
    *,
    required: bool,
    timeout_s: float,
    now_s: float,
) -> Demand:
    """The command for the limiter from that of the controller and the newest input of the driver.

    ``driver`` is None before the first input. Without an input the controller drives, unless ``required``. After
    the first input it is required: a device that vanishes, a released dead man's switch and an input that was read
    or received more than ``timeout_s`` ago end the permission to drive. With ``override`` the demand of the driver
    becomes the command.
    """
    if driver is None or driver_received_s is None:
        return (
            _not_permitted("no input of the driver") if required else Demand(command, received_s, False, "")
        )
    present = abs(now_s - driver_received_s) <= timeout_s and abs(now_s - driver.t_s) <= timeout_s
    if not (present and driver.connected and driver.allowed):
        return _not_permitted(_why_not(driver, present=present))
    if not driver.override:
        return Demand(command, received_s, False, "")
    return _overridden(command, received_s, driver, driver_received_s)


def _overridden(
    command: Command | None, received_s: float | None, driver: DriverInput, driver_received_s: float
) -> Demand:
    """The demand of the driver.

    Without an angle it replaces speed and acceleration of the controller's command, whose stamps still count: when
    the controller falls silent, the limiter stops the car.
    """
    angle_rad, accel_mps2, speed_mps = driver.road_wheel_angle_rad, driver.accel_mps2, driver.speed_mps
    if accel_mps2 is None or speed_mps is None:
        return _not_permitted("the driver overrides without a demand")
    if angle_rad is None:
        if command is None:
            return _not_permitted("the driver does not steer, and the controller sends nothing")
        return Demand(replace(command, speed_mps=speed_mps, accel_mps2=accel_mps2), received_s, True, "")
    by_hand = Command(
        t_s=driver.t_s, road_wheel_angle_rad=angle_rad, speed_mps=speed_mps, accel_mps2=accel_mps2
    )
    return Demand(by_hand, driver_received_s, True, "")


def _why_not(driver: DriverInput, *, present: bool) -> str:
    if not present:
        return "the input of the driver is old"
    if not driver.connected:
        return "the input device of the driver is gone"
    return "the dead man's switch is released"


def report_override(state: VehicleState, demand: Demand) -> VehicleState:
    """``state``, the limiter's report, with the override of a driver whose demand is the command."""
    return replace(state, driver_override=True) if demand.override else state


def _not_permitted(reason: str) -> Demand:
    return Demand(None, None, False, reason)
