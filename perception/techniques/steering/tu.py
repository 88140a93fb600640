"""Steering by the mean of the boundary lines, Tu (inventory S13; R [85])."""

from perception.techniques.image.picture import Boundaries, View
from perception.techniques.steering.rule import (
    Gain,
    Hold,
    ImageAngle,
    LevelPicture,
    RuleAngle,
    lean,
    level_lines,
    mean_line,
    road_wheel,
)
from perception.techniques.steering.straight_lane import ImageLine
from trepid.types import Positive


def tu_angle(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, width_m: float
) -> ImageAngle | None:
    """δ = −atan(m) of the mean line, or of one line moved by half a lane width; None without a line.

    Printed for one line: its own angle to the vertical, which is ±55.6° for a car in the middle of a lane of 3.5 m
    (h = 1.2 m). That base angle is removed by m ± W/2h, the line at the lane centre. Limit: the heading (S18).
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

    def step(self, boundaries: Boundaries, view: View, dt_s: float) -> RuleAngle | None:
        """The angle for this frame; None after ``hold_s`` without a line."""
        left, right, picture = level_lines(boundaries, view)
        angle = tu_angle(left, right, picture, width_m=self._width_m)
        return self._hold.step(road_wheel(angle, gain=self._gain), dt_s)
