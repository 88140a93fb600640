"""How far a fitted lane can be believed."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane.fit import WIDTH, E, LaneState
from perception.lane.points import RoadPoints
from trepid.config import Settings
from trepid.types import Array, Positive


class EvidenceSettings(Settings):
    """Section ``evidence`` of ``config/perception.yaml``."""

    min_excess: Annotated[float, Field(ge=0, le=1)]
    full_excess: Positive
    min_extent_m: Positive
    min_foreseen_extent_m: Positive
    road_width_m: Positive
    road_width_sigma_m: Positive
    min_width_m: Positive
    min_width_sigma_m: Positive
    outside_sigma_m: Positive
    one_line_trust: Annotated[float, Field(ge=0, le=1)]
    edge_trust: Annotated[float, Field(ge=0, le=1)]
    lone_edge_trust: Annotated[float, Field(ge=0, le=1)]
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

    def foreseen(self, settings: EvidenceSettings) -> "BoundarySupport":
        """The same support where a boundary is foreseen, which needs less of it to be seen."""
        return replace(
            self, seen=_is_seen(self.excess, self.extent_m, settings.min_foreseen_extent_m, settings)
        )


NO_SUPPORT = BoundarySupport(excess=0.0, extent_m=0.0, seen=False)


@dataclass(frozen=True)
class LaneFit:
    """A lane fitted to one frame, with the evidence for it."""

    state: LaneState
    left: BoundarySupport
    right: BoundarySupport
    residual: float  # rms distance of the accepted points in their standard deviations
    by_edges: bool = False  # road edges instead of painted lines
    apart: float = 0.0  # how unlike what lies beside the edges the road between them is [nats]

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
    ahead_m = points.x_m[chosen]  # far to near; the outermost at each end may be there by chance
    extent_m = float(ahead_m[1] - ahead_m[-2]) if len(chosen) > 3 else 0.0
    excess = (coverage - chance) / max(1 - chance, 0.05)
    return BoundarySupport(
        excess=excess,
        extent_m=extent_m,
        seen=_is_seen(excess, extent_m, settings.min_extent_m, settings),
    )


def _is_seen(excess: float, extent_m: float, least_m: float, settings: EvidenceSettings) -> bool:
    """Whether a boundary has more points than chance gives, over more than ``least_m`` of road."""
    return excess > settings.min_excess and extent_m > least_m


@dataclass(frozen=True, slots=True)
class Belief:
    """Why a lane is believed: factors 0..1, each 1 when all is well, and what it stands on."""

    support: float  # of the boundaries seen
    plausible: float  # width, with the vehicle inside
    tight: float  # residuals
    sure: float  # of the aim point
    trust: float  # in one line or in road edges
    one_line: bool
    by_edges: bool
    apart: float = 0.0  # of road edges: how unlike what lies beside them the road is [nats]

    @property
    def product(self) -> float:
        """A score to choose between lanes: a wrong lane seldom has all factors high."""
        return self.support * self.plausible * self.tight * self.sure * self.trust


NO_BELIEF = Belief(0.0, 0.0, 0.0, 0.0, 0.0, one_line=False, by_edges=False)


def belief_of(
    fit: LaneFit,
    *,
    width_m: float,
    width_sigma_m: float,
    lookahead_m: float,
    settings: EvidenceSettings,
) -> Belief:
    """Support of the boundaries, plausible width with the vehicle inside, small residuals, sure aim point."""
    seen = [b for b in (fit.left, fit.right) if b.seen]
    if not seen:
        return NO_BELIEF
    e_m, lane_m = abs(float(fit.state.mean[E])), float(fit.state.mean[WIDTH])
    odd = max(0.0, abs(lane_m - width_m) / width_sigma_m - 1)
    plausible = 1 / (1 + odd**2) if fit.by_edges else math.exp(-0.5 * odd**2)
    narrow = max(0.0, (settings.min_width_m - lane_m) / settings.min_width_sigma_m)
    outside = max(0.0, e_m - lane_m / 2) / settings.outside_sigma_m
    trust = settings.one_line_trust if len(seen) == 1 else 1.0
    return Belief(
        support=sum(min(1.0, b.excess / settings.full_excess) for b in seen) / len(seen),
        plausible=plausible * math.exp(-0.5 * (narrow**2 + outside**2)),
        tight=1 / (1 + (fit.residual / settings.residual_limit) ** 4),
        sure=math.exp(-0.5 * (aim_sigma_m(fit.state, lookahead_m) / settings.aim_sigma_m) ** 2),
        trust=trust * settings.edge_trust if fit.by_edges else trust,
        one_line=len(seen) == 1,
        by_edges=fit.by_edges,
        apart=fit.apart,
    )


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
