"""Which two boundaries of a street enclose the lane of the car.

Boundaries are the peaks of a profile (:mod:`.profile`): lines, and steps of the surface such as kerbs. Every pair
with the car between them is a hypothesis. Its weight is the product of the densities of its width and of the place
of the car, the probability that both boundaries are real, and factors below 1 for a line or another surface inside.
The height of the camera is marginal: a lane of W camera heights is W·h wide.

Two ends of the road without a line between them enclose one lane, or a road for both ways, whose half on the side
of the traffic is the lane. A step is an end, and so is a line beyond which another surface lies: kerbs look like
lines in masks, and rural roads have lines at their edges alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from perception.lane.street.profile import Profile
from perception.lane.street.settings import PairSettings
from trepid.types import Array


class BoundaryKind(StrEnum):
    LINE = "line"
    STEP = "step"
    MIDDLE = "middle"  # of a road for both ways without a line: no pixel shows it


@dataclass(frozen=True)
class Boundary:
    """A line or a step along the course."""

    left_m: float
    kind: BoundaryKind
    strength: float  # share of the rows with paint; mean step
    probability: float  # that it bounds a lane


@dataclass(frozen=True)
class Pair:
    """Two boundaries with the car between them."""

    left: Boundary
    right: Boundary
    probability: float  # among all pairs and none of them
    height: float  # mean factor of the height of the camera, given this pair
    # Probability that a road between its ends is not for both ways, by the width alone: where the car stands says
    # nothing, because a car that drives in the middle of a road stays there.
    one_lane: float = 1.0

    @property
    def width_m(self) -> float:
        """Distance of the boundaries, at the height of the belief."""
        return self.left.left_m - self.right.left_m

    @property
    def offset_m(self) -> float:
        """Place of the car left of the middle."""
        return -(self.left.left_m + self.right.left_m) / 2


def boundaries(profile: Profile, settings: PairSettings) -> list[Boundary]:
    """Lines and steps of ``profile``, from left to right. A step beside a line belongs to the line."""
    reach = max(1, round(settings.apart_m / abs(float(profile.left_m[1] - profile.left_m[0]))))
    line = np.where(profile.seen, profile.line, 0.0)
    step = np.where(profile.seen, np.abs(profile.step), 0.0)
    lines = [
        Boundary(
            float(profile.left_m[at]),
            BoundaryKind.LINE,
            float(line[at]),
            1 - math.exp(-float(line[at]) / settings.full_line),
        )
        for at in _peaks(line, settings.min_line, reach)
    ]
    steps = [
        Boundary(
            float(profile.left_m[at]),
            BoundaryKind.STEP,
            float(step[at]),
            settings.step_trust * (1 - math.exp(-float(step[at]) / settings.full_step)),
        )
        for at in _peaks(step, settings.min_step, reach)
    ]
    steps = [one for one in steps if all(abs(one.left_m - line.left_m) > settings.apart_m for line in lines)]
    return sorted(lines + steps, key=lambda one: -one.left_m)


def _peaks(values: Array, least: float, reach: int) -> list[int]:
    """Places of maxima of at least ``least``, none higher within ``reach``; of equal neighbours the middle."""
    highest = [
        at
        for at in np.flatnonzero(values >= least).tolist()
        if values[at] == values[max(0, at - reach) : at + reach + 1].max()
    ]
    plateaus: list[list[int]] = []
    for at in highest:
        if plateaus and at - plateaus[-1][-1] <= reach:
            plateaus[-1].append(at)
        else:
            plateaus.append([at])
    return [plateau[len(plateau) // 2] for plateau in plateaus]


def pairs(
    profile: Profile,
    found: Sequence[Boundary],
    settings: PairSettings,
    *,
    height_sigma: float,
    on_left: float = 0.5,
    before: Sequence[Pair] = (),
) -> list[Pair]:
    """All pairs with the car between them, the most probable first.

    ``height_sigma``: standard deviation of the logarithm of the height of the camera; ``on_left``: probability of
    left-hand traffic. With the pairs ``before`` of the last frame, moved to this one, it is a step of a filter: the
    evidence of a frame counts with the exponent ``evidence_of_frame``, because frames share their errors, and the
    weight of a pair is multiplied by the probability that it was the lane before.
    """
    height = np.exp(np.linspace(-2, 2, 9) * height_sigma)
    belief = np.exp(-0.5 * np.linspace(-2, 2, 9) ** 2)
    belief /= belief.sum()
    weighted: list[Pair] = []  # with weights in place of probabilities
    for left in found:
        for right in found:
            if left.left_m < -settings.margin_m or right.left_m > settings.margin_m:
                continue
            if left.left_m - right.left_m < 2 * settings.margin_m:
                continue
            ends = _end(profile, left, 1, settings) * _end(profile, right, -1, settings)
            of_lane = _lane_width(left, right, settings, height, ends)
            of_road = ends * _road_width(left, right, settings, height)
            both_ways, one_way = float(belief @ of_road), float(belief @ of_lane)
            one_lane = 1 - ends * both_ways / (ends * one_way + both_ways) if both_ways else 1.0
            weight = of_lane * _weight(profile, left, right, settings, height, on_left)
            weights = [(left, right, weight, one_lane)]
            if both_ways:
                halves = _halves(profile, left, right, settings, height, on_left)
                weights += [(one, other, of_road * weight, 1.0) for one, other, weight in halves]
            for one, other, weight, single in weights:
                if (total := float(belief @ weight)) > 0:
                    mean = float((belief * weight) @ height) / total
                    weighted.append(Pair(one, other, total, mean, single))
    none = settings.none
    if before:
        none = none**settings.evidence_of_frame * (
            1 - sum(one.probability for one in before) + settings.forget
        )
        weighted = [
            replace(
                one,
                probability=one.probability**settings.evidence_of_frame
                * _was(one.left, one.right, before, settings),
            )
            for one in weighted
        ]
    everything = none + sum(one.probability for one in weighted)
    chosen = [replace(one, probability=one.probability / everything) for one in weighted]
    return sorted(chosen, key=lambda one: -one.probability)


def _weight(
    profile: Profile, left: Boundary, right: Boundary, settings: PairSettings, height: Array, on_left: float
) -> Array:
    """Weight of a pair at each height, without that of its width."""
    offset_m = -(left.left_m + right.left_m) / 2 * height
    of_place = np.exp(-0.5 * (offset_m / settings.offset_sigma_m) ** 2)
    return np.asarray(
        of_place
        * left.probability
        * right.probability
        * _plain(profile, left, right, settings)
        * _side(left, right, settings, on_left)
    )


def _lane_width(left: Boundary, right: Boundary, settings: PairSettings, height: Array, ends: float) -> Array:
    """Density of the width as that of one lane, at each height, up to 1/√(2π).

    Between ``ends`` of the road, a probability, lines are as often kerbs, whose distance varies more.
    """
    lines = (left.kind == BoundaryKind.LINE) + (right.kind == BoundaryKind.LINE)
    of_road = _density(left, right, height, settings.road_width_m, settings.road_width_sigma_m)
    if not lines:
        return of_road
    sigma_m = settings.width_sigma_m if lines == 2 else settings.kerb_width_sigma_m
    of_lane = _density(left, right, height, settings.width_m, sigma_m)
    return np.asarray(of_lane + ends / 2 * (of_road - of_lane))


def _road_width(left: Boundary, right: Boundary, settings: PairSettings, height: Array) -> Array:
    """Density of the width as that of a road for both ways, at each height, up to 1/√(2π)."""
    return _density(left, right, height, settings.both_ways_m, settings.both_ways_sigma_m)


def _density(left: Boundary, right: Boundary, height: Array, middle_m: float, sigma_m: float) -> Array:
    """N(width; middle, σ²) at each height, up to 1/√(2π)."""
    width_m = (left.left_m - right.left_m) * height
    return np.asarray(np.exp(-0.5 * ((width_m - middle_m) / sigma_m) ** 2) / sigma_m)


def _end(profile: Profile, boundary: Boundary, side: int, settings: PairSettings) -> float:
    """Probability that the road ends at its left (``side`` 1) or right (−1) ``boundary``.

    Of a line it rises from 0 to 1 with the share s of another surface right beyond, 2·s − 1: vehicles hide less
    than half of an oncoming lane, and at the line of a cycle lane the road does not end. What is not seen is road.
    """
    if boundary.kind == BoundaryKind.STEP:
        return 1.0
    beyond_m = side * (profile.left_m - boundary.left_m)
    beside = (beyond_m > settings.apart_m) & (beyond_m < 3 * settings.apart_m)
    return max(0.0, 2 * float((profile.other * profile.seen)[beside].mean()) - 1) if beside.any() else 0.0


def _halves(
    profile: Profile, left: Boundary, right: Boundary, settings: PairSettings, height: Array, on_left: float
) -> list[tuple[Boundary, Boundary, Array]]:
    """The halves of a road for both ways between two ends, each with its weight, without that of the width.

    The car is in its half. A half is the lane with the probability of traffic on its side.
    """
    both = left.probability * right.probability * _plain(profile, left, right, settings)
    middle = Boundary((left.left_m + right.left_m) / 2, BoundaryKind.MIDDLE, 0.0, both)
    found = []
    for one, other, share in ((left, middle, on_left), (middle, right, 1 - on_left)):
        if one.left_m < -settings.margin_m or other.left_m > settings.margin_m:
            continue
        offset_m = -(one.left_m + other.left_m) / 2 * height
        of_place = np.exp(-0.5 * (offset_m / settings.offset_sigma_m) ** 2)
        found.append((one, other, share * both * of_place))
    return found


def _plain(profile: Profile, left: Boundary, right: Boundary, settings: PairSettings) -> float:
    """Factor for what lies between two boundaries: no line, step or other surface belongs into a lane."""
    margin = settings.apart_m
    within = profile.seen & (profile.left_m < left.left_m - margin) & (profile.left_m > right.left_m + margin)
    if not within.any():
        return 1.0
    line, step = profile.line[within].max(), np.abs(profile.step[within]).max()
    other = float(profile.other[within].mean())
    return math.exp(
        -settings.line_within * float(line)
        - settings.step_within * float(step)
        - settings.other_within * other
    )


def chosen_share(ranked: Sequence[Pair], settings: PairSettings) -> float:
    """Share of the first pair, and of those at the same place, in the probability of all of them; of none 0."""
    every = sum(one.probability for one in ranked)
    return _of_place(ranked[0].left, ranked[0].right, ranked, settings) / every if every else 0.0


def _was(left: Boundary, right: Boundary, before: Sequence[Pair], settings: PairSettings) -> float:
    """Probability that these boundaries were the lane of the frame before, and at least ``forget``."""
    return settings.forget + _of_place(left, right, before, settings)


def _of_place(left: Boundary, right: Boundary, among: Sequence[Pair], settings: PairSettings) -> float:
    """Probability of the pairs with these boundaries: Σ p·exp(-(Δl² + Δr²)/(2·σ²)) with σ = ``same_place_m``."""
    return sum(
        one.probability
        * math.exp(
            -0.5
            * ((left.left_m - one.left.left_m) ** 2 + (right.left_m - one.right.left_m) ** 2)
            / settings.same_place_m**2
        )
        for one in among
    )


def _side(left: Boundary, right: Boundary, settings: PairSettings, on_left: float) -> float:
    """Factor for the kinds of the boundaries: a kerb beside a line is on the side of the traffic."""
    if left.kind == right.kind:
        return 1.0 if left.kind == BoundaryKind.LINE else settings.kerbs_only
    own = on_left if left.kind == BoundaryKind.STEP else 1 - on_left
    return own + (1 - own) * settings.wrong_side


def kerb_side(pair: Pair, profile: Profile, settings: PairSettings) -> int:
    """The side of the traffic that ``pair`` shows: 1 left, −1 right, 0 neither.

    A kerb on one side, and a line with road for another lane beyond it on the other.
    """
    if {pair.left.kind, pair.right.kind} != {BoundaryKind.LINE, BoundaryKind.STEP}:
        return 0
    side = 1 if pair.left.kind == BoundaryKind.STEP else -1
    line = pair.right if side > 0 else pair.left
    aside_m = side * (line.left_m - profile.left_m)
    beyond = profile.seen & (aside_m > settings.apart_m) & (aside_m < pair.width_m)
    return side if beyond.any() and float(profile.other[beyond].mean()) < settings.other_road else 0
