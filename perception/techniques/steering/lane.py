"""From boundaries on the road to the state of the lane (inventory S18)."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.techniques.image.picture import Boundaries, Boundary, MeasuredLane, View
from perception.techniques.steering.straight_lane import ImageLine, straight_lane
from trepid.clothoid import Lane

CLEAR_M = 0.5  # ahead of the camera: nothing nearer can be seen


def exact_pair(
    boundaries: Boundaries, view: View, *, width_m: Annotated[float, Field(gt=0)] = 3.4
) -> MeasuredLane | None:
    """The exact lane of two straight lines, e = h(m_l + m_r)/2·cosψ, ψ = atan(x_v), W = h(m_r − m_l)·cosψ (S18).

    The lines are those that a level camera of focal length 1 would see from the same place. With one boundary
    seen, the other is put ``width_m`` beside it, parallel (S10 as it should be); its width is then not known.
    Cannot see: curvature, which is 0 here.
    """
    pair = _both(boundaries, width_m)
    if pair is None:
        return None
    left, right = (_level_line(side, view) for side in pair)
    if left is None or right is None or left.m == right.m:
        return None
    camera = view.camera
    seen = straight_lane(left, right, focal_px=1.0, centre_x_px=0.0, height_m=camera.height_m)
    psi = seen.heading_rad
    offset_m = seen.offset_m - camera.x_m * math.sin(psi) - camera.y_m * math.cos(psi)
    return MeasuredLane(Lane(offset_m, psi, 0.0, 0.0), seen.width_m if boundaries.seen == 2 else None)


def _both(boundaries: Boundaries, width_m: float) -> tuple[Boundary, Boundary] | None:
    left, right = boundaries.left, boundaries.right
    if left is None and right is None:
        return None
    left = left or beside(right, width_m)  # type: ignore[arg-type]
    return left, right or beside(left, -width_m)


def beside(boundary: Boundary, aside_m: float) -> Boundary:
    """The straight line parallel to ``boundary``, ``aside_m`` to its left."""
    a, b = boundary.polynomial(1)
    y_m = a + b * boundary.x_m + aside_m * math.hypot(1.0, b)
    return Boundary(boundary.x_m, y_m, boundary.residual_m, boundary.support)


def _level_line(boundary: Boundary, view: View) -> ImageLine | None:
    """The image line x = m·y + k of a level camera of focal length 1 that looks straight ahead."""
    ahead = boundary.x_m - view.camera.x_m
    clear = ahead > CLEAR_M
    if np.count_nonzero(clear) < 2:
        return None
    ahead, aside = ahead[clear], boundary.y_m[clear] - view.camera.y_m
    m, k = np.polyfit(view.camera.height_m / ahead, -aside / ahead, 1)
    return ImageLine(float(m), float(k))
