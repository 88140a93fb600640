"""Steering by the mean of the boundary lines, Tu (inventory S13; R [85])."""

from typing import Annotated

from pydantic import Field

from perception.techniques.image.picture import Boundaries, View
from perception.techniques.steering.level_picture import (
    Hold,
    ImageAngle,
    LevelPicture,
    RoadWheel,
    lean,
    level_lines,
    road_wheel,
)
from perception.techniques.steering.straight_lane import ImageLine
from trepid.types import Positive


def mean_line(left: ImageLine, right: ImageLine) -> ImageLine:
    """The mean of x(y) of both lines: exactly the centre of the lane, because x is linear across the road in a row.

    The mean of the angles is something else: 7.9° instead of 22.6° for a car 0.5 m beside the centre (h = 1.2 m).
    """
    return ImageLine((left.m + right.m) / 2, (left.k + right.k) / 2)


def tu_angle(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, width_m: float
) -> ImageAngle | None:
    """δ = −atan(m) of the mean line; of one line, set half a lane width aside; None when none is seen.

    Printed for one line: its own angle to the vertical, which is ±55.6° for a car in the middle of a lane of 3.5 m
    (h = 1.2 m). The base angle has to go: the line is moved to where the centre is, m ± W/2h. Cannot see: the
    heading (S18).
    """
    if left is None and right is None:
        return None
    if left is not None and right is not None:
        return lean(mean_line(left, right))
    centre = picture.beside(right, width_m / 2) if right is not None else picture.beside(left, -width_m / 2)  # type: ignore[arg-type]
    return lean(centre)


class Tu:
    """Road-wheel angle [rad], + left, by :func:`tu_angle`; the last one for ``hold_s`` while nothing is seen."""

    def __init__(
        self,
        *,
        gain: Annotated[float, Field(gt=0, le=2)] = 0.2,
        width_m: Positive = 3.4,
        hold_s: Positive = 0.5,
    ) -> None:
        self._gain, self._width_m, self._hold = gain, width_m, Hold(hold_s)

    def step(self, boundaries: Boundaries, view: View, dt_s: float) -> RoadWheel | None:
        """The angle for this frame; None when nothing was seen for too long."""
        left, right, picture = level_lines(boundaries, view)
        angle = tu_angle(left, right, picture, width_m=self._width_m)
        return road_wheel(self._hold.step(angle, dt_s), gain=self._gain)
