"""Detection of a steering demand beyond the limits.

A demand is cut when the output differs from it by more than ``cut_mps2`` of lateral acceleration, a_y = v²·δ/(L
+ K_us·v²), or when it is the largest angle: the controller has then cut it already. The time for which it is
cut counts up and otherwise down again, as in openpilot (LatControl, ``_check_saturation``), so that a demand
cut off and on counts too; from ``after_s`` on the car is saturated.
"""

from controller.limiter.limits import Limits
from trepid.car.vehicle import Vehicle


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
