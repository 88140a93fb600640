"""Which measurements of the car hold: the last step before a state is used and published.

Every quantity of a state is checked against its range first, then against physics, the commands that were given to
the car, and the other quantities (:mod:`vehicle.measurement.speed`, :mod:`vehicle.measurement.steering`). One that
fails is absent in the state that is given on, and named in its ``doubted``. The step between actuator and bus calls
it, and so does the simulated vehicle.
"""

import math
from collections.abc import Set
from dataclasses import replace
from typing import NamedTuple

from trepid.car.vehicle import Vehicle
from trepid.messages import QUANTITIES, Command, VehicleState
from vehicle.measurement.settings import MeasurementSettings, load_measurement
from vehicle.measurement.speed import SpeedCheck
from vehicle.measurement.steering import WheelCheck, YawCheck

SPEED, WHEEL, YAW, TORQUE = "speed_mps", "road_wheel_angle_rad", "yaw_rate_radps", "driver_torque_nm"
LONGEST_S = 0.05  # a longer pause of the process counts as this long


class CheckedState(NamedTuple):
    """A state whose quantities hold, and why the others do not."""

    state: VehicleState | None
    reasons: tuple[str, ...]  # one for each quantity that is doubted here, such as "yaw rate: ..."


def build(vehicle: Vehicle, *, computed: Set[str] = frozenset()) -> "MeasurementCheck":
    """The check with the settings in ``config/``. Raises InputError."""
    return MeasurementCheck(vehicle, load_measurement(), computed=computed)


def absent(now_s: float) -> VehicleState:
    """The state of a car that reports nothing."""
    return VehicleState(
        t_s=now_s, speed_mps=None, road_wheel_angle_rad=None, yaw_rate_radps=None, driver_override=False
    )


class MeasurementCheck:
    """Call ``step`` with every state, and ``given`` with every command to the car."""

    def __init__(
        self, vehicle: Vehicle, settings: MeasurementSettings, *, computed: Set[str] = frozenset()
    ) -> None:
        """``computed`` names fields that no sensor measures, such as the speed by a throttle table: range only."""
        limits = settings.range
        lock_rad = limits.lock_share * vehicle.max_road_wheel_angle_rad + limits.lock_rad
        self._most = {
            SPEED: limits.speed_mps,
            WHEEL: lock_rad,
            YAW: limits.yaw_rate_radps,
            TORQUE: limits.torque_nm,
        }
        self._vehicle, self._settings, self._computed = vehicle, settings, computed
        self._command: Command | None = None
        self._reported: set[str] = set()  # quantities that the car has reported
        self.restart()

    def restart(self) -> None:
        """Forget the past of every quantity: something else than drive and steering moved the car."""
        vehicle, settings = self._vehicle, self._settings
        self._speed, self._wheel = SpeedCheck(vehicle, settings), WheelCheck(vehicle, settings)
        self._yaw = YawCheck(vehicle, settings)
        self._then_s = math.nan

    def add_command(self, command: Command | None) -> None:
        """``command`` has been given to the car; None: nothing was given."""
        self._command = command

    def step(self, state: VehicleState | None, *, driver: bool = False, now_s: float) -> CheckedState:
        """``state`` without the quantities that do not hold at ``now_s``; None stays None.

        ``driver``: a driver has the car, also where ``state`` does not say so. A state without a finite time of
        measurement is no state.
        """
        dt_s = 0.0 if math.isnan(self._then_s) else max(0.0, min(now_s - self._then_s, LONGEST_S))
        self._then_s = now_s
        command = self._command
        self._wheel.command(None if command is None else command.road_wheel_angle_rad, dt_s, now_s=now_s)
        if state is not None and not math.isfinite(state.t_s):
            state = None
        driver = driver or (state is not None and state.driver_override)
        reasons: dict[str, str] = {}
        values = {name: self._value_in_range(name, state, reasons) for name in QUANTITIES}
        held = self._check_values(values, driver, dt_s, now_s)
        if state is None:
            return CheckedState(None, ())
        for name in (SPEED, WHEEL, YAW):
            if values[name] is not None:
                self._reported.add(name)
            elif name in self._reported and name not in {*reasons, *state.doubted, *self._computed}:
                reasons[name] = "is not reported any more"
        doubts = {SPEED: self._speed.doubt, WHEEL: self._wheel.doubt, YAW: self._yaw.doubt}
        for name, doubt in doubts.items():
            if values[name] is not None and not held[name]:
                reasons[name] = doubt.reason
                values[name] = None
        if not reasons:
            return CheckedState(state, ())
        doubted = tuple(sorted({*state.doubted, *reasons}))
        texts = tuple(f"{QUANTITIES[name]}: {reasons[name]}" for name in QUANTITIES if name in reasons)
        held_state = replace(
            state,
            speed_mps=values[SPEED],
            road_wheel_angle_rad=values[WHEEL],
            yaw_rate_radps=values[YAW],
            driver_torque_nm=values[TORQUE],
            doubted=doubted,
        )
        return CheckedState(held_state, texts)

    def _value_in_range(self, name: str, state: VehicleState | None, reasons: dict[str, str]) -> float | None:
        """The quantity ``name`` of ``state`` if it is a number within its range, else None."""
        value = None if state is None else getattr(state, name)
        if value is None:
            return None
        if not isinstance(value, float | int) or not math.isfinite(value):
            reasons[name] = f"{value!r} is no measurement"
            return None
        if abs(value) > self._most[name]:
            reasons[name] = f"is beyond {self._most[name]:.3g}"
            return None
        return value

    def _check_values(
        self, values: dict[str, float | None], driver: bool, dt_s: float, now_s: float
    ) -> dict[str, bool]:
        """Whether speed, wheel angle and yaw rate hold; a computed one always does."""
        command, computed = self._command, self._computed
        demand_mps2 = None if command is None else command.accel_mps2
        speed_mps, wheel_rad, yaw_radps = values[SPEED], values[WHEEL], values[YAW]
        speed_holds = SPEED in computed or self._speed.step(
            speed_mps, demand_mps2, dt_s, driver=driver, now_s=now_s
        )
        moves_mps = speed_mps if speed_holds else self._speed.expected_mps
        moves_mps = None if moves_mps is None else abs(moves_mps)
        wheel_holds = WHEEL in computed or self._wheel.step(
            wheel_rad, yaw_radps, moves_mps, dt_s, driver=driver, now_s=now_s
        )
        commanded_rad = None if driver else self._wheel.commanded_rad
        turns_rad = wheel_rad if wheel_holds else commanded_rad
        yaw_holds = YAW in computed or self._yaw.step(
            yaw_radps, turns_rad, moves_mps, dt_s, commanded_rad=commanded_rad, now_s=now_s
        )
        return {SPEED: speed_holds, WHEEL: wheel_holds, YAW: yaw_holds}
