"""Steering by the centre line of both boundaries: Dev's bisector (inventory S01–S03), Tu's mean (S13).

Source: R [82], [6] and R [85].
"""

import math

from perception.techniques.image.picture import Boundaries, GroundView
from perception.techniques.steering.rule import (
    Gain,
    Hold,
    ImageAngle,
    ImageLine,
    LevelPicture,
    RoadWheel,
    RuleAngle,
    lean,
    level_lines,
    mean_line,
    road_wheel,
)
from trepid.types import Positive


def bisector(left: ImageLine, right: ImageLine) -> ImageLine:
    """The line at equal distances from two lines (S01).

    With unit normals, (1, −m, −k)/b and b = √(1+m²), the distances are opposite where the sum of both lines is 0:

        m = (m_l·b_r + m_r·b_l)/(b_l + b_r),  k alike.

    Printed with slopes s: slope_c = (s_l·b_r ∓ s_r·b_l)/(b_r ∓ b_l), without the outer parentheses; b_r − b_l is 0
    exactly for a centred car.
    """
    b_left, b_right = math.hypot(1.0, left.m), math.hypot(1.0, right.m)
    total = b_left + b_right
    return ImageLine(
        (left.m * b_right + right.m * b_left) / total, (left.k * b_right + right.k * b_left) / total
    )


def dev_angle(left: ImageLine | None, right: ImageLine | None) -> ImageAngle | None:
    """Lean of the bisector, δ = atan2(x₁−x₂, y₂−y₁) from its foot to the meeting point of the lines (S02).

    Printed: arctan((y₂−y₁)/(x₂−x₁)), ±90° for a centred car. None with fewer than two lines (S03). Limit: the angle
    depends on the offset alone, not on the heading (S18).
    """
    return None if left is None or right is None else lean(bisector(left, right))


def dev(boundaries: Boundaries, view: GroundView, dt_s: float, *, gain: Gain = 0.2) -> RuleAngle | None:
    """The angle of :func:`dev_angle`; None with fewer than two lines (S01–S03). Source: R [82], [6]."""
    left, right, _ = level_lines(boundaries, view)
    angle = dev_angle(left, right)
    return None if angle is None else RuleAngle(RoadWheel(gain * angle))


def tu_angle(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, width_m: float
) -> ImageAngle | None:
    """δ = −atan(m) of the mean line, or of one line moved by half a lane width; None without a line.

    Printed for one line: its own angle to the vertical, ±55.6° for a car in the middle of a lane of 3.5 m
    (h = 1.2 m). That base angle is removed by m ± W/2h. Limit: the heading (S18).
    """
    if left is not None and right is not None:
        return lean(mean_line(left, right))
    if right is not None:
        return lean(picture.beside(right, width_m / 2))
    return None if left is None else lean(picture.beside(left, -width_m / 2))


class Tu:
    """The angle of :func:`tu_angle`; without a line the last angle for at most ``hold_s`` (S13)."""

    def __init__(self, *, gain: Gain = 0.2, width_m: Positive = 3.4, hold_s: Positive = 0.5) -> None:
        self._gain, self._width_m, self._hold = gain, width_m, Hold(hold_s)

    def step(self, boundaries: Boundaries, view: GroundView, dt_s: float) -> RuleAngle | None:
        """The angle for this frame; None after ``hold_s`` without a line."""
        left, right, picture = level_lines(boundaries, view)
        angle = tu_angle(left, right, picture, width_m=self._width_m)
        return self._hold.step(road_wheel(angle, gain=self._gain), dt_s)
