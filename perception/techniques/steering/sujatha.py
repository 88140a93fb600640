"""Steering by the meeting point of the boundaries, Sujatha (inventory S07–S12; R [84])."""

import math
from typing import Literal

from perception.techniques.image.picture import Boundaries, GroundView
from perception.techniques.steering.rule import (
    Gain,
    Hold,
    ImageAngle,
    ImageLine,
    LevelPicture,
    RuleAngle,
    level_lines,
    meeting_point,
    road_wheel,
)
from trepid.types import Positive


def left_and_right(
    lines: list[ImageLine], picture: LevelPicture
) -> tuple[ImageLine | None, ImageLine | None]:
    """The steepest line that falls to the left in the left half, and to the right in the right half (S08).

    Left: slope dy/dx < 0, so m < 0, with its foot in the left half; right: the mirror image. The steepest line of a
    side is the nearest.
    """
    bottom = picture.height_px - 1
    left = [line for line in lines if line.m < 0 and line.x(bottom) < picture.centre_x_px]
    right = [line for line in lines if line.m > 0 and line.x(bottom) > picture.centre_x_px]
    return (
        max(left, key=lambda line: line.m, default=None),
        min(right, key=lambda line: line.m, default=None),
    )


def case_2(left: ImageLine, right: ImageLine, picture: LevelPicture) -> ImageAngle | None:
    """δ = −atan2(X − w/2, h − Y), from the middle of the lower edge to the meeting point (S09).

    Printed: S = (X−w/2) − (Y−h), which must be a quotient, and 90° − atan(1/S), which jumps by 180° at straight
    ahead. None for parallel lines. Limits: the offset (S18); the angle is not the heading, atan((X−c_x)/f).
    """
    point = meeting_point(left, right)
    if point is None:
        return None
    return ImageAngle(-math.atan2(point[0] - picture.centre_x_px, picture.height_px - 1 - point[1]))


def case_3a(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, width_m: float
) -> ImageAngle | None:
    """Keep the middle of the road by one line: the other is put ``width_m`` beside it; then case 2 (S10).

    x_r(y) = x_l(y) + W/h·(y − y_v), with y_v the row of the horizon. Printed: the missing line is the last column
    of pixels, which gives 34.8° for a centred car. None unless exactly one line is given.
    """
    if left is None and right is not None:
        return case_2(picture.beside(right, width_m), right, picture)
    if right is None and left is not None:
        return case_2(left, picture.beside(left, -width_m), picture)
    return None


def base_angle(distance_m: float, camera_height_m: float) -> float:
    """Inclination [rad] to the horizontal of a line on the road ``distance_m`` beside the camera: atan(h/d) (S11).

    Printed through an equi-angular camera (pixels per degree); x_im2 has lost its parenthesis.
    """
    return math.atan2(camera_height_m, distance_m)


def case_3b(
    left: ImageLine | None, right: ImageLine | None, picture: LevelPicture, *, distance_m: float
) -> ImageAngle | None:
    """Keep ``distance_m`` from one boundary: base angle − its inclination, mirrored per side (S12).

    None unless exactly one line is given. Without :func:`heading` the car swings about its distance.
    """
    base = base_angle(distance_m, picture.camera_height_m)
    if left is not None and right is None:
        return ImageAngle(base - math.atan2(1.0, -left.m))
    if right is not None and left is None:
        return ImageAngle(math.atan2(1.0, right.m) - base)
    return None


def heading(line: ImageLine, picture: LevelPicture) -> float:
    """ψ = atan((x_v − c_x)/f) [rad], + = the car points left of the line, at its column in the horizon (S17)."""
    return math.atan((line.x(picture.horizon_px) - picture.centre_x_px) / picture.focal_px)


class Sujatha:
    """Case 2 with two lines, case 3 with one, straight on for at most ``blind_s`` without any (S07–S12).

    ``one_line``: "middle" is case 3a with ``width_m``, "distance" case 3b with ``distance_m``, less the heading of
    its line, without which it swings.
    """

    def __init__(
        self,
        *,
        gain: Gain = 0.2,
        one_line: Literal["middle", "distance"] = "distance",
        width_m: Positive = 3.4,
        distance_m: Positive = 1.7,
        blind_s: Positive = 0.5,
    ) -> None:
        self._gain, self._one_line = gain, one_line
        self._width_m, self._distance_m = width_m, distance_m
        self._hold = Hold(blind_s, straight=True)

    def step(self, boundaries: Boundaries, view: GroundView, dt_s: float) -> RuleAngle | None:
        """The angle for this frame; None after ``blind_s`` without a line."""
        one, other, picture = level_lines(boundaries, view)
        left, right = left_and_right([line for line in (one, other) if line is not None], picture)
        return self._hold.step(road_wheel(self._angle(left, right, picture), gain=self._gain), dt_s)

    def _angle(
        self, left: ImageLine | None, right: ImageLine | None, picture: LevelPicture
    ) -> ImageAngle | None:
        if left is not None and right is not None:
            return case_2(left, right, picture)
        if self._one_line == "middle":
            return case_3a(left, right, picture, width_m=self._width_m)
        aside = case_3b(left, right, picture, distance_m=self._distance_m)
        line = left or right
        return None if aside is None or line is None else ImageAngle(aside - heading(line, picture))
