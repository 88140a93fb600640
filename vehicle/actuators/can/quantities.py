"""Commands and states as quantities of the map of signals, and back."""

from collections.abc import Iterable, Mapping

from trepid.messages import Command, VehicleState
from vehicle.actuators.can.settings import ROAD_WHEEL, STEERING_WHEEL


def of_command(command: Command, *, engaged: bool, steering_ratio: float) -> dict[str, float]:
    """Every quantity of ``command`` that a map may name [SI]."""
    angle_rad, accel_mps2 = command.road_wheel_angle_rad, command.accel_mps2
    return {
        ROAD_WHEEL: angle_rad,
        STEERING_WHEEL: angle_rad * steering_ratio,
        "speed_mps": command.speed_mps,
        "accel_mps2": accel_mps2,
        "drive_mps2": max(accel_mps2, 0.0),
        "brake_mps2": max(-accel_mps2, 0.0),
        "engaged": float(engaged),
    }


def to_command(quantities: Mapping[str, float], *, steering_ratio: float, t_s: float) -> Command:
    """The command in ``quantities``; the inverse of :func:`of_command` at the other end of the wire."""
    accel_mps2 = quantities.get("accel_mps2")
    if accel_mps2 is None:
        accel_mps2 = quantities.get("drive_mps2", 0.0) - quantities.get("brake_mps2", 0.0)
    return Command(
        t_s=t_s,
        road_wheel_angle_rad=_angle_rad(quantities, steering_ratio) or 0.0,
        speed_mps=quantities.get("speed_mps", 0.0),
        accel_mps2=accel_mps2,
    )


def of_state(state: VehicleState, *, steering_ratio: float) -> dict[str, float]:
    """Every quantity of ``state`` that a map may name [SI].

    What is not measured is zero, as a car sends it; what is doubted is left out, and its sender sends the value
    that the DBC names invalid.
    """
    angle_rad = state.road_wheel_angle_rad or 0.0
    quantities = {
        ROAD_WHEEL: angle_rad,
        STEERING_WHEEL: angle_rad * steering_ratio,
        "speed_mps": state.speed_mps or 0.0,
        "yaw_rate_radps": state.yaw_rate_radps or 0.0,
        "driver_torque_nm": state.driver_torque_nm or 0.0,
        "driver_override": float(state.driver_override),
    }
    doubted = {*state.doubted, *([STEERING_WHEEL] if ROAD_WHEEL in state.doubted else [])}
    return {name: value for name, value in quantities.items() if name not in doubted}


def to_state(quantities: Mapping[str, float], *, steering_ratio: float, t_s: float) -> VehicleState:
    """The state in ``quantities``; a quantity that is not among them is None."""
    return VehicleState(
        t_s=t_s,
        speed_mps=quantities.get("speed_mps"),
        road_wheel_angle_rad=_angle_rad(quantities, steering_ratio),
        yaw_rate_radps=quantities.get("yaw_rate_radps"),
        driver_override=bool(quantities.get("driver_override")),
        driver_torque_nm=quantities.get("driver_torque_nm"),
    )


def largest(reported: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Each quantity with its value of the largest magnitude: one of several signals of an override is enough."""
    found: dict[str, float] = {}
    for name, value in reported:
        found[name] = max(value, found.get(name, value), key=abs)
    return found


def _angle_rad(quantities: Mapping[str, float], steering_ratio: float) -> float | None:
    if ROAD_WHEEL in quantities:
        return quantities[ROAD_WHEEL]
    column_rad = quantities.get(STEERING_WHEEL)
    return None if column_rad is None else column_rad / steering_ratio
