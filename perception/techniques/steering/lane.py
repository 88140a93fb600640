"""From boundaries on the road to a lane state, and from a lane state to the road-wheel angle (inventory S18)."""

import math
from dataclasses import dataclass

from perception.techniques.image.picture import Boundaries, Boundary, MeasuredLane, View
from perception.techniques.steering.rule import ImageLine, level_line, meeting_point
from trepid.clothoid import Lane
from trepid.steering import road_wheel_angle
from trepid.types import Positive


@dataclass(frozen=True, slots=True)
class StraightLane:
    """Lane state at the camera's foot point; signs as in :mod:`trepid.messages`."""

    offset_m: float
    heading_rad: float
    width_m: float


def straight_lane(
    left: ImageLine, right: ImageLine, *, focal_px: float, centre_x_px: float, height_m: float
) -> StraightLane | None:
    """Offset, heading and width of a lane from its two lines in a level camera; None for parallel lines.

    Let the camera stand at height h and lateral place e (+ left of the lane centre) and point ψ to the left of the
    lane. A boundary at lateral place b has the points (s, b), which lie d = s·cosψ + (b−e)·sinψ ahead of and
    a = −s·sinψ + (b−e)·cosψ to the left of the camera. The pinhole gives x − cx = −f·a/d and y − cy = f·h/d.
    With s eliminated, x = cx + f·tanψ − (b−e)/(h·cosψ) · (y − cy), and with b = ±W/2:

        ψ = atan((x_vp − cx)/f),   e = h·(m_l + m_r)/2·cosψ,   W = h·(m_r − m_l)·cosψ.

    The inventory prints −e, positive to the right. The row of the horizon cancels.
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


def exact_pair(boundaries: Boundaries, view: View, *, width_m: Positive = 3.4) -> MeasuredLane | None:
    """The exact lane of two straight lines, e = h(m_l + m_r)/2·cosψ, ψ = atan(x_v), W = h(m_r − m_l)·cosψ (S18).

    The lines are those of a level camera of focal length 1 at the same place. With one boundary, the other is put
    ``width_m`` beside it, parallel (S10 corrected); the width is then None. Limit: curvature, which is 0 here.
    """
    left, right = boundaries.left, boundaries.right
    if left is None and right is not None:
        left = beside(right, width_m)
    if right is None and left is not None:
        right = beside(left, -width_m)
    if left is None or right is None:
        return None
    camera = view.camera
    left_line, right_line = level_line(left, camera), level_line(right, camera)
    if left_line is None or right_line is None:
        return None
    lane = straight_lane(left_line, right_line, focal_px=1.0, centre_x_px=0.0, height_m=camera.height_m)
    if lane is None:
        return None
    psi = lane.heading_rad
    offset_m = lane.offset_m - camera.x_m * math.sin(psi) - camera.y_m * math.cos(psi)
    return MeasuredLane(Lane(offset_m, psi, 0.0, 0.0), lane.width_m if boundaries.seen == 2 else None)


def beside(boundary: Boundary, aside_m: float) -> Boundary:
    """The straight line parallel to ``boundary``, ``aside_m`` to its left."""
    a, b = boundary.polynomial(1)
    y_m = a + b * boundary.x_m + aside_m * math.hypot(1.0, b)
    return Boundary(boundary.x_m, y_m, boundary.residual_m, boundary.support)


def pursuit(lane: Lane, wheelbase_m: float, *, lookahead_m: Positive = 8.0) -> float:
    """Road-wheel angle [rad], + left, of the arc to the lane centre ``lookahead_m`` ahead: δ = atan(L·2y/ℓ²).

    Source: Coulter, CMU-RI-TR-92-01; 8 m is about 1 s at the speeds of the shuttle.
    """
    return road_wheel_angle(lane.pursuit_curvature(lookahead_m), wheelbase_m=wheelbase_m)
