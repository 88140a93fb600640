"""Stanley, the baseline: steer the front axle onto the lane.

    δ = -ψ_f - atan(k·e_f/(v + v_soft))        κ_cmd = tan(δ)/L

ψ_f and e_f are heading error and offset of the front axle. As published it has no model of dead time and lag: it
starts from the lane at the last vehicle state. Understeer is the controller's.

Hoffmann, Tomlin, Montemerlo, Thrun, Autonomous automobile trajectory tracking for off-road driving, American
Control Conference (2007), equation 5, with the softening of section III-C; without its yaw and steering dampers.
"""

import math

from controller.laws.law import Acting
from trepid.bounds import within
from trepid.config import Settings
from trepid.types import Positive
from trepid.vehicle import Vehicle


class StanleySettings(Settings):
    """``lateral.stanley`` in ``config/controller.yaml``."""

    gain_1ps: Positive  # k
    softening_mps: Positive  # v_soft


class Stanley:
    """The law; remembers nothing."""

    def __init__(self, settings: StanleySettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._wheelbase_m = vehicle.wheelbase_m
        self._max_angle_rad = vehicle.max_road_wheel_angle_rad

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        lane, wheelbase_m, settings = at.seen, self._wheelbase_m, self._settings
        bend, rate = lane.curvature_1pm, lane.curvature_rate_1pm2
        lane_turns_rad = wheelbase_m * (bend + wheelbase_m * rate / 2.0)
        lane_y_m = wheelbase_m**2 * (bend / 2.0 + wheelbase_m * rate / 6.0)
        offset_m = lane.offset_m + wheelbase_m * math.sin(lane.heading_rad) - lane_y_m
        speed_mps = abs(at.speed_mps) + settings.softening_mps
        angle_rad = lane_turns_rad - lane.heading_rad - math.atan(settings.gain_1ps * offset_m / speed_mps)
        return math.tan(within(angle_rad, self._max_angle_rad)) / wheelbase_m

    def release(self) -> None:
        """No state to reset."""
