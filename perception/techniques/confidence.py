"""The confidence of a pipeline's estimate, from the evidence of its boundaries."""

import math

import numpy as np

from perception.techniques.image.picture import Boundaries, Evidence, Kind, MeasuredLane
from perception.techniques.recipe import Recipe

RESIDUAL_M = 0.15  # scatter of the evidence that halves the score: the width of a line
ASIDE_M = 0.5  # σ of the distance by which the path leads out of the lane
ONE_SIDE = 0.6  # score of a lane with one boundary
ON_M, WIDE_M, CLEAR_TO_M = 0.3, 3.0, 20.0  # half width of a boundary; of the search area; its reach
MURKY, CLEAR = 0.45, 0.85  # shares of the features on the boundaries; white noise reaches 0.2 to 0.3


def lane_score(boundaries: Boundaries, measured: MeasuredLane, recipe: Recipe) -> float:
    """0..1: support × small residual × plausible width × a lane that contains the vehicle, now and ahead."""
    sides = [side for side, _ in boundaries.found]
    support = math.prod(side.support for side in sides) ** (1 / len(sides))
    residual = max(side.residual_m for side in sides)
    fits = 1 / (1 + (residual / RESIDUAL_M) ** 2)
    if measured.width_m is None:
        plausible = ONE_SIDE
    else:
        plausible = math.exp(-0.5 * ((measured.width_m - recipe.width_m) / recipe.width_sigma_m) ** 2)
    farther_m = max(abs(measured.lane.offset_m), abs(measured.lane.y_m(recipe.inside_m)))
    inside = math.exp(-0.5 * (max(0.0, farther_m - recipe.width_m / 2) / ASIDE_M) ** 2)
    return min(1.0, support) * fits * plausible * inside


def clarity(evidence: Evidence, boundaries: Boundaries) -> float:
    """0..1: how empty the lane is of the features of its boundaries; noise and texture fill it, paint does not.

    With the shares of line features up to ``CLEAR_TO_M`` ahead that lie on the boundaries, a, and between them or
    on the lane side of a single one, b: a/(a + b), scaled from ``MURKY`` (0) to ``CLEAR`` (1). 1 for regions.
    """
    if evidence.features.kind is not Kind.LINE or not boundaries.seen:
        return 1.0
    rows, columns = np.nonzero(evidence.features.response)
    x_m, y_m = evidence.view.ground(np.column_stack([columns, rows])).T
    ahead = (x_m > 0) & (x_m < CLEAR_TO_M)
    to_right, to_left = np.full(len(x_m), WIDE_M / 2), np.full(len(x_m), WIDE_M / 2)
    if boundaries.left is not None:
        to_left = boundaries.left.at(x_m) - y_m
    if boundaries.right is not None:
        to_right = y_m - boundaries.right.at(x_m)
    with np.errstate(invalid="ignore"):  # NaN beyond the ends of a boundary: neither
        on = ahead & ((np.abs(to_left) < ON_M) | (np.abs(to_right) < ON_M))
        between = ahead & (to_left >= ON_M) & (to_right >= ON_M) & (np.abs(y_m) < WIDE_M)
    total = np.count_nonzero(on) + np.count_nonzero(between)
    share = np.count_nonzero(on) / total if total else 1.0
    return float(np.clip((share - MURKY) / (CLEAR - MURKY), 0, 1))
