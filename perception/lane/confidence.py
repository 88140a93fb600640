"""How probable it is, by the evidence, that the road-wheel angle of a lane is within two degrees of right."""

import math

from perception.lane.evidence import Belief
from trepid.config import Settings

ASKEW_RAD, BENT_1PM = 0.15, 0.05
LEAST_FACTOR = 1e-3  # of what a lane is believed for: below, nothing gets worse


class ConfidenceSettings(Settings):
    """Section ``confidence`` of ``config/perception.yaml``: weights of a logistic regression."""

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


def grounds(belief: Belief, *, looks: float, heading_rad: float, curvature_1pm: float) -> tuple[float, ...]:
    """What the confidence rests on, in the order of the weights: 1, logarithms of factors, and what makes it hard.

    ``looks``: share 0..1 of the frames in a row after which a lane is no chance find: a picture can have the
    outline of a road, but does not move like one. Who keeps a lane is seldom much askew in it. Edges between
    much the same on both sides are of snow that was driven on, of shadows or of dirt.
    """
    bend = min(abs(curvature_1pm) / BENT_1PM, 2.0)
    return (
        1.0,
        _log(belief.support),
        _log(belief.plausible),
        _log(belief.tight),
        _log(belief.sure),
        float(belief.one_line),
        float(belief.by_edges),
        1.0 - looks,
        min((heading_rad / ASKEW_RAD) ** 2, 4.0),
        bend,
        bend * belief.by_edges,
        belief.apart,
    )


def confidence(grounds: tuple[float, ...], weights: ConfidenceSettings) -> float:
    """1/(1 + exp(−w·x)): logistic regression of Platt (1999) on all grounds at once."""
    total = sum(w * x for w, x in zip(vars(weights).values(), grounds, strict=True))
    return 1 / (1 + math.exp(-min(max(total, -30.0), 30.0)))


def _log(factor: float) -> float:
    return math.log(max(factor, LEAST_FACTOR))
