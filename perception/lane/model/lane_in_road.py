"""Where a lane lies within a road: from the lane between lines to the road between its edges, and back.

The road extends beyond the lane by a shoulder on each side and, where it has two lanes, by the neighbouring
lane.
"""

import math
from functools import partial

import numpy as np

from perception.lane.model.evidence import EvidenceSettings
from perception.lane.model.geometry import WIDTH, E, LaneState
from perception.lane.model.prior import PriorSettings
from trepid.types import Array


def road_around(lane: LaneState, prior: PriorSettings) -> LaneState:
    """The road of one lane around ``lane``: wider by both shoulders, whose widths are known only roughly."""
    covariance = with_own_sigma(lane.covariance, WIDTH, prior.shoulder_sigma_m)
    covariance[E, E] += (prior.shoulder_sigma_m / 2) ** 2
    mean = lane.mean.copy()
    mean[WIDTH] += 2 * prior.shoulder_m
    return LaneState(mean=mean, covariance=covariance)


def with_neighbour(road: LaneState, lane: LaneState, side: int) -> LaneState:
    """``road`` widened by a second lane as wide as ``lane`` on the left (side 1) or right (−1); 0: unchanged."""
    mean, width_m = road.mean.copy(), float(lane.mean[WIDTH])
    mean[E] -= side * width_m / 2
    mean[WIDTH] += abs(side) * width_m
    return LaneState(mean=mean, covariance=road.covariance)


def lane_within(road: LaneState, prior: PriorSettings) -> LaneState:
    """The lane within ``road`` that contains the vehicle, at most as wide as the prior of a lane."""
    covariance = with_own_sigma(road.covariance, WIDTH, prior.width_sigma_m)
    mean = road.mean.copy()
    spare_m = max(0.0, mean[WIDTH] - prior.width_m)
    covariance[E, E] += (spare_m / 2) ** 2
    covariance = with_max_sigma(covariance, E, prior.offset_sigma_m)
    limit_m = min(spare_m, prior.width_m) / 2
    mean[E] = math.copysign(max(0.0, abs(mean[E]) - limit_m), mean[E])
    mean[WIDTH] = min(mean[WIDTH], prior.width_m)
    return LaneState(mean=mean, covariance=covariance)


def half_with_vehicle(road: LaneState, prior: PriorSettings) -> LaneState | None:
    """The half of a two-lane ``road`` that contains the vehicle; None when the vehicle is near the road centre."""
    mean = road.mean.copy()
    road_m = float(mean[WIDTH])
    mean[WIDTH] = road_m / 2 - prior.shoulder_m
    mean[E] -= math.copysign(road_m / 4, mean[E])
    if abs(mean[E]) > prior.offset_sigma_m:
        return None
    covariance = with_own_sigma(road.covariance, WIDTH, prior.width_sigma_m)
    return LaneState(mean=mean, covariance=with_own_sigma(covariance, E, prior.offset_sigma_m))


def one_lane_probability(
    width_m: float, offset_m: float | None, prior: PriorSettings, evidence: EvidenceSettings
) -> float:
    """Probability that a road between edges, ``width_m`` wide with the vehicle at ``offset_m``, is one lane.

    Bayes with equal priors for one lane and two. One lane is ``evidence.road_width_m`` wide, with the vehicle in
    its middle; two lanes are ``prior.road_width_m`` wide, with the vehicle in the middle of one of them, a quarter
    of the width aside. ``offset_m`` None: by the width alone.
    """
    place, wide, narrow = (
        partial(_density, sigma=sigma)
        for sigma in (prior.offset_sigma_m, prior.road_width_sigma_m, evidence.road_width_sigma_m)
    )
    one, two = narrow(width_m - evidence.road_width_m), wide(width_m - prior.road_width_m)
    if offset_m is not None:
        one *= place(offset_m)
        two *= (place(offset_m - width_m / 4) + place(offset_m + width_m / 4)) / 2
    return one / (one + two) if one > 0 else 0.0


def _density(deviation: float, sigma: float) -> float:
    """N(deviation; 0, σ²) up to the factor 1/√(2π)."""
    return math.exp(-0.5 * (deviation / sigma) ** 2) / sigma


def along_road(lane: LaneState, road: LaneState) -> LaneState:
    """``lane`` with its own offset and width and the heading, bend and pitch of ``road``."""
    own = np.array([E, WIDTH])
    mean, covariance = road.mean.copy(), road.covariance.copy()
    mean[own] = lane.mean[own]
    covariance[own, :] = covariance[:, own] = 0.0
    covariance[np.ix_(own, own)] = lane.covariance[np.ix_(own, own)]
    return LaneState(mean=mean, covariance=covariance)


def with_max_sigma(covariance: Array, index: int, sigma: float) -> Array:
    """``covariance`` with one standard deviation reduced to ``sigma`` where it is greater.

    D·P·D with a diagonal D keeps the correlations, and with them positive definiteness.
    """
    shrink = np.ones(len(covariance))
    shrink[index] = min(1.0, sigma / math.sqrt(covariance[index, index]))
    return covariance * np.outer(shrink, shrink)


def with_own_sigma(covariance: Array, index: int, sigma: float) -> Array:
    """``covariance`` with one element of the state known to ``sigma``, uncorrelated with the others."""
    own = covariance.copy()
    own[index, :] = own[:, index] = 0.0
    own[index, index] = sigma**2
    return own
