"""The probability that the road-wheel angle of a lane is within two degrees of the right one.

A logistic regression (Platt 1999) on the factors of the score and on conditions under which lanes are wrong
more often. The confidence of an estimate is this probability, reduced while the lane is not detected.
"""

import math

from perception.lane.model.score import Factors
from trepid.config import Settings

ASKEW_RAD, BENT_1PM = 0.15, 0.05  # units of heading error and curvature
MIN_FACTOR = 1e-3  # smaller factors count as this

Features = tuple[float, ...]  # in the order of the fields of ConfidenceSettings


class ConfidenceSettings(Settings):
    """Section ``confidence`` of ``config/perception.yaml``: weights of the logistic regression."""

    bias: float
    support: float
    plausible: float
    tight: float
    sure: float
    one_line: float
    by_edges: float
    looks: float
    askew: float
    bend: float
    bent_edges: float
    apart: float


def features(factors: Factors, *, looks: float, heading_rad: float, curvature_1pm: float) -> Features:
    """Inputs of the regression in the order of its weights: 1, log factors, conditions.

    ``looks``: number of detections in a row over ``sure_looks``, 0..1; chance detections do not persist. A
    large heading error is rare in a lane that is kept. Edges with a small ``apart`` are often those of snow
    tracks, shadows or dirt.
    """
    bend = min(abs(curvature_1pm) / BENT_1PM, 2.0)
    return (
        1.0,
        _log(factors.support),
        _log(factors.plausible),
        _log(factors.tight),
        _log(factors.sure),
        float(factors.one_line),
        float(factors.by_edges),
        1.0 - looks,
        min((heading_rad / ASKEW_RAD) ** 2, 4.0),
        bend,
        bend * factors.by_edges,
        factors.apart,
    )


def probability(features: Features, weights: ConfidenceSettings) -> float:
    """1/(1 + exp(−w·x)) with the weights w and the features x; |w·x| is limited to 30."""
    total = sum(w * x for w, x in zip(vars(weights).values(), features, strict=True))
    return 1 / (1 + math.exp(-min(max(total, -30.0), 30.0)))


def _log(factor: float) -> float:
    return math.log(max(factor, MIN_FACTOR))
