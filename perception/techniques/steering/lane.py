"""From boundaries on the road to a lane state, and from a lane state to the road-wheel angle (inventory S18)."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.polynomial import polynomial
from pydantic import Field

from perception.techniques.image.picture import Boundaries, Boundary, GroundView, MeasuredLane
from perception.techniques.steering.rule import ImageLine, level_line, meeting_point
from trepid.car.vehicle import road_wheel_angle
from trepid.clothoid import Lane
from trepid.types import Array, Positive

LINE_M = 0.15  # scatter that halves the weight of a boundary: the width of a line


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


def exact_pair(boundaries: Boundaries, view: GroundView, *, width_m: Positive = 3.4) -> MeasuredLane | None:
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
    return MeasuredLane(Lane(offset_m, psi, 0.0, 0.0), lane.width_m if boundaries.side_count == 2 else None)


def beside(boundary: Boundary, aside_m: float) -> Boundary:
    """The straight line parallel to ``boundary``, ``aside_m`` to its left."""
    a, b = boundary.polynomial(1)
    y_m = a + b * boundary.x_m + aside_m * math.hypot(1.0, b)
    return Boundary(boundary.x_m, y_m, boundary.residual_m, boundary.support)


def pursuit(lane: Lane, wheelbase_m: float, lookahead_m: float) -> float:
    """Road-wheel angle [rad], + left, of the arc to the lane centre ``lookahead_m`` ahead: δ = atan(L·2y/ℓ²).

    Source: Coulter, CMU-RI-TR-92-01.
    """
    return road_wheel_angle(lane.pursuit_curvature(lookahead_m), wheelbase_m=wheelbase_m)


def ground_curve(
    boundaries: Boundaries,
    view: GroundView | None = None,  # of every stage for lane states; this one measures on the road
    *,
    degree: Annotated[int, Field(ge=1, le=3)] = 2,
    width_m: Positive = 3.4,
) -> MeasuredLane | None:
    """The lane of one polynomial and one width that fits both boundaries best; None without a boundary.

    y(x) = c₀ + c₁x + c₂x² (+ c₃x³) ± W/2·√(1 + y'²): least squares, linear for a given root, iterated three times.
    At the rear axle ψ = −atan(c₁), e = −c₀·cosψ, κ = 2c₂·cos³ψ, κ' = 6c₃·cos⁴ψ. With one boundary W is ``width_m``
    and the measured width None. Source: derived, as S18. Limit: lanes that widen.
    """
    found = boundaries.signed_sides
    if not found:
        return None
    x_m = np.concatenate([boundary.x_m for boundary, _ in found])
    y_m = np.concatenate([boundary.y_m for boundary, _ in found])
    side = np.concatenate([np.full(len(boundary.x_m), sign) for boundary, sign in found])
    weight = np.concatenate([_weights(boundary) for boundary, _ in found])
    degree = min(degree, min(len(boundary.x_m) for boundary, _ in found) - 1)
    powers = np.vander(x_m, degree + 1, increasing=True)
    found_m, root = width_m, np.ones_like(x_m)
    for _ in range(3):
        aside = side * root / 2
        if len(found) == 2:
            solution = _solve_weighted(np.column_stack([powers, aside]), y_m, weight)
            c, found_m = solution[:-1], float(solution[-1])
        else:
            c = _solve_weighted(powers, y_m - aside * width_m, weight)
        root = np.sqrt(1 + polynomial.polyval(x_m, polynomial.polyder(c)) ** 2)
    c = np.pad(c, (0, 4 - len(c)))
    psi = -math.atan(c[1])
    cos = math.cos(psi)
    lane = Lane(float(-c[0] * cos), psi, float(2 * c[2] * cos**3), float(6 * c[3] * cos**4))
    return MeasuredLane(lane, found_m if len(found) == 2 else None)


def _weights(boundary: Boundary) -> Array:
    """The weight of each boundary: its support over its scatter, shared by its points."""
    trust = max(boundary.support, 0.05) / (1 + (boundary.residual_m / LINE_M) ** 2)
    return np.full(len(boundary.x_m), trust / len(boundary.x_m))


def _solve_weighted(matrix: Array, values: Array, weight: Array) -> Array:
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(matrix * root[:, None], values * root, rcond=None)[0], float)


def draw_boundaries(
    lane: Lane, width_m: float, *, near_m: float, far_m: float, residual_m: float, support: float
) -> Boundaries:
    """Both boundaries of a lane as curves on the road: the inverse of :func:`ground_curve`."""
    x_m = np.linspace(near_m, far_m, max(3, round((far_m - near_m) / 0.5)))
    cos = math.cos(lane.heading_rad)
    bend, change = lane.curvature_1pm / 2 / cos**3, lane.curvature_rate_1pm2 / 6 / cos**4
    c = [-lane.offset_m / cos, -math.tan(lane.heading_rad), bend, change]
    centre = polynomial.polyval(x_m, c)
    root = np.sqrt(1 + polynomial.polyval(x_m, polynomial.polyder(c)) ** 2)
    left, right = (Boundary(x_m, centre + sign * width_m / 2 * root, residual_m, support) for sign in (1, -1))
    return Boundaries(left, right)
