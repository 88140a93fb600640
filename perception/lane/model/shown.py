"""The straight stretch of the road ahead, as far as detections showed it.

A road does not turn where it was shown straight. This holds while nothing of it is detected, as at the mouth of a
side road, whose edge lines lead around its corners, and until the vehicle has driven to the end of that stretch.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import BEND
from perception.lane.model.prediction import VehicleMotion

SIGMAS = 2.0  # of the turn of a lane, by which it may differ


class StraightStretch(NamedTuple):
    """The road is straight up to ``to_m`` ahead of the axle."""

    t_s: float
    seen_t_s: float  # of the last detection
    to_m: float

    @classmethod
    def of(cls, fit: LaneFit, t_s: float, *, before: Self | None) -> Self:
        """What the straight lane ``fit`` shows at ``t_s``, and the rest of the stretch ``before``."""
        return cls(t_s, t_s, max(fit.end_m, before.to_m if before else 0.0))

    def after(self, motion: VehicleMotion, t_s: float, *, max_s: float) -> Self | None:
        """The rest at ``t_s``; None at its end, with an unknown speed, or ``max_s`` after the last detection."""
        if motion.speed_mps is None or t_s < self.t_s or t_s - self.seen_t_s > max_s:
            return None
        rest_m = self.to_m - motion.speed_mps * (t_s - self.t_s)
        return self._replace(t_s=t_s, to_m=rest_m) if rest_m > 0 else None

    def is_left_by(self, fit: LaneFit, gate_rad: float) -> bool:
        """Whether ``fit`` turns by more than ``gate_rad`` up to where both are shown.

        The turn up to s is κ0·s + κ'·s²/2. It depends neither on the offset nor on the heading of the vehicle, and
        so on no error of its odometry.
        """
        to_m = min(self.to_m, fit.end_m)
        gradient = np.array([to_m, to_m**2 / 2])
        turn_rad = float(gradient @ fit.state.mean[BEND])
        sigma_rad = math.sqrt(max(float(gradient @ fit.state.covariance[BEND, BEND] @ gradient), 0.0))
        return abs(turn_rad) > gate_rad + SIGMAS * sigma_rad
