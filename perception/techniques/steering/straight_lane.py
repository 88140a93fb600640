"""The exact lane state of two straight boundary lines in one image (inventory S18)."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ImageLine:
    """Image line x = m·y + k [px]. A slope dy/dx would be infinite for upright lines, the normal case."""

    m: float
    k: float

    def x(self, y_px: float) -> float:
        """Column at row ``y_px``."""
        return self.m * y_px + self.k


@dataclass(frozen=True, slots=True)
class StraightLane:
    """Lane state at the camera's foot point; signs as in :mod:`trepid.messages`."""

    offset_m: float
    heading_rad: float
    width_m: float


def meeting_point(left: ImageLine, right: ImageLine) -> tuple[float, float] | None:
    """The vanishing point (X, Y) [px] as the cross product l₁×l₂; None for parallel lines (S08, S17).

    Printed: X = (C₂−C₁)/(s_l−s_r), Y = s_l·X + C₁: the same point, but undefined for upright lines.
    """
    if left.m == right.m:
        return None
    y_px = (right.k - left.k) / (left.m - right.m)
    return left.x(y_px), y_px


def straight_lane(
    left: ImageLine, right: ImageLine, *, focal_px: float, centre_x_px: float, height_m: float
) -> StraightLane | None:
    """Offset, heading and width of a lane from its two lines in a level camera; None for parallel lines.

    Let the camera stand at height h and lateral place e (+ left of the lane centre) and point ψ to the left of the
    lane. A boundary at lateral place b has the points (s, b), which lie d = s·cosψ + (b−e)·sinψ ahead of and
    a = −s·sinψ + (b−e)·cosψ to the left of the camera. The pinhole gives x − cx = −f·a/d and y − cy = f·h/d.
    With s eliminated, a = −d·tanψ + (b−e)/cosψ, so

        x = cx + f·tanψ − (b−e)/(h·cosψ) · (y − cy)   →   m = −(b−e)/(h·cosψ),  x_vp = cx + f·tanψ.

    With b = ±W/2 for the left and the right boundary:

        ψ = atan((x_vp − cx)/f),   e = h·(m_l + m_r)/2·cosψ,   W = h·(m_r − m_l)·cosψ.

    The inventory prints e = −h·(m_l + m_r)/2·cosψ because its e is positive to the right. The row of the horizon
    cancels; a pitched camera is levelled first by the homography K·R·K⁻¹.
    """
    vanishing_px = meeting_point(left, right)
    if vanishing_px is None:
        return None
    heading_rad = math.atan((vanishing_px[0] - centre_x_px) / focal_px)
    scale_m = height_m * math.cos(heading_rad)
    return StraightLane(
        offset_m=scale_m * (left.m + right.m) / 2,
        heading_rad=heading_rad,
        width_m=scale_m * (right.m - left.m),
    )
