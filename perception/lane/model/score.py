"""The score of a fitted lane, 0..1: compares the candidates of one frame.

The score is a product of factors. It ranks candidates and is no probability; the probability that a lane is
right is computed from the same factors by :mod:`perception.lane.model.confidence`. Settings named ``…_score``
are limits of the score, settings named ``…_probability`` limits of the probability.
"""

import math
from dataclasses import dataclass

import numpy as np

from perception.lane.model.evidence import EvidenceSettings, LaneFit
from perception.lane.model.geometry import WIDTH, E, LaneState


@dataclass(frozen=True, slots=True)
class Factors:
    """Factors 0..1 of the score of a lane, each 1 at best, and the kind of its boundaries."""

    support: float  # of the boundaries seen
    plausible: float  # width, and the vehicle inside
    tight: float  # residuals
    sure: float  # standard deviation of the aim point
    trust: float  # in one line or in road edges
    one_line: bool
    by_edges: bool
    apart: float = 0.0  # of road edges: as LaneFit.apart [nats]

    @property
    def score(self) -> float:
        """The product of all factors: a wrong lane seldom has all of them high."""
        return self.support * self.plausible * self.tight * self.sure * self.trust


NO_FACTORS = Factors(0.0, 0.0, 0.0, 0.0, 0.0, one_line=False, by_edges=False)


def factors_of(
    fit: LaneFit,
    *,
    width_m: float,
    width_sigma_m: float,
    lookahead_m: float,
    settings: EvidenceSettings,
) -> Factors:
    """The factors of ``fit``; ``width_m`` ± ``width_sigma_m`` are usual widths of such lanes."""
    seen = [b for b in (fit.left, fit.right) if b.seen]
    if not seen:
        return NO_FACTORS
    e_m, lane_m = abs(float(fit.state.mean[E])), float(fit.state.mean[WIDTH])
    odd = max(0.0, abs(lane_m - width_m) / width_sigma_m - 1)
    plausible = 1 / (1 + odd**2) if fit.by_edges else math.exp(-0.5 * odd**2)
    narrow = max(0.0, (settings.min_width_m - lane_m) / settings.min_width_sigma_m)
    outside = max(0.0, e_m - lane_m / 2) / settings.outside_sigma_m
    trust = settings.one_line_trust if len(seen) == 1 else 1.0
    return Factors(
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
