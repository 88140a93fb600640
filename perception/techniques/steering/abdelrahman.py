"""Steering by decision trees over both halves of the picture, Abdelrahman (inventory S14–S16; R [86])."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from perception.techniques.image.picture import Boundaries, Boundary, GroundView
from perception.techniques.steering.rule import (
    Gain,
    Hold,
    ImageAngle,
    ImageLine,
    LevelPicture,
    RuleAngle,
    lean,
    level_lines,
    mean_line,
    road_wheel,
)
from trepid.types import Positive


class Leaf(StrEnum):
    """The leaves of the tree."""

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
    """The leaf, and the line to drive along; None for straight ahead."""

    leaf: Leaf
    centre: ImageLine | None


def lower_tree(
    lines: Lines,
    before: Lines,
    turned_rad: float,
    picture: LevelPicture,
    *,
    width_m: float,
    tolerance: float = 0.25,
) -> Outcome:
    """The tree of the lower half (S14).

    Two lines whose width h·(m_r − m_l) is that of a lane within ``tolerance``: their mean. Of a pair of another
    width, one line is ignored by :func:`implausibility`. One line: if it was the line of the other side in the last
    step (``before``), it was crossed, and the vehicle returns to the side it came from; else it drives half a lane
    beside it. None: straight.

    The mirrored branches are not in print, nor is a rule for a wrong pair while driving straight. Printed, the
    output is the mean of the slopes dy/dx; here the mean of m (S16). Limit: the heading.
    """
    left, right = lines.left, lines.right
    half_m = width_m / 2
    half_width = half_m / picture.camera_height_m  # in the unit of m
    if left is not None and right is not None:
        width = picture.camera_height_m * (right.m - left.m)
        wrong = implausibility(left, right, before, turned_rad, half_width)
        if abs(width / width_m - 1) <= tolerance or wrong == 0:
            return Outcome(Leaf.BOTH, mean_line(left, right))
        left, right = (None, right) if wrong > 0 else (left, None)
    if right is not None:
        if _was(right, before.left, before.right, half_width):
            return Outcome(Leaf.CROSSED_LEFT, picture.beside(right, -half_m))
        return Outcome(Leaf.ONLY_RIGHT, picture.beside(right, half_m))
    if left is not None:
        if _was(left, before.right, before.left, half_width):
            return Outcome(Leaf.CROSSED_RIGHT, picture.beside(left, half_m))
        return Outcome(Leaf.ONLY_LEFT, picture.beside(left, -half_m))
    return Outcome(Leaf.NONE, None)


def implausibility(
    left: ImageLine, right: ImageLine, before: Lines, turned_rad: float, half_width: float
) -> float:
    """Which line of a pair of the wrong width to ignore: > 0 the left, < 0 the right, 0 neither.

    A vehicle that steers right (``turned_rad`` < 0) ignores the left line, and vice versa. Driving straight, the
    line with the greater jump since ``before`` goes; without memory that with the greater distance from the line of
    a centred car, m = ±W/2h (``half_width``). The mirror image of a pair gives the opposite number.
    """
    if turned_rad != 0:
        return -turned_rad
    if before.left is None and before.right is None:
        return abs(left.m + half_width) - abs(right.m - half_width)
    jump_left = abs(left.m - before.left.m) if before.left else math.inf
    jump_right = abs(right.m - before.right.m) if before.right else math.inf
    return jump_left - jump_right


def _was(
    line: ImageLine, other_side: ImageLine | None, same_side: ImageLine | None, half_width: float
) -> bool:
    """``line`` was on the other side a step ago: nearer to that line than half a lane, and than to its own."""
    if other_side is None:
        return False
    jump = abs(line.m - other_side.m)
    return jump < half_width and (same_side is None or jump < abs(line.m - same_side.m))


def upper_tree(upper: Lines, lower: Lines) -> Lines:
    """The upper lines without the extension of the lower line of the other side (S15).

    In a bend the left boundary reaches into the right half of the picture further up: an upper right line goes
    if (upper right and lower left and not lower right), and the mirror image. The text states the inverse.
    """
    only_left = lower.left is not None and lower.right is None
    only_right = lower.right is not None and lower.left is None
    return Lines(None if only_right else upper.left, None if only_left else upper.right)


def mean_angle(lower: Outcome, upper: Lines) -> ImageAngle | None:
    """Lean of the mean m of the lower centre line and of the upper pair, as far as there are any (S16)."""
    slopes = [lower.centre.m] if lower.centre is not None else []
    if upper.left is not None and upper.right is not None:
        slopes.append((upper.left.m + upper.right.m) / 2)
    return lean(ImageLine(float(np.mean(slopes)), 0.0)) if slopes else None


class Abdelrahman:
    """The angle of both trees; straight on for at most ``blind_s`` without lines (S14–S16)."""

    def __init__(
        self, *, gain: Gain = 0.2, width_m: Positive = 3.4, split_m: Positive = 10.0, blind_s: Positive = 0.5
    ) -> None:
        self._gain, self._width_m, self._split_m = gain, width_m, split_m
        self._hold = Hold(blind_s, straight=True)
        self._before, self._turned_rad = Lines(), 0.0

    def step(self, boundaries: Boundaries, view: GroundView, dt_s: float) -> RuleAngle | None:
        """The angle for this frame, split ``split_m`` ahead. None after ``blind_s`` without lines."""
        near, picture = _half(boundaries, view, 0.0, self._split_m)
        far, _ = _half(boundaries, view, self._split_m, np.inf)
        lower = lower_tree(near, self._before, self._turned_rad, picture, width_m=self._width_m)
        self._remember(near, lower.leaf)
        angle = mean_angle(lower, upper_tree(far, near))
        self._turned_rad = angle or 0.0
        return self._hold.step(road_wheel(angle, gain=self._gain), dt_s)

    def _remember(self, near: Lines, leaf: Leaf) -> None:
        """Keep a crossed line as the line of its first side until it is crossed again."""
        if leaf is Leaf.CROSSED_LEFT:
            self._before = Lines(left=near.right)
        elif leaf is Leaf.CROSSED_RIGHT:
            self._before = Lines(right=near.left)
        elif leaf is not Leaf.NONE:
            self._before = near


def _half(
    boundaries: Boundaries, view: GroundView, near_m: float, far_m: float
) -> tuple[Lines, LevelPicture]:
    """The lines of the boundaries between ``near_m`` and ``far_m``."""

    def part(side: Boundary) -> Boundary | None:
        inside = (side.x_m >= near_m) & (side.x_m < far_m)
        if np.count_nonzero(inside) < 2:
            return None
        return replace(side, x_m=side.x_m[inside], y_m=side.y_m[inside])

    left, right, picture = level_lines(boundaries.each(part), view)
    return Lines(left, right), picture
