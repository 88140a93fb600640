"""Steering by the point where the boundaries meet, Sujatha (inventory S07–S12; R [84])."""

import math
from typing import Annotated

from pydantic import Field

from perception.techniques.image.picture import Boundaries, View
from perception.techniques.steering.level_picture import (
    Hold,
    ImageAngle,
    LevelPicture,
    RoadWheel,
    level_lines,
    road_wheel,
)
from perception.techniques.steering.straight_lane import ImageLine
from trepid.types import Positive


def left_and_right(
    lines: list[ImageLine], picture: LevelPicture
) -> tuple[ImageLine | None, ImageLine | None]:
    """The steepest line that falls to the left in the left half, and to the right in the right half (S08).

    Left: slope dy/dx < 0, so m < 0, with its foot in the left half; right: the mirror image. A foot outside of
    the picture counts for its side. Cannot see: which of several lines bounds the lane, so the steepest, the
    nearest to the car, is taken.
    """
    bottom = picture.height_px - 1
    left = [line for line in lines if line.m < 0 and line.x(bottom) < picture.centre_x_px]
    right = [line for line in lines if line.m > 0 and line.x(bottom) > picture.centre_x_px]
    return (
        max(left, key=lambda line: line.m, default=None),
        min(right, key=lambda line: line.m, default=None),
    )


def meeting_point(left: ImageLine, right: ImageLine) -> tuple[float, float] | None:
    """(X, Y) [px] where the lines meet, as the cross product l₁×l₂; None when they are parallel (S08).

    Printed: X = (C₂−C₁)/(s_l−s_r), Y = s_l·X + C₁, the same point, but without a value for upright lines.
    """
    if left.m == right.m:
        return None
    y_px = (right.k - left.k) / (left.m - right.m)
    return left.x(y_px), y_px


def case_2(left: ImageLine, right: ImageLine, picture: LevelPicture) -> ImageAngle | None:
    """δ = −atan2(X − w/2, h − Y), from the middle of the lower edge to where the lines meet (S09).

    Printed: S = (X−w/2) − (Y−h), which must be a quotient, and 90° − atan(1/S): as a difference it is 89.8° for
    any pose, as a quotient it jumps by 180° at straight ahead (176° for 3° of heading). Cannot see: the offset
    (S18); the angle is not the heading either, which is atan((X−c_x)/f).
    """
    point = meeting_point(left, right)
    if point is None:
        return None
    return ImageAngle(-math.atan2(point[0] - picture.centre_x_px, picture.height_px - 1 - point[1]))


def case_3a(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, width_m: float
) -> ImageAngle | None:
    """One line seen: the other is put ``width_m`` beside it on the road; then case 2 (S10).

    x_r(y) = x_l(y) + W/h·(y − y_v), with y_v the row of the horizon.
    Printed: the missing line is the last column of pixels. That is no line of the road: a centred car gets 34.8°
    (f = 320 px, h = 1.2 m, W = 3.5 m) and its infinite slope breaks case 2.
    """
    left_seen, right_seen = left, right
    if left_seen is None and right_seen is not None:
        left_seen = picture.beside(right_seen, width_m)
    if right_seen is None and left_seen is not None:
        right_seen = picture.beside(left_seen, -width_m)
    if left_seen is None or right_seen is None:
        return None
    return case_2(left_seen, right_seen, picture)


def base_angle(distance_m: float, camera_height_m: float) -> float:
    """Inclination [rad] to the horizontal of a line on the road ``distance_m`` beside the camera: atan(h/d) (S11).

    Printed through an equi-angular camera (pixels per degree), with points x₁ and x₁+d on the line; the angle
    then depends on x₁, which it does not in a pinhole camera, and x_im2 has lost its parenthesis (5–10° instead
    of 26–28°). 30.96° for h = 1.2 m and d = 2 m.
    """
    return math.atan2(camera_height_m, distance_m)


def case_3b(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, distance_m: float
) -> ImageAngle | None:
    """Keep ``distance_m`` from the one boundary seen: base angle − its inclination, mirrored per side (S12).

    Cannot see: the heading, so that alone it swings about its distance for ever; :func:`heading` adds it.
    """
    if (left is None) == (right is None):
        return None
    base = base_angle(distance_m, picture.camera_height_m)
    if left is not None:
        return ImageAngle(base - math.atan2(1.0, -left.m))
    return ImageAngle(math.atan2(1.0, right.m) - base)  # type: ignore[union-attr]


def heading(line: ImageLine, picture: LevelPicture) -> float:
    """ψ = atan((x_v − c_x)/f) [rad], + = pointing left of the line, where it meets the horizon (S17)."""
    return math.atan((line.x(picture.horizon_px) - picture.centre_x_px) / picture.focal_px)


class Sujatha:
    """Road-wheel angle [rad], + left: case 2 with two lines, 3b with one, straight with none (S07–S12).

    Case 3b less the heading of its line, without which it swings. "Straight until a line is seen" has a limit
    here, ``blind_s``: then there is no angle.
    """

    def __init__(
        self,
        *,
        gain: Annotated[float, Field(gt=0, le=2)] = 0.2,
        distance_m: Positive = 1.7,
        blind_s: Positive = 0.5,
    ) -> None:
        self._gain, self._distance_m, self._straight = gain, distance_m, Hold(blind_s)

    def step(self, boundaries: Boundaries, view: View, dt_s: float) -> RoadWheel | None:
        """The angle for this frame; None when nothing was seen for too long."""
        left, right, picture = level_lines(boundaries, view)
        one = left or right
        if one is None:
            return road_wheel(self._straight.step(None, dt_s), gain=self._gain)
        self._straight.step(ImageAngle(0.0), dt_s)
        if left is not None and right is not None:
            return road_wheel(case_2(left, right, picture), gain=self._gain)
        aside = case_3b(left, right, picture, distance_m=self._distance_m) or 0.0
        return road_wheel(ImageAngle(aside - heading(one, picture)), gain=self._gain)
