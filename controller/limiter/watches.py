"""What the limiter watches beside its demands: whether the driver has the car, and whether its limits cut for long.

**The driver**, by the report of the vehicle, by torque, or by a wheel away from all demands. The steering follows
demands with a delay and a limited rate: the wheel stays within the range of all demands of the time

    W = lateness·(dead time + 4·time constant)      (e⁻⁴ of a step is 2 %)

A wheel that stays outside by more than ``angle_rad`` for ``angle_after_s`` is held by the driver. From then on the
limiter follows the wheel, which ends the deviation; the driver has the car until the wheel has been still and the
torque low for ``release_s``. If the wheel is still held then, the demand that fades in deviates again. A report of
the vehicle takes effect at once, both ways.

UN R79 5.1 (the driver overrides at once); ISO 11270:2014 (override by the driver, by no more than 50 N).

**Saturation**, a steering demand beyond the limits. A demand is cut when the output differs from it by more than
``cut_mps2`` of lateral acceleration, a_y = v²·δ/(L + K_us·v²), or when it is the largest angle: the controller has
then cut it already. The time for which it is cut counts up and otherwise down again, as in openpilot (LatControl,
``_check_saturation``), so that a demand cut off and on counts too; from ``after_s`` on the car is saturated.
"""

import math
from collections import deque

from controller.limiter.inputs import SeenState
from controller.limiter.limits import Limits
from trepid.car.vehicle import Vehicle

TIME_CONSTANTS = 4.0


class DriverWatch:
    """Call ``step`` with every plausible state."""

    def __init__(self, vehicle: Vehicle, limits: Limits) -> None:
        self._limits = limits.override
        self._from_mps = vehicle.standstill_mps
        late_s = vehicle.steering_delay_s + TIME_CONSTANTS * vehicle.steering_lag_s
        self._window_s = limits.override.lateness * late_s
        self._demands: deque[tuple[float, float]] = deque()  # time, angle [rad]
        self._explained_s = math.inf  # last time at which the wheel was within the demands; inf: never
        self._anchor_rad = 0.0  # wheel angle under the driver, within still_rad
        self._until_s = -math.inf  # end of the override

    def add_demand(self, angle_rad: float, now_s: float) -> None:
        """Add a demand of the limiter."""
        self._demands.append((now_s, angle_rad))
        while self._demands[0][0] < now_s - self._window_s:
            self._demands.popleft()

    def step(self, seen: SeenState, now_s: float) -> bool:
        """Whether the driver has the car."""
        pushed = seen.torque_nm is not None and abs(seen.torque_nm) > self._limits.torque_nm
        deviates = self._deviates(seen, now_s)
        turns = now_s < self._until_s and self._turns(seen.wheel_rad)
        if pushed or deviates or turns:
            self._until_s = now_s + self._limits.release_s
        return seen.driver or now_s < self._until_s

    def _deviates(self, seen: SeenState, now_s: float) -> bool:
        """Whether the wheel has been outside all demands for too long. Tests the newest demands first."""
        if seen.wheel_rad is None:
            self._explained_s = now_s
            return False
        low_rad, high_rad = seen.wheel_rad - self._limits.angle_rad, seen.wheel_rad + self._limits.angle_rad
        explained = any(sent_rad <= high_rad for _, sent_rad in reversed(self._demands)) and any(
            sent_rad >= low_rad for _, sent_rad in reversed(self._demands)
        )
        if explained or seen.speed_mps <= self._from_mps:
            self._explained_s = now_s
        return now_s - self._explained_s >= self._limits.angle_after_s

    def _turns(self, wheel_rad: float | None) -> bool:
        """Whether the wheel has moved since it was last still."""
        if wheel_rad is None or abs(wheel_rad - self._anchor_rad) <= self._limits.still_rad:
            return False
        self._anchor_rad = wheel_rad
        return True


class SaturationWatch:
    """Call ``step`` with every demand."""

    def __init__(self, vehicle: Vehicle, limits: Limits) -> None:
        self._limits = limits.saturation
        self._vehicle = vehicle
        self._cut_s = 0.0

    @property
    def is_saturated(self) -> bool:
        """Whether the demand has been cut for ``after_s``."""
        return self._cut_s >= self._limits.after_s

    def step(self, wanted_rad: float, given_rad: float, speed_mps: float, dt_s: float) -> None:
        """Count ``dt_s`` in which the demand was ``wanted_rad`` and the output ``given_rad``."""
        limits, vehicle = self._limits, self._vehicle
        speed2 = speed_mps * speed_mps
        per_rad = speed2 / (vehicle.wheelbase_m + vehicle.understeer_gradient_rad_per_mps2 * speed2)
        cut = (
            per_rad * abs(wanted_rad - given_rad) > limits.cut_mps2
            or abs(wanted_rad) >= vehicle.max_road_wheel_angle_rad
        )
        if cut and speed_mps >= limits.from_mps:
            self._cut_s = min(self._cut_s + dt_s, limits.after_s)
        else:
            self.rest(dt_s)

    def rest(self, dt_s: float) -> None:
        """Count ``dt_s`` without a cut."""
        self._cut_s = max(self._cut_s - dt_s, 0.0)
