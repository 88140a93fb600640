"""The common parts of the printed steering rules: image lines, a level picture, image angles, and the hold.

The rules work on two straight lines x = m·y + k of one picture. The review prints slopes s = dy/dx, which are
infinite for upright lines and cannot be averaged (S16); here every rule is written in m. All of them assume a
camera that is level and points straight ahead, so boundaries are drawn into such a picture first. Every rule
returns an :data:`ImageAngle`, + = steer to the left (ISO 8855), not the sign of its paper. It is neither a heading
nor a road-wheel angle (S19): only :func:`road_wheel` converts one into the other.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NewType

import numpy as np
from pydantic import Field

from perception.techniques.image.picture import Boundaries, Boundary, GroundView
from trepid.car.camera import Camera

ImageAngle = NewType("ImageAngle", float)  # [rad] in the picture, + = steer left
RoadWheel = NewType("RoadWheel", float)  # [rad] at the road wheels, + = left
Gain = Annotated[float, Field(gt=0, le=2)]  # road-wheel angle per image angle

CLEAR_M = 0.5  # ahead of the camera; nearer points lie below the picture


@dataclass(frozen=True, slots=True)
class ImageLine:
    """Image line x = m·y + k [px]. A slope dy/dx would be infinite for upright lines, the normal case."""

    m: float
    k: float

    def x(self, y_px: float) -> float:
        """Column at row ``y_px``."""
        return self.m * y_px + self.k


def meeting_point(left: ImageLine, right: ImageLine) -> tuple[float, float] | None:
    """The vanishing point (X, Y) [px] as the cross product l₁×l₂; None for parallel lines (S08, S17).

    Printed: X = (C₂−C₁)/(s_l−s_r), Y = s_l·X + C₁: the same point, but undefined for upright lines.
    """
    if left.m == right.m:
        return None
    y_px = (right.k - left.k) / (left.m - right.m)
    return left.x(y_px), y_px


@dataclass(frozen=True, slots=True)
class RuleAngle:
    """The road-wheel angle of a rule."""

    angle_rad: RoadWheel
    certainty: float = 1.0  # 1: from lines of this frame; falls to 0 at the end of a hold
    note: str = ""  # how a lost line is bridged


@dataclass(slots=True)
class Hold:
    """The angle while no line is detected, for at most ``limit_s`` (S07, S13, S16: the papers name no limit)."""

    limit_s: float
    straight: bool = False  # 0 in place of the last angle
    _last: RoadWheel | None = None
    _blind_s: float = 0.0

    def step(self, angle: RoadWheel | None, dt_s: float) -> RuleAngle | None:
        """``angle``; without one the held angle; None before the first angle and after the limit."""
        if angle is not None:
            self._last, self._blind_s = angle, 0.0
            return RuleAngle(angle)
        self._blind_s += dt_s
        if self._blind_s >= self.limit_s:
            self._last = None
        if self._last is None:
            return None
        certainty = 1 - self._blind_s / self.limit_s
        if self.straight:
            return RuleAngle(RoadWheel(0.0), certainty, "straight on")
        return RuleAngle(self._last, certainty, "the last angle is held")


@dataclass(frozen=True, slots=True)
class LevelPicture:
    """A picture of a level camera: x right, y down [px]."""

    width_px: float
    height_px: float
    focal_px: float
    centre_x_px: float
    horizon_px: float
    camera_height_m: float

    def beside(self, line: ImageLine, aside_m: float) -> ImageLine:
        """The parallel line on the road ``aside_m`` to the left: x + m'·(y − y_v) with m' = −aside/h (S10)."""
        slope = -aside_m / self.camera_height_m
        return ImageLine(line.m + slope, line.k - slope * self.horizon_px)


def level_line(boundary: Boundary, camera: Camera) -> ImageLine | None:
    """The least-squares line of ``boundary`` in a level camera of focal length 1 with the horizon in row 0.

    None with fewer than two points ahead of the camera.
    """
    ahead = boundary.x_m - camera.x_m
    clear = ahead > CLEAR_M
    if np.count_nonzero(clear) < 2:
        return None
    ahead, aside = ahead[clear], boundary.y_m[clear] - camera.y_m
    m, k = np.polyfit(camera.height_m / ahead, -aside / ahead, 1)
    return ImageLine(float(m), float(k))


def level_lines(
    boundaries: Boundaries, view: GroundView
) -> tuple[ImageLine | None, ImageLine | None, LevelPicture]:
    """Left and right boundary as straight lines of a level picture at the place, and of the size, of the camera's.

    None where a boundary is missing.
    """
    camera, lines = view.camera, []
    width_px, height_px = camera.width_px, camera.height_px
    middle_px = ((width_px - 1) / 2, (height_px - 1) / 2)
    picture = LevelPicture(width_px, height_px, camera.fx_px, *middle_px, camera.height_m)
    for boundary in (boundaries.left, boundaries.right):
        line = level_line(boundary, camera) if boundary is not None else None
        if line is not None:
            x_v = picture.centre_x_px + picture.focal_px * line.k
            line = ImageLine(line.m, x_v - line.m * picture.horizon_px)
        lines.append(line)
    return lines[0], lines[1], picture


def road_wheel(angle: ImageAngle | None, *, gain: float) -> RoadWheel | None:
    """δ = gain·angle, None for None; the gain belongs to the vehicle."""
    return None if angle is None else RoadWheel(gain * angle)


def lean(line: ImageLine) -> ImageAngle:
    """−atan(m), positive if the foot of the line lies to the left of its head.

    The centre line of a lane has m = e/h (S18), so this is −atan(e/h). It is the printed atan2(x₁−x₂, y₂−y₁) from
    foot (x₂, y₂) to head (x₁, y₁). The papers read its sign as "to the right", away from the centre.
    """
    return ImageAngle(-math.atan(line.m))


def mean_line(left: ImageLine, right: ImageLine) -> ImageLine:
    """The mean of x(y) of both lines: the centre of the lane, unlike the mean of their angles."""
    return ImageLine((left.m + right.m) / 2, (left.k + right.k) / 2)
