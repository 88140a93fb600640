"""What the printed steering rules share: the picture of a level camera, and how angles become steering.

The rules work on two straight lines x = m·y + k of one picture. The review prints slopes s = dy/dx, which are
infinite for upright lines and cannot be averaged (±78° for a car 0.5 m beside the centre, S16); here every rule
is written in m. All of them assume a camera that looks level and straight ahead, so boundaries are drawn into
such a picture first.

Every rule returns an :data:`ImageAngle`, + = steer to the left (ISO 8855), whatever its paper prints. An image
angle is neither a heading nor a road-wheel angle (S19): only :func:`road_wheel` makes one of the other.
"""

import math
from dataclasses import dataclass
from typing import NewType

import numpy as np

from perception.techniques.image.picture import Boundaries, Boundary, View
from perception.techniques.steering.straight_lane import ImageLine

ImageAngle = NewType("ImageAngle", float)  # [rad] in the picture, + = steer left
RoadWheel = NewType("RoadWheel", float)  # [rad] at the road wheels, + = left

CLEAR_M = 0.5  # ahead of the camera: nearer points are behind the picture's lower edge


@dataclass(frozen=True, slots=True)
class LevelPicture:
    """A picture of a level camera: x right, y down [px]."""

    width_px: float
    height_px: float
    focal_px: float
    centre_x_px: float
    horizon_px: float
    camera_height_m: float

    def slope(self, lateral_m: float) -> float:
        """m of a line on the road ``lateral_m`` to the left of the camera and parallel to its axis: m = −b/h."""
        return -lateral_m / self.camera_height_m

    def beside(self, line: ImageLine, aside_m: float) -> ImageLine:
        """The parallel line on the road ``aside_m`` to the left: x + m'·(y − y_v) with m' = −aside/h (S10)."""
        slope = self.slope(aside_m)
        return ImageLine(line.m + slope, line.k - slope * self.horizon_px)


def level_picture(view: View) -> LevelPicture:
    """The level camera at the place of ``view``'s, with its focal length and size."""
    camera = view.camera
    return LevelPicture(
        camera.width_px,
        camera.height_px,
        camera.fx_px,
        (camera.width_px - 1) / 2,
        (camera.height_px - 1) / 2,
        camera.height_m,
    )


def level_lines(
    boundaries: Boundaries, view: View
) -> tuple[ImageLine | None, ImageLine | None, LevelPicture]:
    """Left and right boundary as straight lines of the level picture; None where not seen."""
    picture = level_picture(view)
    return _line(boundaries.left, view, picture), _line(boundaries.right, view, picture), picture


def _line(boundary: Boundary | None, view: View, picture: LevelPicture) -> ImageLine | None:
    if boundary is None:
        return None
    ahead = boundary.x_m - view.camera.x_m
    clear = ahead > CLEAR_M
    if np.count_nonzero(clear) < 2:
        return None
    aside = boundary.y_m[clear] - view.camera.y_m
    down = picture.camera_height_m / ahead[clear]
    m, k = np.polyfit(down, -aside / ahead[clear], 1)  # of focal length 1 with the horizon in row 0
    x_v = picture.centre_x_px + picture.focal_px * float(k)
    return ImageLine(float(m), x_v - float(m) * picture.horizon_px)


def road_wheel(angle: ImageAngle | None, *, gain: float) -> RoadWheel | None:
    """δ = gain·angle: the rules know no unit of steering, so the gain is the vehicle's. None stays None."""
    return None if angle is None else RoadWheel(gain * angle)


@dataclass(slots=True)
class Hold:
    """The last angle again when nothing is seen, but only for ``limit_s`` (S07, S13: the papers name no limit)."""

    limit_s: float
    _angle: ImageAngle | None = None
    _blind_s: float = 0.0

    def step(self, angle: ImageAngle | None, dt_s: float) -> ImageAngle | None:
        """``angle``, or the last one, or None when that is older than the limit."""
        if angle is not None:
            self._angle, self._blind_s = angle, 0.0
            return angle
        self._blind_s += dt_s
        if self._blind_s > self.limit_s:
            self._angle = None
        return self._angle


def lean(line: ImageLine) -> ImageAngle:
    """−atan(m): how far the line's foot lies to the left of its head, as seen from the head.

    The centre line of a lane has m = e/h (S18), so this is −atan(e/h): it steers back to the centre. It is the
    printed atan2(x₁−x₂, y₂−y₁) from foot (x₂, y₂) to head (x₁, y₁), whose sign the papers read as "to the
    right": taken so, a car left of the centre is sent further to the left.
    """
    return ImageAngle(-math.atan(line.m))
