"""Steering by decision trees over both halves of the picture, Abdelrahman (inventory S14–S16; R [86])."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.techniques.image.picture import Boundaries, Boundary, View
from perception.techniques.steering.level_picture import (
    ImageAngle,
    LevelPicture,
    RoadWheel,
    lean,
    level_lines,
    road_wheel,
)
from perception.techniques.steering.straight_lane import ImageLine
from trepid.types import Positive


class Leaf(StrEnum):
    """Where a tree has ended."""

    BOTH = "both lines"
    ONLY_LEFT = "parallel to the left line, on its right"
    ONLY_RIGHT = "parallel to the right line, on its left"
    CROSSED_LEFT = "the left line was crossed: back to its right"
    CROSSED_RIGHT = "the right line was crossed: back to its left"
    NONE = "no line: straight"


@dataclass(frozen=True, slots=True)
class Lines:
    """The lines of one half of the picture."""

    left: ImageLine | None = None
    right: ImageLine | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """The leaf, and the line that the vehicle should be on; None for straight ahead."""

    leaf: Leaf
    centre: ImageLine | None


def lower_tree(
    seen: Lines,
    before: Lines,
    turned_rad: float,
    picture: LevelPicture,
    *,
    width_m: float,
    tolerance: float = 0.25,
) -> Outcome:
    """The tree of the lower half (S14).

    Two lines whose width h·(m_r − m_l) is that of a lane within ``tolerance``: their mean. Of a wrong pair, a
    vehicle that steers right (``turned_rad`` < 0) ignores the left line, and v.v.; one that goes straight
    believes the line nearer to where its side was ``before``. One line: was it, last step, the line of the
    other side? Then it was crossed, and the vehicle goes back to the side it came from; else it drives half a
    lane beside it. None: straight.

    The mirrored branches are not in print, nor is a rule for a wrong pair going straight. Printed, the output
    is the mean of the slopes dy/dx, ±78° at e = ±0.5 m; here the mean of m (S16). Cannot see: the heading.
    """
    left, right = seen.left, seen.right
    if left is not None and right is not None:
        width = picture.camera_height_m * (right.m - left.m)
        if abs(width / width_m - 1) <= tolerance:
            return Outcome(Leaf.BOTH, ImageLine((left.m + right.m) / 2, (left.k + right.k) / 2))
        if _ignore_left(left, right, before, turned_rad):
            left = None
        else:
            right = None
    half = width_m / 2
    if right is not None:
        if _was(right, before.left, before.right, picture, width_m):
            return Outcome(Leaf.CROSSED_LEFT, picture.beside(right, -half))
        return Outcome(Leaf.ONLY_RIGHT, picture.beside(right, half))
    if left is not None:
        if _was(left, before.right, before.left, picture, width_m):
            return Outcome(Leaf.CROSSED_RIGHT, picture.beside(left, half))
        return Outcome(Leaf.ONLY_LEFT, picture.beside(left, -half))
    return Outcome(Leaf.NONE, None)


def _ignore_left(left: ImageLine, right: ImageLine, before: Lines, turned_rad: float) -> bool:
    """Which line of a wrong pair goes: that of the side turned away from; straight, the one that has jumped."""
    if turned_rad != 0:
        return turned_rad < 0
    jump_left = abs(left.m - before.left.m) if before.left else np.inf
    jump_right = abs(right.m - before.right.m) if before.right else np.inf
    return bool(jump_left > jump_right)


def _was(
    line: ImageLine,
    other_side: ImageLine | None,
    same_side: ImageLine | None,
    picture: LevelPicture,
    width_m: float,
) -> bool:
    """``line`` was on the other side a step ago: nearer to that line than half a lane, and than to its own."""
    if other_side is None:
        return False
    jump = abs(line.m - other_side.m)
    near = jump < width_m / 2 / picture.camera_height_m
    return near and (same_side is None or jump < abs(line.m - same_side.m))


def upper_tree(upper: Lines, lower: Lines) -> Lines:
    """The upper lines without those that only go on from the lower line of the other side (S15).

    In a bend the left boundary reaches into the right half of the picture further up: an upper right line goes
    if (upper right and lower left and not lower right), and the mirror image. The text states the inverse,
    which would throw out the true right line, seen above and below, and keep the extension.
    """
    left, right = upper.left, upper.right
    if right is not None and lower.left is not None and lower.right is None:
        right = None
    if left is not None and lower.right is not None and lower.left is None:
        left = None
    return Lines(left, right)


def mean_angle(lower: Outcome, upper: Lines) -> ImageAngle:
    """Lean of the mean m of the lower centre line and of the upper pair, where it is left; 0 for none (S16)."""
    slopes = [lower.centre.m] if lower.centre is not None else []
    if upper.left is not None and upper.right is not None:
        slopes.append((upper.left.m + upper.right.m) / 2)
    return lean(ImageLine(float(np.mean(slopes)), 0.0)) if slopes else ImageAngle(0.0)


class Abdelrahman:
    """Road-wheel angle [rad], + left, by both trees; straight for ``blind_s`` without lines, then None (S16)."""

    def __init__(
        self,
        *,
        gain: Annotated[float, Field(gt=0, le=2)] = 0.2,
        width_m: Positive = 3.4,
        split_m: Positive = 10.0,
        blind_s: Positive = 0.5,
    ) -> None:
        self._gain, self._width_m, self._split_m, self._blind_s = gain, width_m, split_m, blind_s
        self._before, self._turned_rad, self._unseen_s = Lines(), 0.0, 0.0

    def step(self, boundaries: Boundaries, view: View, dt_s: float) -> RoadWheel | None:
        """The angle for this frame; the picture is split ``split_m`` ahead."""
        near, picture = _half(boundaries, view, 0.0, self._split_m)
        far, _ = _half(boundaries, view, self._split_m, np.inf)
        lower = lower_tree(near, self._before, self._turned_rad, picture, width_m=self._width_m)
        self._remember(near, lower, dt_s)
        if self._unseen_s > self._blind_s:
            return None
        angle = mean_angle(lower, upper_tree(far, near))
        self._turned_rad = angle
        return road_wheel(angle, gain=self._gain)

    def _remember(self, near: Lines, lower: Outcome, dt_s: float) -> None:
        """A crossed line stays the line of the side it was on, so that the way back lasts until it is crossed
        again.
        """
        if lower.leaf is Leaf.CROSSED_LEFT:
            self._before = Lines(left=near.right)
        elif lower.leaf is Leaf.CROSSED_RIGHT:
            self._before = Lines(right=near.left)
        elif lower.leaf is not Leaf.NONE:
            self._before = near
        self._unseen_s = self._unseen_s + dt_s if lower.leaf is Leaf.NONE else 0.0


def _half(boundaries: Boundaries, view: View, near_m: float, far_m: float) -> tuple[Lines, LevelPicture]:
    part = replace(
        boundaries,
        left=_between(boundaries.left, near_m, far_m),
        right=_between(boundaries.right, near_m, far_m),
    )
    left, right, picture = level_lines(part, view)
    return Lines(left, right), picture


def _between(boundary: Boundary | None, near_m: float, far_m: float) -> Boundary | None:
    if boundary is None:
        return None
    inside = (boundary.x_m >= near_m) & (boundary.x_m < far_m)
    if np.count_nonzero(inside) < 2:
        return None
    return replace(boundary, x_m=boundary.x_m[inside], y_m=boundary.y_m[inside])
