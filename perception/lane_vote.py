"""Finding the lane among scattered points: every point votes for its lateral place under many lane shapes."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane_points import RoadPoints
from trepid.config import Settings

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]


class VoteSettings(Settings):
    """One stage of ``vote`` in ``config/perception.yaml``: which lane shapes are tried."""

    heading_range_rad: Annotated[float, Field(ge=0)]
    heading_steps: Annotated[int, Field(ge=1)]
    curvature_range_1pm: Annotated[float, Field(ge=0)]
    curvature_steps: Annotated[int, Field(ge=1)]
    bin_m: Positive
    reach_m: Positive


@dataclass(frozen=True)
class LaneGuess:
    """What is known of the lane before or after a vote, with standard deviations."""

    offset_m: float
    heading_rad: float
    curvature_1pm: float
    width_m: float
    offset_sigma_m: float
    heading_sigma_rad: float
    curvature_sigma_1pm: float
    width_sigma_m: float
    support: float = 1.0  # score of the winner: 1 = about one point in every row


def vote_lane(
    points: RoadPoints, guess: LaneGuess, settings: VoteSettings, *, bands: int, prior_weight: float
) -> LaneGuess:
    """The lane shape (ψ, κ) and the pair of lateral places (e, W) with most points on both lines.

    A Hough transform in road coordinates: for each (ψ, κ) the points are binned by their exact distance to the
    circle through the rear axle; the score of a pair of bins is the sum of both, plus the smaller one (two half
    lines beat one long one), minus what is unlikely under ``guess``. Deterministic: nothing is drawn by lot.
    """
    near = points.x_m < settings.reach_m
    x_m, y_m, weight = points.x_m[near], points.y_m[near], points.weight[near]
    heading = guess.heading_rad + _steps(settings.heading_range_rad, settings.heading_steps)
    curvature = guess.curvature_1pm + _steps(settings.curvature_range_1pm, settings.curvature_steps)
    half_m = guess.width_m / 2 + 2 * guess.width_sigma_m + abs(guess.offset_m) + 2 * guess.offset_sigma_m
    counts = _histograms(x_m, y_m, weight / max(bands, 1), heading, curvature, half_m, settings.bin_m)
    score, left_bin, width_bins = _best_pairs(counts, guess, half_m, settings.bin_m, prior_weight)
    score -= prior_weight * (
        ((heading - guess.heading_rad) / guess.heading_sigma_rad)[:, None] ** 2
        + ((curvature - guess.curvature_1pm) / guess.curvature_sigma_1pm)[None, :] ** 2
    )
    at_heading, at_curvature = np.unravel_index(int(np.argmax(score)), score.shape)
    left_m = (left_bin[at_heading, at_curvature] + 0.5) * settings.bin_m - half_m
    width_m = width_bins[at_heading, at_curvature] * settings.bin_m
    return LaneGuess(
        offset_m=float(width_m / 2 - left_m),
        heading_rad=float(heading[at_heading]),
        curvature_1pm=float(curvature[at_curvature]),
        width_m=float(width_m),
        offset_sigma_m=guess.offset_sigma_m,
        heading_sigma_rad=guess.heading_sigma_rad,
        curvature_sigma_1pm=guess.curvature_sigma_1pm,
        width_sigma_m=guess.width_sigma_m,
        support=float(score[at_heading, at_curvature]),
    )


def _steps(half_range: float, count: int) -> Array:
    return np.linspace(-half_range, half_range, count) if count > 1 else np.zeros(1)


def _histograms(
    x_m: Array, y_m: Array, weight: Array, heading: Array, curvature: Array, half_m: float, bin_m: float
) -> Array:
    """Weight per bin of signed distance to the circle (ψ, κ) through the origin; shape (ψ, κ, bins)."""
    bins = int(np.ceil(2 * half_m / bin_m))
    across = y_m * np.cos(heading)[:, None] + x_m * np.sin(heading)[:, None]
    kappa = curvature[None, :, None]
    square = x_m * x_m + y_m * y_m
    root = np.sqrt(np.maximum(1 - 2 * kappa * across[:, None, :] + kappa**2 * square, 0.04))
    distance = (2 * across[:, None, :] - kappa * square) / (1 + root)
    place = ((distance + half_m) * (1 / bin_m)).astype(np.int64)
    np.clip(place, -1, bins, out=place)
    place += 1
    shapes = len(heading) * len(curvature)
    place = place.reshape(shapes, -1) + (bins + 2) * np.arange(shapes)[:, None]
    counted = np.bincount(
        place.ravel(),
        weights=np.broadcast_to(weight, place.shape).ravel(),
        minlength=shapes * (bins + 2),
    ).reshape(shapes, bins + 2)
    counted[:, 0] = counted[:, -1] = 0
    smooth = counted[:, 1:-1] + 0.5 * (counted[:, :-2] + counted[:, 2:])
    return smooth.reshape(len(heading), len(curvature), bins)


def _best_pairs(
    counts: Array, guess: LaneGuess, half_m: float, bin_m: float, prior_weight: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """For each lane shape the best score, the bin of its left line and the width of the lane in bins."""
    bins = counts.shape[2]
    low = max(1, int(np.floor((guess.width_m - 2 * guess.width_sigma_m) / bin_m)))
    high = min(bins - 1, max(low, int(np.ceil((guess.width_m + 2 * guess.width_sigma_m) / bin_m))))
    width, left = np.meshgrid(np.arange(low, high + 1), np.arange(bins), indexing="ij")
    aside_m = np.abs((left + 0.5 - width / 2) * bin_m - half_m + guess.offset_m)
    possible = (left >= width) & (aside_m < 3 * guess.offset_sigma_m)
    left, width, aside_m = left[possible], width[possible], aside_m[possible]
    unlikely = (aside_m / guess.offset_sigma_m) ** 2
    unlikely += 4 * (np.maximum(aside_m - 0.4 * width * bin_m, 0) / guess.offset_sigma_m) ** 2
    unlikely += ((width * bin_m - guess.width_m) / guess.width_sigma_m) ** 2
    on_left, on_right = counts[:, :, left], counts[:, :, left - width]
    score = on_left + on_right + np.minimum(on_left, on_right) - prior_weight * unlikely
    best = np.argmax(score, axis=2)
    return np.max(score, axis=2), left[best], width[best]
