"""Steering by the bisector of the two boundary lines, Dev et al. (inventory S01–S03; R [82], [6])."""

import math

from perception.techniques.image.picture import Boundaries, View
from perception.techniques.steering.rule import (
    Gain,
    ImageAngle,
    RoadWheel,
    RuleAngle,
    lean,
    level_lines,
)
from perception.techniques.steering.straight_lane import ImageLine


def bisector(left: ImageLine, right: ImageLine) -> ImageLine:
    """The line at equal distances from two lines (S01).

    With unit normals, (1, −m, −k)/b and b = √(1+m²), the distances are opposite where the sum of both lines is 0:

        m = (m_l·b_r + m_r·b_l)/(b_l + b_r),  k alike.

    Printed with slopes s: slope_c = (s_l·b_r ∓ s_r·b_l)/(b_r ∓ b_l), the steeper one counts. The outer parentheses
    are lost in print, and b_r − b_l is 0 exactly for a centred car. This form never divides by zero.
    """
    b_left, b_right = math.hypot(1.0, left.m), math.hypot(1.0, right.m)
    total = b_left + b_right
    return ImageLine(
        (left.m * b_right + right.m * b_left) / total, (left.k * b_right + right.k * b_left) / total
    )


def dev_angle(left: ImageLine | None, right: ImageLine | None) -> ImageAngle | None:
    """Lean of the bisector, δ = atan2(x₁−x₂, y₂−y₁) from its foot to the meeting point of the lines (S02).

    Printed: arctan((y₂−y₁)/(x₂−x₁)), the angle to the horizontal, ±90° for a centred car, for which the text gives
    0. None with fewer than two lines (S03). Limit: the angle depends on the offset alone, not on the heading (S18).
    """
    return None if left is None or right is None else lean(bisector(left, right))


def dev(boundaries: Boundaries, view: View, dt_s: float, *, gain: Gain = 0.2) -> RuleAngle | None:
    """The angle of :func:`dev_angle`; None with fewer than two lines (S01–S03). Source: R [82], [6]."""
    left, right, _ = level_lines(boundaries, view)
    angle = dev_angle(left, right)
    return None if angle is None else RuleAngle(RoadWheel(gain * angle))
