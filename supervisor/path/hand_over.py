"""Blending from the path of the road to the trail of a leader and back, without a step."""

from supervisor.path.fusion import Path
from trepid.clothoid import STANDING, Lane, Motion

LEAD = "lead"


class HandOver:
    """Holds the difference of two paths where one replaces the other, and lets it fade.

    With Δ(x) the old path less the new one at the hand-over, seen from where the vehicle is now, the path is
    y_new(x) + w(τ)·Δ(x) with w(τ) = 1 − (10τ³ − 15τ⁴ + 6τ⁵), τ = t/T: place, slope and bend begin unchanged.
    """

    def __init__(self, over_s: float) -> None:
        self._over_s = over_s
        self._last: Path | None = None
        self._gap: Lane | None = None
        self._since_s = 0.0
        self._now_s = 0.0

    def step(self, path: Path | None, motion: Motion | None, *, now_s: float) -> Path | None:
        """``path``, blended from that of the last step."""
        moving, dt_s = motion or STANDING, now_s - self._now_s
        last, self._now_s = self._last, now_s
        if path is None:
            self._last = self._gap = None
            return None
        if last is not None and (last.source == LEAD) != (path.source == LEAD):
            here, there = last.lane.after(moving, now_s - last.t_s), path.lane.after(moving, now_s - path.t_s)
            self._gap = here.plus(there, -1.0)
            self._since_s = now_s
        elif self._gap is not None:
            self._gap = self._gap.after(Motion(moving.speed_mps, 0.0), dt_s)
        weight = 1.0 - _least_jerk((now_s - self._since_s) / self._over_s)
        if self._gap is None or weight <= 0.0:
            self._gap, self._last = None, path
            return path
        lane = path.lane.plus(self._gap, weight)
        self._last = path._replace(lane=lane)
        return self._last


def _least_jerk(share: float) -> float:
    """10τ³ − 15τ⁴ + 6τ⁵ for τ up to 1, then 1: Flash and Hogan, The coordination of arm movements (1985)."""
    t = min(share, 1.0)
    return t**3 * (10 - 15 * t + 6 * t**2)
