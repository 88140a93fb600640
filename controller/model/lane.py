"""The lane as the controller holds it: a clothoid seen from the rear axle, and how it changes as the car moves.

    s' = v·cos(ψ + β) / (1 - κ·e)    e' = v·sin(ψ + β)    ψ' = r - κ·s'    κ' = c·s'

e offset (+ = car left of centre) [m], ψ heading error (car minus lane) [rad], β drift: course minus heading of the
rear axle, zero where tyres do not slip [rad], κ lane curvature abeam [1/m], c its rate [1/m²], v speed [m/s], r yaw
rate [rad/s]. De Luca, Oriolo, Samson, Feedback control of a nonholonomic car-like robot (1998), section 2.2.
"""

import math
from typing import NamedTuple

from trepid.bounds import at_least, at_most

_MIN_RADIUS_SHARE = 0.2  # of 1 - κ·e: nearer to the centre of the bend "along the lane" loses its meaning


class Lane(NamedTuple):
    """Lane centre as a clothoid at the rear axle; valid up to ``lookahead_m`` ahead."""

    offset_m: float
    heading_rad: float
    curvature_1pm: float
    curvature_rate_1pm2: float
    lookahead_m: float

    def curvature_at(self, ahead_m: float) -> float:
        """κ₀ + c·s [1/m]; beyond the look-ahead, where nothing was seen, the last curvature that was."""
        return self.curvature_1pm + self.curvature_rate_1pm2 * at_most(ahead_m, self.lookahead_m)

    def path_curvature(self, curvature_1pm: float) -> float:
        """Curvature [1/m] that keeps offset and heading error where the lane bends by ``curvature_1pm``.

        κ·cos ψ / (1 - κ·e): inside a bend the car must turn tighter than the lane.
        """
        return curvature_1pm * math.cos(self.heading_rad) / _radius_share(curvature_1pm, self.offset_m)

    def after(
        self, dt_s: float, *, speed_mps: float, yaw_rate_radps: float, drift_rad: float = 0.0
    ) -> "Lane":
        """The lane as seen ``dt_s`` later (midpoint rule, second order)."""
        return Lane(*lane_after(self, dt_s, speed_mps, yaw_rate_radps, drift_rad))


Clothoid = tuple[float, float, float, float, float]
"""The fields of a lane. Between two lanes that somebody holds, a bare tuple does."""


def lane_after(
    lane: Clothoid, dt_s: float, speed_mps: float, yaw_rate_radps: float, drift_rad: float = 0.0
) -> Clothoid:
    """:meth:`Lane.after` for many short spans on end."""
    middle = _shifted(lane, 0.5 * dt_s, lane, speed_mps, yaw_rate_radps, drift_rad)
    return _shifted(lane, dt_s, middle, speed_mps, yaw_rate_radps, drift_rad)


def _shifted(
    lane: Clothoid, dt_s: float, by: Clothoid, speed_mps: float, yaw_rate_radps: float, drift_rad: float
) -> Clothoid:
    """``lane`` from ``dt_s`` later at the rates s', e', ψ' that hold at ``by``."""
    offset_m, heading_rad, curvature_1pm, rate_1pm2, lookahead_m = lane
    by_offset_m, by_heading_rad, by_curvature_1pm, _, _ = by
    course_rad = by_heading_rad + drift_rad
    along_mps = speed_mps * math.cos(course_rad) / _radius_share(by_curvature_1pm, by_offset_m)
    along_m = dt_s * along_mps
    seen = along_m < lookahead_m
    return (
        offset_m + dt_s * (speed_mps * math.sin(course_rad)),
        heading_rad + dt_s * (yaw_rate_radps - by_curvature_1pm * along_mps),
        curvature_1pm + rate_1pm2 * (along_m if seen else lookahead_m),
        rate_1pm2 if seen else 0.0,
        lookahead_m - along_m if seen else 0.0,
    )


def _radius_share(curvature_1pm: float, offset_m: float) -> float:
    return at_least(1.0 - curvature_1pm * offset_m, _MIN_RADIUS_SHARE)
