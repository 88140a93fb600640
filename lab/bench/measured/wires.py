"""What the wires of cars make of the measured state: the bytes of their drivers and back, in one process."""

import math
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from sim_harness.counterparts.ackermann_driver import odometry_of
from sim_harness.counterparts.ecu import Ecu, EcuSettings
from sim_harness.lockstep.sensors import Carry
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR
from trepid.messages import Command, Odometry, VehicleState
from trepid.wire import from_cdr, to_cdr
from vehicle.actuators.ackermann import state_of
from vehicle.actuators.can.actuator import Reports
from vehicle.actuators.can.signal_map import load_map

PERIOD_S, EPOCH_S = 0.01, 1000.0
MAP = CONFIG_DIR / "cars" / "shuttle" / "can" / "map.yaml"
WHEEL, YAW = "road_wheel_angle_rad", "yaw_rate_radps"


class CanWire:
    """The reports of the simulated ECU as frames of the shuttle's DBC, read as the CAN actuator reads them."""

    computed: frozenset[str] = frozenset()

    def __init__(self, vehicle: Vehicle) -> None:
        signals = load_map(MAP, vehicle)
        self._ecu = Ecu(signals, EcuSettings(), vehicle)
        self._reports = Reports(
            signals.settings.reports, signals.receivers(), steering_ratio=vehicle.steering_ratio
        )

    def __call__(self, state: VehicleState, _: Command | None, now_s: float) -> VehicleState | None:
        for sender, frame in self._ecu.reports(state, now_s=now_s, step_s=PERIOD_S):
            self._reports.take(sender.address, sender.extended, frame, now_s=now_s)
        return self._reports.state(now_s=now_s)


class StateWire:
    """trepid_msgs/VehicleState of an Ackermann driver, in CDR."""

    computed: frozenset[str] = frozenset()

    def __init__(self, _: Vehicle) -> None:
        """No settings."""

    def __call__(self, state: VehicleState, _: Command | None, now_s: float) -> VehicleState:
        return from_cdr(to_cdr(replace(state, doubted=())), VehicleState)


class OdometryWire:
    """nav_msgs/Odometry of an Ackermann driver, in CDR; the wheel angle is that of the last command."""

    computed = frozenset({WHEEL})

    def __init__(self, _: Vehicle) -> None:
        """No settings."""

    def __call__(self, state: VehicleState, given: Command | None, now_s: float) -> VehicleState:
        arrived = state_of(from_cdr(to_cdr(odometry_of(state)), Odometry))
        angle_rad = state.road_wheel_angle_rad if given is None else given.road_wheel_angle_rad
        return replace(arrived, road_wheel_angle_rad=angle_rad, driver_override=state.driver_override)


class RcWire:
    """A servo board with a speed sensor: wheel angle and yaw rate are those of the last pulse."""

    computed = frozenset({WHEEL, YAW})

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def __call__(self, state: VehicleState, given: Command | None, now_s: float) -> VehicleState:
        car, speed_mps = self._vehicle, state.speed_mps
        angle_rad = state.road_wheel_angle_rad if given is None else given.road_wheel_angle_rad
        rate_radps = None
        if speed_mps is not None and angle_rad is not None:
            length_m = car.wheelbase_m + car.understeer_gradient_rad_per_mps2 * speed_mps**2
            rate_radps = speed_mps * math.tan(angle_rad) / length_m
        return replace(state, road_wheel_angle_rad=angle_rad, yaw_rate_radps=rate_radps)


class PlugInWire:
    """An actuator of another package that gives NaN for what is not available."""

    computed: frozenset[str] = frozenset()

    def __init__(self, _: Vehicle) -> None:
        """No settings."""

    def __call__(self, state: VehicleState, _: Command | None, now_s: float) -> VehicleState:
        return replace(state, doubted=(), **dict.fromkeys(state.doubted, math.nan))  # type: ignore[arg-type]


class NoWire:
    """The state as the simulator measures it."""

    computed: frozenset[str] = frozenset()

    def __init__(self, _: Vehicle) -> None:
        """No settings."""

    def __call__(self, state: VehicleState, _: Command | None, now_s: float) -> VehicleState:
        return state


def after_epoch(wire: Carry) -> Carry:
    """``wire`` with all times ``EPOCH_S`` later, so that none of a run-up is negative, as no stamp of ROS is."""

    def carry(state: VehicleState, given: Command | None, now_s: float) -> VehicleState | None:
        arrived = wire(replace(state, t_s=state.t_s + EPOCH_S), given, now_s + EPOCH_S)
        return None if arrived is None else replace(arrived, t_s=arrived.t_s - EPOCH_S)

    return carry


WIRES: MappingProxyType[str, Any] = MappingProxyType(
    {
        "simulator": NoWire,
        "can": CanWire,
        "ackermann state": StateWire,
        "odometry": OdometryWire,
        "rc sensor": RcWire,
        "plug-in": PlugInWire,
    }
)
"""Name -> class, called with the vehicle; its objects carry states, ``computed`` is what no sensor measures."""
