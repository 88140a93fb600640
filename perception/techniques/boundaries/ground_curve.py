"""The state of a lane that may bend, from two parallel curves on the road (inventory S18 with curvature)."""

import math
from typing import Annotated

import numpy as np
from numpy.polynomial import polynomial
from pydantic import Field

from perception.techniques.image.picture import Boundaries, Boundary, MeasuredLane, View
from trepid.clothoid import Lane
from trepid.types import Array, Positive

LINE_M = 0.15  # scatter that halves the weight of a boundary: the width of a line


def ground_curve(
    boundaries: Boundaries,
    view: View,
    *,
    degree: Annotated[int, Field(ge=1, le=3)] = 2,
    width_m: Positive = 3.4,
) -> MeasuredLane | None:
    """The stage of :func:`parallel_sides`. Source: derived, as S18. Limit: lanes that widen."""
    return parallel_sides(boundaries, degree=degree, width_m=width_m)


def parallel_sides(boundaries: Boundaries, *, degree: int = 2, width_m: float = 3.4) -> MeasuredLane | None:
    """The lane of one polynomial and one width that fits both boundaries best; None without a boundary.

    y(x) = c₀ + c₁x + c₂x² (+ c₃x³) ± W/2·√(1 + y'²): least squares, linear for a given root, iterated three times.
    At the rear axle ψ = −atan(c₁), e = −c₀·cosψ, κ = 2c₂·cos³ψ, κ' = 6c₃·cos⁴ψ. With one boundary W is ``width_m``
    and the measured width None.
    """
    found = boundaries.found
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
            solution = _solved(np.column_stack([powers, aside]), y_m, weight)
            c, found_m = solution[:-1], float(solution[-1])
        else:
            c = _solved(powers, y_m - aside * width_m, weight)
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


def _solved(matrix: Array, values: Array, weight: Array) -> Array:
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(matrix * root[:, None], values * root, rcond=None)[0], float)


def drawn(
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
