"""Curved boundaries without random samples (inventory B08, B20, B27, B29, B30)."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from perception.techniques.boundaries.evidence import (
    BENDS,
    Points,
    both,
    by_side,
    each_side,
    rms,
    road_points,
    sample_curve,
)
from perception.techniques.boundaries.lines import NO_LINE, hough_segments, hough_standard
from perception.techniques.boundaries.ransac import Curve, along, polynomial, two_sections
from perception.techniques.image.picture import Boundaries, Boundary, Evidence, Features
from trepid.types import Array, Positive

NODE_M = 3.0  # between the nodes of interpolation: one dash


def robust(points: Points, basis_values: Array, *, scale_m: float, rounds: int = 8) -> Array:
    """Coefficients of least squares with weights 1/(1 + (r/s)²)², s from wide to ``scale_m`` (Geman–McClure)."""
    weight = np.ones(len(points))
    for number in range(rounds):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(basis_values * root[:, None], points.y_m * root, rcond=None)[0]
        residual = points.y_m - basis_values @ coefficients
        scale = scale_m * max(1.0, 4.0 * (1 - number / (rounds - 2)))
        weight = 1 / (1 + (residual / scale) ** 2) ** 2
    return np.asarray(coefficients, float)


def curve_with_inliers(
    points: Points, basis_values: Array, coefficients: Array, *, scale_m: float
) -> Curve | None:
    """The curve with its points within 2·``scale_m``; None with too few."""
    residual = points.y_m - basis_values @ coefficients
    close = np.abs(residual) < 2 * scale_m
    if np.count_nonzero(close) < max(8, 0.2 * len(points)):
        return None
    return Curve(coefficients, points.where(close), rms(residual[close]))


def near_line_far_parabola(
    evidence: Evidence, *, near_m: Positive = 12.0, scale_m: Positive = 0.12
) -> Boundaries:
    """A Hough line near, and a parabola far that leaves it smoothly, by least squares (B27).

    y = a + bx up to x₀ = ``near_m``, + c(x − x₀)² beyond. Source: R [78], top view. Unlike B21 the near line is
    fixed first and the far points only bend it. Limit: a wrong near line.
    """
    near = evidence.features.response.copy()
    near[~(evidence.view.ahead_m <= near_m)] = 0  # and above the horizon
    lines = hough_standard(replace(evidence, features=Features(near, evidence.features.kind)), votes=8)
    points = road_points(evidence)
    near_lines = [
        None if line is None else _near_line(line, points, near_m, scale_m)
        for line in (lines.left, lines.right)
    ]
    bend = _common_bend([line for line in near_lines if line is not None], points, near_m)
    return both(
        *(None if line is None else _bend_line(*line, bend, points, near_m, scale_m) for line in near_lines)
    )


def _common_bend(lines: list[tuple[float, float]], points: Points, near_m: float) -> float:
    """c of :data:`BENDS` with most far points on a bent line: both sides of a road bend alike."""
    far = points.where(points.x_m > near_m)
    if not lines or not len(far):
        return 0.0
    off = np.array([far.y_m - a - b * far.x_m for a, b in lines])[:, None, :]
    bent = BENDS[:, None] / 2 * (far.x_m - near_m) ** 2
    on = (np.abs(off - bent) < 0.3).any(axis=0).sum(axis=1)
    return float(BENDS[int(np.argmax(on * (1 - np.abs(BENDS))))]) / 2


def _bend_line(
    a: float, b: float, c: float, points: Points, near_m: float, scale_m: float
) -> Boundary | None:
    """The line, and beyond it the parabola of the points about the common bend."""
    beyond, off = np.maximum(0.0, points.x_m - near_m), points.y_m - a - b * points.x_m
    far = (beyond > 0) & (np.abs(off - c * beyond**2) < 0.3 + 0.0015 * beyond**2)
    if np.count_nonzero(far) >= 8:
        c = float(robust(Points(points.x_m[far], off[far]), beyond[far, None] ** 2, scale_m=scale_m)[0])
    residual = np.abs(off - c * beyond**2)
    kept = residual < 2 * scale_m
    return along(Curve(np.array([a, b, c]), points.where(kept), rms(residual[kept])), two_sections(near_m))


def _near_line(line: Boundary, points: Points, near_m: float, scale_m: float) -> tuple[float, float]:
    """The Hough line refined by least squares through the points up to ``near_m``."""
    a, b = line.polynomial(1)
    close = (points.x_m < near_m) & (np.abs(points.y_m - a - b * points.x_m) < 0.5)
    if np.count_nonzero(close) < 8:
        return float(a), float(b)
    near = points.where(close)
    a, b = robust(near, polynomial(1)(near.x_m), scale_m=scale_m)
    return float(a), float(b)


def histogram_cubic(evidence: Evidence, *, scale_m: Positive = 0.15) -> Boundaries:
    """Windows ahead from the peaks of the histogram across the road, then y = a + bx + cx² + dx³ (B29).

    Source: R [80], in pixels from above: x = ay³ + by² + cy + d. Limit: anything as long and as thin as a line.
    """

    def fit_points(points: Points) -> Boundary | None:
        followed = _follow_points(points)
        if followed is None:
            return None
        basis = polynomial(3)(followed.x_m)
        coefficients = robust(followed, basis, scale_m=scale_m)
        return along(curve_with_inliers(followed, basis, coefficients, scale_m=scale_m), polynomial(3))

    return each_side(evidence, fit_points)


def _follow_points(points: Points, *, window_m: float = 2.0, half_m: float = 0.45) -> Points | None:
    """The points in windows about the extrapolated median, from near to far."""
    near = points.where(points.x_m < points.x_m.min() + 2 * window_m)
    place, slope, kept = float(np.median(near.y_m)), 0.0, np.zeros(len(points), bool)
    last_x: float | None = None
    for start in np.arange(points.x_m.min(), points.x_m.max(), window_m):
        middle = start + window_m / 2
        expected = place + (slope * (middle - last_x) if last_x is not None else 0.0)
        inside = (points.x_m >= start) & (points.x_m < start + window_m)
        inside &= np.abs(points.y_m - expected) < half_m
        if np.count_nonzero(inside) < 3:
            continue
        median = float(np.median(points.y_m[inside]))
        if last_x is not None:
            slope += 0.5 * ((median - place) / (middle - last_x) - slope)
        place, last_x, kept = median, middle, kept | inside
    return points.where(kept) if np.count_nonzero(kept) >= 8 else None


def hyperbola(evidence: Evidence, *, scale_m: Positive = 0.12) -> Boundaries:
    """The hyperbola of the picture, u = k/(v − h) + b(v − h) + c, with h the row of the horizon (B30).

    On the road of a level camera it is exactly the parabola y = c₀ + c₁x + c₂x²: k ∝ c₂, c ∝ c₁, b ∝ c₀. The
    residual is in pixels, so it is weighted by 1/x. Source: R [14], [41]. Limit: S-bends.
    """
    camera_x_m = evidence.view.camera.x_m
    return each_side(evidence, lambda points: along(_in_pixels(points, camera_x_m, scale_m), polynomial(2)))


def _in_pixels(points: Points, camera_x_m: float, scale_m: float) -> Curve | None:
    """y/x = c₀/x + c₁ + c₂x by robust least squares: pixels, up to the focal length."""
    ahead = np.maximum(points.x_m - camera_x_m, 0.5)
    tangent = Points(points.x_m, points.y_m / ahead)
    basis = polynomial(2)(points.x_m)
    reference = float(np.median(ahead))
    coefficients = robust(tangent, basis / ahead[:, None], scale_m=scale_m / reference)
    return curve_with_inliers(points, basis, coefficients, scale_m=scale_m)


def pchip(evidence: Evidence, *, half_m: Positive = 0.4) -> Boundaries:
    """Hough segments joined by shape-preserving cubic interpolation, monotone between nodes (B20).

    A node every ``NODE_M``: the median of the segments' points there. Source: R [60]; Fritsch and Carlson, Monotone
    Piecewise Cubic Interpolation, SIAM J. Numer. Anal. 17(2), 1980. Limit: noise, since it interpolates every node.
    """
    segments = hough_segments(evidence, np.pi / 180, 8, 5.0, 3.0)
    if segments is None:
        return NO_LINE
    points = segments.where(np.abs(segments.slope) < 0.7).points(0.2)
    points = points.where((points.x_m < 35.0) & (np.abs(points.y_m) < 7.0))
    order = np.argsort(points.x_m, kind="stable")
    sides = by_side(Points(points.x_m[order], points.y_m[order]), evidence.predicted, gate_m=half_m)
    return both(*(_interpolate(side) for side in sides))


def _interpolate(points: Points | None) -> Boundary | None:
    """PCHIP through the medians of the followed points of each ``NODE_M``."""
    followed = _follow_points(points, window_m=NODE_M) if points is not None else None
    if followed is None:
        return None
    cell = np.floor(followed.x_m / NODE_M).astype(int)
    inside = [cell == number for number in np.unique(cell)]
    if len(inside) < 2:
        return None
    nodes = np.array([(np.mean(followed.x_m[own]), np.median(followed.y_m[own])) for own in inside])
    curve = PchipInterpolator(nodes[:, 0], nodes[:, 1])
    near, far = float(nodes[0, 0]), float(nodes[-1, 0])
    residual_m = rms(followed.y_m - curve(np.clip(followed.x_m, near, far)))
    return sample_curve(curve, near, far, followed, residual_m)
