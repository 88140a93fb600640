"""A Hough transform on the road: every point votes for its lateral place under many lane shapes."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.lane.model.geometry import KAPPA, PSI, WIDTH, E, LaneState, RoadPoints
from trepid.config import Settings
from trepid.types import Array, NonNegative, Positive

MIN_SIGMA = np.array([0.15, 0.03, 0.01, 0.0, 0.15, 0.0])  # of the state; leaves room for a search
BLOCK = 16384  # distances computed at once


class VoteSettings(Settings):
    """One stage of ``vote`` in ``config/perception.yaml``: the lane shapes of the search."""

    heading_range_rad: NonNegative
    heading_steps: Annotated[int, Field(ge=1)]
    curvature_range_1pm: NonNegative
    curvature_steps: Annotated[int, Field(ge=1)]
    bin_m: Positive
    reach_m: Positive


def vote_lane(
    points: RoadPoints,
    guess: Array,
    prior: LaneState,
    settings: VoteSettings,
    *,
    bands: int,
    prior_weight: float,
) -> tuple[Array, float]:
    """The state ``guess`` with the lane shape (ψ, κ) and the lateral places (e, W) of most points, and its support.

    A Hough transform in road coordinates: for each (ψ, κ) the points are binned by their exact distance to
    the circle through the rear axle; the score of a pair of bins is the sum of both, plus the smaller one
    (two half lines beat one long line), minus a penalty for deviations from ``guess`` in standard deviations of
    ``prior``. Support 1 is about one point in every row. Deterministic.
    """
    near = points.x_m < settings.reach_m
    x_m, y_m, weight = points.x_m[near], points.y_m[near], points.weight[near]
    sigma = np.maximum(np.sqrt(np.diag(prior.covariance)), MIN_SIGMA)
    heading = guess[PSI] + _steps(settings.heading_range_rad, settings.heading_steps)
    curvature = guess[KAPPA] + _steps(settings.curvature_range_1pm, settings.curvature_steps)
    half_m = guess[WIDTH] / 2 + 2 * sigma[WIDTH] + abs(guess[E]) + 2 * sigma[E]
    counts = _histograms(x_m, y_m, weight / max(bands, 1), heading, curvature, half_m, settings.bin_m)
    unlikely = ((heading - guess[PSI]) / sigma[PSI])[:, None] ** 2
    unlikely = unlikely + ((curvature - guess[KAPPA]) / sigma[KAPPA]) ** 2
    support, shape, left_m, width_m = _best_pair(
        counts, prior_weight * unlikely.ravel(), guess, sigma, half_m, settings.bin_m, prior_weight
    )
    at_heading, at_curvature = divmod(shape, len(curvature))
    voted = guess.copy()
    voted[E], voted[WIDTH] = width_m / 2 - left_m, width_m
    voted[PSI], voted[KAPPA] = heading[at_heading], curvature[at_curvature]
    return voted, support


def _steps(half_range: float, count: int) -> Array:
    return np.linspace(-half_range, half_range, count) if count > 1 else np.zeros(1)


def _histograms(
    x_m: Array, y_m: Array, weight: Array, heading: Array, curvature: Array, half_m: float, bin_m: float
) -> Array:
    """Weight per bin of signed distance to the circle (ψ, κ) through the origin; shape (bins, ψ·κ).

    The headings are processed in blocks, because numpy allocates and clears pages for each larger array.
    """
    bins = int(np.ceil(2 * half_m / bin_m))
    block = max(1, BLOCK // max(1, len(curvature) * len(x_m)))
    counted = np.concatenate(
        [
            _count_votes(x_m, y_m, weight, heading[first : first + block], curvature, half_m, bin_m, bins)
            for first in range(0, len(heading), block)
        ],
        axis=1,
    )
    counted[0] = counted[-1] = 0
    return np.asarray(counted[1:-1] + 0.5 * (counted[:-2] + counted[2:]), np.float64)


def _count_votes(
    x_m: Array,
    y_m: Array,
    weight: Array,
    heading: Array,
    curvature: Array,
    half_m: float,
    bin_m: float,
    bins: int,
) -> Array:
    """Weight per bin and shape, with a bin at each end for the places beyond; shape (bins + 2, ψ·κ)."""
    across = y_m * np.cos(heading)[:, None] + x_m * np.sin(heading)[:, None]
    kappa = curvature[:, None]
    square = x_m * x_m + y_m * y_m
    root = 2 * kappa * across[:, None, :]
    np.subtract(1, root, out=root)
    root += kappa**2 * square
    np.sqrt(np.maximum(root, 0.04, out=root), out=root)
    root += 1
    place = 2 * across[:, None, :] - kappa * square
    place /= root
    place += half_m
    place *= 1 / bin_m
    np.minimum(np.maximum(place, -1, out=place), bins, out=place)
    shapes = len(heading) * len(curvature)
    index = place.astype(np.int64).reshape(shapes, -1)
    index += 1
    index *= shapes
    index += np.arange(shapes)[:, None]
    counted = np.bincount(index.ravel(), weights=np.tile(weight, shapes), minlength=shapes * (bins + 2))
    return np.asarray(counted.reshape(bins + 2, shapes), np.float64)


def _best_pair(
    counts: Array,
    shape_cost: Array,
    guess: Array,
    sigma: Array,
    half_m: float,
    bin_m: float,
    prior_weight: float,
) -> tuple[float, int, float, float]:
    """The best score, its lane shape, the place of its left line and the width of its lane [m]."""
    bins = len(counts)
    low = max(1, math.floor((guess[WIDTH] - 2 * sigma[WIDTH]) / bin_m))
    high = min(bins - 1, max(low, math.ceil((guess[WIDTH] + 2 * sigma[WIDTH]) / bin_m)))
    width, right = np.arange(low, high + 1)[:, None], np.arange(bins - low)
    left = np.minimum(width + right, bins - 1)
    place_m, width_m = (np.arange(bins) + 0.5) * bin_m - half_m, width * bin_m
    aside = np.abs(place_m[left] - width_m / 2 + guess[E]) / sigma[E]
    unlikely = aside**2 + 4 * np.maximum(aside - 0.4 * width_m / sigma[E], 0) ** 2
    unlikely += ((width_m - guess[WIDTH]) / sigma[WIDTH]) ** 2
    unlikely[(aside >= 3) | (width + right >= bins)] = math.inf
    on_left, on_right = counts[left], counts[right]
    score = np.minimum(on_left, on_right)
    score += on_left
    score += on_right
    score -= shape_cost
    score -= (prior_weight * unlikely)[:, :, None]
    pair, shape = divmod(int(score.argmax()), len(shape_cost))
    at_width, at_right = divmod(pair, len(right))
    best = float(score[at_width, at_right, shape])
    return best, shape, float(place_m[left[at_width, at_right]]), float(width_m[at_width, 0])
