"""The probability that a lane is that of the car, from the search between heights and from the pairs of a street.

A logistic regression (Platt 1999) each for the lane of :mod:`perception.lane.unknown_camera` and for the pair of a
street, on their own probabilities, on what the other one says of them, and on the evidence of the boundaries. The
weights come from drawn streets and roads with unknown cameras.
"""

import math
from collections.abc import Sequence

from perception.lane.detection.marks import Marks
from perception.lane.street.settings import SearchedWeights, StreetWeights

MAX_LOGIT, MAX_OFFSET_M = 5.0, 2.0


def logit(probability: float) -> float:
    """log(p/(1 − p)), within ±``MAX_LOGIT``."""
    least = 1 / (1 + math.exp(MAX_LOGIT))
    inside = min(max(probability, least), 1 - least)
    return math.log(inside / (1 - inside))


def searched_features(
    probability: float,
    *,
    marked: bool,
    offset_m: float,
    agreement: float,
    street: float,
    shown: float,
    marks: Marks,
) -> tuple[float, ...]:
    """In the order of :class:`SearchedWeights`.

    ``street``: probability of the pair; ``agreement`` with it; ``shown``: as
    :func:`perception.lane.detection.shown.visible_share`; ``marks``: of the lane.
    """
    return (
        1.0,
        logit(probability),
        float(marked),
        min(abs(offset_m), MAX_OFFSET_M),
        agreement * street,
        (1 - agreement) * street,
        shown,
        *marks,
    )


def street_features(
    probability: float,
    *,
    steps: int,
    uneven: float,
    offset_m: float,
    agreement: float,
    searched: float,
    shown: float,
    along: float,
) -> tuple[float, ...]:
    """In the order of :class:`StreetWeights`.

    ``steps``: number of boundaries that are no lines; ``uneven``: as
    :func:`perception.lane.detection.evenness.unevenness`; ``searched``: probability of the lane of the search
    between heights; ``agreement`` with it; ``shown``: as :func:`perception.lane.detection.shown.visible_share`;
    ``along``: of its :class:`perception.lane.detection.marks.Marks`.
    """
    return (
        1.0,
        logit(probability),
        float(steps),
        min(max(uneven, -1.0), 2.0),
        min(abs(offset_m), MAX_OFFSET_M),
        agreement * searched,
        (1 - agreement) * searched,
        shown,
        along,
    )


def either(probability: float, other: float, *, agreement: float) -> float:
    """1 − (1 − p)·(1 − a·q): probability that at least one of two lanes is right, whose agreement is a."""
    return 1 - (1 - probability) * (1 - agreement * other)


def probability_of(features: Sequence[float], weights: SearchedWeights | StreetWeights) -> float:
    """1/(1 + exp(−w·x))."""
    total = sum(w * x for w, x in zip(vars(weights).values(), features, strict=True))
    return 1 / (1 + math.exp(-min(max(total, -30.0), 30.0)))
