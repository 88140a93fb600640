"""The evidence for a fitted lane: the share of each boundary that is covered by points."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane.model.geometry import LaneState, RoadPoints
from trepid.config import Settings
from trepid.types import Array, Positive, Share

MIN_CHANCE = 0.01  # that noise covers a band, where hardly any point lies beside the boundaries


class EvidenceSettings(Settings):
    """Section ``evidence`` of ``config/perception.yaml``."""

    min_excess: Share
    full_excess: Positive
    min_extent_m: Positive
    min_foreseen_extent_m: Positive
    road_width_m: Positive
    road_width_sigma_m: Positive
    min_width_m: Positive
    min_width_sigma_m: Positive
    outside_sigma_m: Positive
    one_line_trust: Share
    edge_trust: Share
    lone_edge_trust: Share
    sure_looks: Annotated[int, Field(ge=1)]
    aim_sigma_m: Positive
    drawn_sigma_m: Positive
    residual_limit: Positive


@dataclass(frozen=True)
class BoundarySupport:
    """The points on one boundary."""

    excess: float  # share of the visible rows with a point on the boundary, above chance; 1 = in every row
    extent_m: float  # length of road between the first and the last of them
    seen: bool

    def foreseen(self, settings: EvidenceSettings) -> "BoundarySupport":
        """The same support for a boundary that is predicted; a shorter extent then suffices."""
        return replace(
            self, seen=_is_seen(self.excess, self.extent_m, settings.min_foreseen_extent_m, settings)
        )


NO_SUPPORT = BoundarySupport(excess=0.0, extent_m=0.0, seen=False)


@dataclass(frozen=True)
class LaneFit:
    """A lane fitted to one frame, with its evidence."""

    state: LaneState
    left: BoundarySupport
    right: BoundarySupport
    residual: float  # rms distance of the accepted points in their standard deviations
    by_edges: bool = False  # fitted to road edges instead of painted lines
    end_m: float = 0.0  # place ahead of the axle up to which points support it; 0 without any
    apart: float = 0.0  # log-likelihood of road between the edges minus that beside them [nats]

    @property
    def boundaries_seen(self) -> int:
        """How many boundaries have enough points."""
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
    """Coverage of the visible bands by the accepted points ``own`` beyond that of randomly scattered points.

    With ρ points per metre across a band, a gate of ±g contains one by chance in a share 1 − exp(−2·g·ρ).
    """
    chosen = np.flatnonzero(own)
    if not len(chosen):
        return NO_SUPPORT
    covered = np.zeros(len(visible), bool)
    covered[points.band[chosen]] = True
    coverage = int(np.count_nonzero(covered & visible)) / max(int(np.count_nonzero(visible)), 1)
    chance = 1 - math.exp(-2 * gate_m * density_per_m)
    ahead_m = points.x_m[chosen]  # far to near; the outermost point at each end may be an outlier
    extent_m = float(ahead_m[1] - ahead_m[-2]) if len(chosen) > 3 else 0.0
    excess = (coverage - chance) / max(1 - chance, 0.05)
    return BoundarySupport(
        excess=excess, extent_m=extent_m, seen=_is_seen(excess, extent_m, settings.min_extent_m, settings)
    )


def support_end_m(
    covered: NDArray[np.bool_], visible: NDArray[np.bool_], ahead_m: Array, *, chance: float, share: float
) -> float:
    """Place up to which boundaries are covered by points, and beyond which only by chance; 0 without such a place.

    ``covered`` and ``visible``: per boundary and band, shape (n, bands), from far to near; ``ahead_m``: of the
    bands. Each visible band is covered with the probability p₁ = ``chance`` + ``share``·(1 − ``chance``) up to the
    end, and p₀ = ``chance`` beyond. The end of a boundary is the most likely one: the maximum of the sum, from near
    to far, of ln(p₁/p₀) for each covered band and ln((1 − p₁)/(1 − p₀)) for each other one (change point of a
    Bernoulli sequence; Hinkley and Hinkley, Biometrika 57 (1970)). Parallel boundaries support each other, so the
    farther end counts.
    """
    by_chance = max(chance, MIN_CHANCE)
    until = by_chance + share * (1 - by_chance)
    hit, miss = math.log(until / by_chance), math.log((1 - until) / (1 - by_chance))
    likelier = np.cumsum((np.where(covered, hit, miss) * visible)[:, ::-1], axis=1)
    last = likelier.argmax(axis=1)
    found = likelier[np.arange(len(last)), last] > 0
    return float(ahead_m[::-1][last[found]].max()) if found.any() else 0.0


def _is_seen(excess: float, extent_m: float, min_extent_m: float, settings: EvidenceSettings) -> bool:
    """Whether a boundary has more points than chance gives, over more than ``min_extent_m`` of road."""
    return excess > settings.min_excess and extent_m > min_extent_m
