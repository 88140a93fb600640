"""Pure pursuit, the baseline: drive the circle through a goal point on the lane.

    κ_cmd = 2·y/(x² + y²)        l = max(l_min, t·v)

(x, y) is the point of the lane's centre at the arc length l ahead, in the axes of the car. As published it has
no model of dead time and lag: it starts from the lane at the last vehicle state. The controller adds
understeer.

Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01 (1992), section 2.
"""

import math

from controller.laws.law import Acting
from trepid.bounds import at_least
from trepid.config import Settings
from trepid.types import NonNegative, Positive


class PurePursuitSettings(Settings):
    """``lateral.pure_pursuit`` in ``config/controller.yaml``."""

    min_ahead_m: Positive  # l_min
    ahead_s: NonNegative  # t


class PurePursuit:
    """The law; it has no state."""

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

    def release(self) -> None:
        """No state to reset."""
