"""The lane as the controller holds it: a clothoid seen from the rear axle, and how it changes as the car moves.

    s' = v·cos ψ / (1 - κ·e)    e' = v·sin ψ    ψ' = r - κ·s'    κ' = c·s'

e offset (+ = car left of centre) [m], ψ heading error (car minus lane) [rad], κ lane curvature abeam [1/m], c its
rate [1/m²], v speed [m/s], r yaw rate [rad/s]. De Luca, Oriolo, Samson, Feedback control of a nonholonomic
car-like robot (1998), section 2.2.
"""

import math
from dataclasses import dataclass

_MIN_RADIUS_SHARE = 0.2  # of 1 - κ·e: nearer to the centre of the bend "along the lane" loses its meaning


@dataclass(frozen=True, slots=True, kw_only=True)
class Lane:
    """Lane centre as a clothoid at the rear axle; valid up to ``lookahead_m`` ahead."""

    offset_m: float
    heading_rad: float
    curvature_1pm: float
    curvature_rate_1pm2: float
    lookahead_m: float

    def curvature_at(self, ahead_m: float) -> float:
        """κ₀ + c·s [1/m]; beyond the look-ahead, where nothing was seen, the last curvature that was."""
        return self.curvature_1pm + self.curvature_rate_1pm2 * min(ahead_m, self.lookahead_m)

    def path_curvature(self, curvature_1pm: float) -> float:
        """Curvature [1/m] that keeps offset and heading error where the lane bends by ``curvature_1pm``.

        κ·cos ψ / (1 - κ·e): inside a bend the car must turn tighter than the lane.
        """
        return curvature_1pm * math.cos(self.heading_rad) / _radius_share(curvature_1pm, self.offset_m)

    def after(self, dt_s: float, *, speed_mps: float, yaw_rate_radps: float) -> "Lane":
        """The lane as seen ``dt_s`` later (midpoint rule, second order)."""
        middle = self._shifted(0.5 * dt_s, self._rates(speed_mps, yaw_rate_radps))
        return self._shifted(dt_s, middle._rates(speed_mps, yaw_rate_radps))

    def _rates(self, speed_mps: float, yaw_rate_radps: float) -> tuple[float, float, float]:
        """s', e', ψ' as above."""
        share = _radius_share(self.curvature_1pm, self.offset_m)
        along_mps = speed_mps * math.cos(self.heading_rad) / share
        across_mps = speed_mps * math.sin(self.heading_rad)
        return along_mps, across_mps, yaw_rate_radps - self.curvature_1pm * along_mps

    def _shifted(self, dt_s: float, rates: tuple[float, float, float]) -> "Lane":
        along_m = dt_s * rates[0]
        return Lane(
            offset_m=self.offset_m + dt_s * rates[1],
            heading_rad=self.heading_rad + dt_s * rates[2],
            curvature_1pm=self.curvature_at(along_m),
            curvature_rate_1pm2=self.curvature_rate_1pm2 if along_m < self.lookahead_m else 0.0,
            lookahead_m=max(0.0, self.lookahead_m - along_m),
        )


def _radius_share(curvature_1pm: float, offset_m: float) -> float:
    return max(_MIN_RADIUS_SHARE, 1.0 - curvature_1pm * offset_m)
