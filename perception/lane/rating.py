"""Score and probability of a fitted lane.

The score, 0..1, is a product of factors and ranks the candidates of one frame. The probability that the path of the
lane is right, its curvature within tan 2°/1.75 m (two degrees of the wheels of the default car), is a logistic
regression (Platt 1999) on the same factors and on conditions under which lanes are wrong more often. Settings named
``…_score`` are limits of the score, settings named ``…_probability`` limits of the probability.
"""

import math
from dataclasses import dataclass

from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import WIDTH, E, LaneState, ahead_gradient
from perception.lane.settings import LaneCvSettings

ASKEW_RAD, BENT_1PM = 0.15, 0.05  # units of heading error and curvature
MIN_FACTOR = 1e-3  # smaller factors count as this

Features = tuple[float, ...]  # in the order of the fields of ConfidenceSettings


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


@dataclass(frozen=True, slots=True)
class Candidate:
    """A lane fitted to one frame, rated for the choice between candidates."""

    fit: LaneFit
    factors: Factors
    score: float  # at most the product of the factors; compared with scores only
    sure: bool = False  # accepted by its probability, whatever its score


class Rating:
    """Rates lanes by score (to choose between candidates) and probability (to report, to keep the memory)."""

    def __init__(self, settings: LaneCvSettings) -> None:
        self._settings = settings

    def candidate(self, fit: LaneFit) -> Candidate:
        """``fit`` with its factors and score."""
        factors = self._factors(fit)
        return Candidate(fit, factors, factors.score)

    def features(self, factors: Factors, lane: LaneState, *, looks: float) -> Features:
        """Inputs of the probability of ``lane`` after ``looks`` detections in a row: 1, log factors, conditions.

        Chance detections do not persist. A large heading error is rare in a lane that is kept. Edges with a
        small ``apart`` are often those of snow tracks, shadows or dirt.
        """
        clothoid = lane.clothoid
        curvature_1pm = clothoid.curvature_at(self._settings.steering.lookahead_m)
        bend = min(abs(curvature_1pm) / BENT_1PM, 2.0)
        logs = (
            math.log(max(factor, MIN_FACTOR))
            for factor in (factors.support, factors.plausible, factors.tight, factors.sure)
        )
        return (
            1.0,
            *logs,
            float(factors.one_line),
            float(factors.by_edges),
            1.0 - looks / self._settings.evidence.sure_looks,
            min((clothoid.heading_rad / ASKEW_RAD) ** 2, 4.0),
            bend,
            bend * factors.by_edges,
            factors.apart,
        )

    def probability(self, features: Features) -> float:
        """1/(1 + exp(−w·x)) with the weights w and the features x; |w·x| is limited to 30."""
        weights = vars(self._settings.confidence).values()
        total = sum(w * x for w, x in zip(weights, features, strict=True))
        return 1 / (1 + math.exp(-min(max(total, -30.0), 30.0)))

    def probability_of(self, candidate: Candidate, *, looks: float) -> float:
        """The probability that ``candidate`` is right after ``looks`` detections in a row."""
        return self.probability(self.features(candidate.factors, candidate.fit.state, looks=looks))

    def _factors(self, fit: LaneFit) -> Factors:
        seen = [boundary for boundary in (fit.left, fit.right) if boundary.seen]
        if not seen:
            return NO_FACTORS
        prior, evidence = self._settings.prior, self._settings.evidence
        width_m, width_sigma_m = prior.width_m, prior.width_sigma_m
        if fit.by_edges:
            width_m, width_sigma_m = evidence.road_width_m, evidence.road_width_sigma_m
        e_m, lane_m = abs(float(fit.state.mean[E])), float(fit.state.mean[WIDTH])
        odd = max(0.0, abs(lane_m - width_m) / width_sigma_m - 1)
        plausible = 1 / (1 + odd**2) if fit.by_edges else math.exp(-0.5 * odd**2)
        narrow = max(0.0, (evidence.min_width_m - lane_m) / evidence.min_width_sigma_m)
        outside = max(0.0, e_m - lane_m / 2) / evidence.outside_sigma_m
        trust = evidence.one_line_trust if len(seen) == 1 else 1.0
        aim_sigma_m = _aim_sigma_m(fit.state, self._settings.steering.lookahead_m)
        return Factors(
            support=sum(min(1.0, one.excess / evidence.full_excess) for one in seen) / len(seen),
            plausible=plausible * math.exp(-0.5 * (narrow**2 + outside**2)),
            tight=1 / (1 + (fit.residual / evidence.residual_limit) ** 4),
            sure=math.exp(-0.5 * (aim_sigma_m / evidence.aim_sigma_m) ** 2),
            trust=trust * evidence.edge_trust if fit.by_edges else trust,
            one_line=len(seen) == 1,
            by_edges=fit.by_edges,
            apart=fit.apart,
        )


def _aim_sigma_m(state: LaneState, lookahead_m: float) -> float:
    """Standard deviation [m] of the lane centre at the look-ahead, from the covariance of the state."""
    gradient = ahead_gradient(lookahead_m)
    return math.sqrt(max(0.0, float(gradient @ state.covariance @ gradient)))
