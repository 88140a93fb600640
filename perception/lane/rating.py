"""Score and probability of a lane with the settings of the estimator."""

from dataclasses import dataclass

from perception.lane.model.confidence import Features, features, probability
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import LaneState
from perception.lane.model.score import Factors, factors_of
from perception.lane.settings import LaneCvSettings


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
        prior, evidence = self._settings.prior, self._settings.evidence
        factors = factors_of(
            fit,
            width_m=evidence.road_width_m if fit.by_edges else prior.width_m,
            width_sigma_m=evidence.road_width_sigma_m if fit.by_edges else prior.width_sigma_m,
            lookahead_m=self._settings.steering.lookahead_m,
            settings=evidence,
        )
        return Candidate(fit, factors, factors.score)

    def features(self, factors: Factors, lane: LaneState, *, looks: int) -> Features:
        """Inputs of the probability of ``lane`` after ``looks`` detections in a row."""
        clothoid = lane.clothoid
        return features(
            factors,
            looks=looks / self._settings.evidence.sure_looks,
            heading_rad=clothoid.heading_rad,
            curvature_1pm=clothoid.curvature_at(self._settings.steering.lookahead_m),
        )

    def probability(self, features: Features) -> float:
        """The probability that a detected lane is right."""
        return probability(features, self._settings.confidence)

    def probability_of(self, candidate: Candidate, *, looks: int) -> float:
        """The probability that ``candidate`` is right after ``looks`` detections in a row."""
        return self.probability(self.features(candidate.factors, candidate.fit.state, looks=looks))
