"""The baselines as published: pure pursuit and Stanley.

They have no model of dead time and lag: they start from the lane at the last vehicle state. The controller adds
understeer.
"""

import math

from controller.laws.law import Acting, LateralLaw
from trepid.bounds import at_least, within
from trepid.car.vehicle import Vehicle
from trepid.config import Settings
from trepid.types import NonNegative, Positive


class PurePursuitSettings(Settings):
    """``lateral.pure_pursuit`` in ``config/controller.yaml``."""

    min_ahead_m: Positive  # l_min
    ahead_s: NonNegative  # t


class PurePursuit(LateralLaw):
    """Drive the circle through a goal point on the lane.

        κ_cmd = 2·y/(x² + y²)        l = max(l_min, t·v)

    (x, y) is the point of the lane's centre at the arc length l ahead, in the axes of the car.

    Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01 (1992), section 2.
    """

    def __init__(self, settings: PurePursuitSettings) -> None:
        self._settings = settings

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        lane = at.seen
        ahead_m = at_least(self._settings.ahead_s * at.speed_mps, self._settings.min_ahead_m)
        bend, rate = lane.curvature_1pm, lane.curvature_rate_1pm2
        lateral_m = ahead_m**2 * (bend / 2.0 + ahead_m * rate / 6.0) - lane.offset_m
        sin, cos = math.sin(lane.heading_rad), math.cos(lane.heading_rad)
        x_m, y_m = ahead_m * cos + lateral_m * sin, lateral_m * cos - ahead_m * sin
        return 2.0 * y_m / (x_m * x_m + y_m * y_m)


class StanleySettings(Settings):
    """``lateral.stanley`` in ``config/controller.yaml``."""

    gain_1ps: Positive  # k
    softening_mps: Positive  # v_soft


class Stanley(LateralLaw):
    """Steer the front axle onto the lane.

        δ = -ψ_f - atan(k·e_f/(v + v_soft))        κ_cmd = tan(δ)/L

    ψ_f and e_f are heading error and offset of the front axle.

    Hoffmann, Tomlin, Montemerlo, Thrun, Autonomous automobile trajectory tracking for off-road driving, American
    Control Conference (2007), equation 5, with the softening of section III-C; without yaw and steering dampers.
    """

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
