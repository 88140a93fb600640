"""How far a fitted lane can be believed."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane_fit import WIDTH, Array, LaneState
from perception.lane_points import RoadPoints
from trepid.config import Settings

Positive = Annotated[float, Field(gt=0)]


class EvidenceSettings(Settings):
    """Section ``evidence`` of ``config/perception.yaml``."""

    min_excess: Annotated[float, Field(ge=0, le=1)]
    full_excess: Positive
    min_extent_m: Positive
    road_width_m: Positive
    road_width_sigma_m: Positive
    min_width_m: Positive
    min_width_sigma_m: Positive
    one_line_trust: Annotated[float, Field(ge=0, le=1)]
    edge_trust: Annotated[float, Field(ge=0, le=1)]
    lone_edge_trust: Annotated[float, Field(ge=0, le=1)]
    first_look_trust: Annotated[float, Field(ge=0, le=1)]
    sure_looks: Annotated[int, Field(ge=1)]
    aim_sigma_m: Positive
    drawn_sigma_m: Positive
    residual_limit: Positive


@dataclass(frozen=True)
class BoundarySupport:
    """How well one boundary stands on points."""

    excess: float  # share of the visible rows with a point on the boundary, above chance; 1 = in every row
    extent_m: float  # length of road between the first and the last of them
    seen: bool


NO_SUPPORT = BoundarySupport(excess=0.0, extent_m=0.0, seen=False)


@dataclass(frozen=True)
class LaneFit:
    """A lane fitted to one frame, with the evidence for it."""

    state: LaneState
    left: BoundarySupport
    right: BoundarySupport
    residual: float  # rms distance of the accepted points in their standard deviations
    by_edges: bool = False  # road edges instead of painted lines

    @property
    def boundaries_seen(self) -> int:
        """How many boundaries stand on enough points."""
        return int(self.left.seen) + int(self.right.seen)


def boundary_support(
    points: RoadPoints,
    own: NDArray[np.bool_],
    visible: NDArray[np.bool_],
    *,
    density_per_m: float,
    gate_m: float,
    settings: EvidenceSettings,
) -> BoundarySupport:
    """Coverage of the visible bands by the accepted points ``own``, against what scattered points would give.

    With ρ points per metre across a band, a gate of ±g catches one by chance in a share 1 − exp(−2·g·ρ).
    """
    chosen = np.flatnonzero(own)
    if not len(chosen):
        return NO_SUPPORT
    covered = np.zeros(len(visible), bool)
    covered[points.band[chosen]] = True
    coverage = int(np.count_nonzero(covered & visible)) / max(int(np.count_nonzero(visible)), 1)
    chance = 1 - math.exp(-2 * gate_m * density_per_m)
    ahead_m = points.x_m[chosen]
    extent_m = float(ahead_m.max() - ahead_m.min())
    excess = (coverage - chance) / max(1 - chance, 0.05)
    return BoundarySupport(
        excess=excess,
        extent_m=extent_m,
        seen=excess > settings.min_excess and extent_m > settings.min_extent_m,
    )


def confidence(
    fit: LaneFit,
    *,
    width_m: float,
    width_sigma_m: float,
    lookahead_m: float,
    settings: EvidenceSettings,
) -> float:
    """0..1: support of the boundaries × plausible width × small residuals × sure aim point.

    Each factor is 1 when all is well and falls smoothly; a wrong lane seldom passes all four.
    """
    seen = [b for b in (fit.left, fit.right) if b.seen]
    if not seen:
        return 0.0
    support = sum(min(1.0, b.excess / settings.full_excess) for b in seen) / len(seen)
    if len(seen) == 1:
        support *= settings.one_line_trust
    if fit.by_edges:
        support *= settings.edge_trust
    surprise = (fit.state.mean[WIDTH] - width_m) / width_sigma_m
    odd = max(0.0, abs(surprise) - 1)
    plausible = 1 / (1 + odd**2) if fit.by_edges else math.exp(-0.5 * odd**2)
    narrow = max(0.0, (settings.min_width_m - fit.state.mean[WIDTH]) / settings.min_width_sigma_m)
    plausible *= math.exp(-0.5 * narrow**2)
    tight = 1 / (1 + (fit.residual / settings.residual_limit) ** 4)
    sure = math.exp(-0.5 * (aim_sigma_m(fit.state, lookahead_m) / settings.aim_sigma_m) ** 2)
    return float(support * plausible * tight * sure)


def looks_factor(fit: LaneFit, looks: int, settings: EvidenceSettings) -> float:
    """How far ``looks`` frames in a row may be believed: two painted lines at once, anything less in time.

    In a single picture a roof, a wall or the sky can have the outline of a road; it does not move like one.
    """
    if fit.boundaries_seen == 2 and not fit.by_edges:
        return 1.0
    share = min(1.0, looks / settings.sure_looks)
    return settings.first_look_trust + (1 - settings.first_look_trust) * share


def aim_sigma_m(state: LaneState, lookahead_m: float) -> float:
    """Standard deviation [m] of the lane centre at the look-ahead, from the covariance of the state."""
    gradient = np.array([-1.0, -lookahead_m, lookahead_m**2 / 2, lookahead_m**3 / 6, 0.0, 0.0])
    return math.sqrt(max(0.0, float(gradient @ state.covariance @ gradient)))


def believed_reach_m(state: LaneState, reach_m: float, sigma_m: float) -> float:
    """How far ahead, up to ``reach_m``, the lane centre is known to ``sigma_m``; at least 5 m."""
    ahead_m, gradient = _looks_ahead(reach_m)
    variance = (gradient * (state.covariance[:4, :4] @ gradient)).sum(axis=0)
    known = variance <= sigma_m**2
    first = int(known.argmax())
    return float(ahead_m[first]) if known[first] else min(reach_m, 5.0)


@lru_cache(maxsize=8)
def _looks_ahead(reach_m: float) -> tuple[Array, Array]:
    """Distances from ``reach_m`` down to 5 m, shape (n,), and d(centre)/d(e, ψ, κ0, κ') there, shape (4, n)."""
    ahead_m = np.arange(reach_m, 5.0, -2.0)
    gradient = np.stack([-np.ones_like(ahead_m), -ahead_m, ahead_m**2 / 2, ahead_m**3 / 6])
    return ahead_m, gradient
