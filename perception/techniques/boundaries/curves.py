"""Curved boundaries without random samples (inventory B08, B20, B27, B29, B30)."""

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field
from scipy.interpolate import PchipInterpolator

from perception.techniques.boundaries.evidence import (
    BENDS,
    Points,
    both,
    by_side,
    each_side,
    road_points,
    support,
)
from perception.techniques.boundaries.lines import NEAR_M, Segments, nearest_pair, on_road
from perception.techniques.boundaries.ransac import STEP_M, Curve, along, polynomial
from perception.techniques.image.picture import Boundaries, Boundary, Features, View
from trepid.types import Array, Positive

STRONGEST = 200  # lines of the standard Hough transform that are used
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


def agreed(points: Points, basis_values: Array, coefficients: Array, *, scale_m: float) -> Curve | None:
    """The curve with its points within 2·``scale_m``; None with too few."""
    residual = points.y_m - basis_values @ coefficients
    close = np.abs(residual) < 2 * scale_m
    if np.count_nonzero(close) < max(8, 0.2 * len(points)):
        return None
    return Curve(coefficients, points.where(close), float(np.sqrt(np.mean(residual[close] ** 2))))


def hough_standard(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    votes: Annotated[int, Field(ge=1)] = 15,
    share: Annotated[float, Field(gt=0, le=1)] = 0.35,
    max_heading_rad: Annotated[float, Field(gt=0, lt=1.4)] = 0.35,
) -> Boundaries:
    """The nearest pair among the strongest lines of the standard Hough transform (B08).

    ρ = x·cosθ + y·sinθ; lines with less than ``share`` of the votes of the strongest do not count. Source: R
    [58]–[64]. It joins dashes over any gap. Limit: the ends of a line; curves; arrows and text.
    """
    ahead = view.ahead_m
    rows = np.flatnonzero((ahead > 0) & (ahead < 25.0))
    binary = np.asarray(features.response > 0, np.uint8)
    found = cv2.HoughLinesWithAccumulator(binary, 1, np.pi / 360, votes) if len(rows) > 1 else None
    if found is None:
        return Boundaries(None, None, "no straight line found")
    rho, theta, strength = np.asarray(found, float).reshape(-1, 3)[:STRONGEST].T
    good = (np.abs(np.cos(theta)) > 0.05) & (strength >= share * strength[0])
    rho, theta = rho[good], theta[good]
    ends = [
        np.column_stack([(rho - row * np.sin(theta)) / np.cos(theta), np.full(len(rho), row)])
        for row in (float(rows[-1]), float(rows[0]))
    ]
    segments = on_road(np.stack(ends, axis=1), view)
    segments = segments.where(np.abs(segments.slope) < np.tan(max_heading_rad))
    return nearest_pair(_apart(segments), min_length_m=3.0)


def _apart(segments: Segments, *, least_m: float = 0.6) -> Segments:
    """The lines (strongest first) that lie ``least_m`` from all stronger ones at ``NEAR_M``."""
    place = segments.place_m(NEAR_M)
    kept: list[int] = []
    for number, here in enumerate(place):
        if all(abs(here - place[other]) > least_m for other in kept):
            kept.append(number)
    return segments.where(np.isin(np.arange(len(place)), kept))


def near_line_far_parabola(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    near_m: Positive = 12.0,
    scale_m: Positive = 0.12,
) -> Boundaries:
    """A Hough line near, and a parabola far that leaves it smoothly, by least squares (B27).

    y = a + bx up to x₀ = ``near_m``, + c(x − x₀)² beyond. Source: R [78], top view. Unlike B21 the near line is
    fixed first and the far points only bend it. Limit: a wrong near line.
    """
    far = ~(view.ahead_m <= near_m)  # and above the horizon
    near = features.response.copy()
    near[far] = 0
    lines = hough_standard(Features(near, features.kind), view, predicted, rng, votes=8)
    points = road_points(features, view)
    near_lines = [
        None if line is None else _near_line(line, points, near_m, scale_m)
        for line in (lines.left, lines.right)
    ]
    bend = _common_bend([line for line in near_lines if line is not None], points, near_m)
    return both(
        *(None if line is None else _bent(*line, bend, points, near_m, scale_m) for line in near_lines)
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


def _bent(a: float, b: float, c: float, points: Points, near_m: float, scale_m: float) -> Boundary | None:
    """The line, and beyond it the parabola of the points about the common bend."""
    beyond, off = np.maximum(0.0, points.x_m - near_m), points.y_m - a - b * points.x_m
    far = (beyond > 0) & (np.abs(off - c * beyond**2) < 0.3 + 0.0015 * beyond**2)
    if np.count_nonzero(far) >= 8:
        c = float(robust(Points(points.x_m[far], off[far]), beyond[far, None] ** 2, scale_m=scale_m)[0])
    residual = np.abs(off - c * beyond**2)
    kept = points.where(residual < 2 * scale_m)
    curve = Curve(np.array([a, b, c]), kept, float(np.sqrt(np.mean(residual[residual < 2 * scale_m] ** 2))))
    return along(
        curve, lambda x_m: np.column_stack([np.ones_like(x_m), x_m, np.maximum(0.0, x_m - near_m) ** 2])
    )


def _near_line(line: Boundary, points: Points, near_m: float, scale_m: float) -> tuple[float, float]:
    """The Hough line refined by least squares through the points up to ``near_m``."""
    a, b = line.polynomial(1)
    close = (points.x_m < near_m) & (np.abs(points.y_m - a - b * points.x_m) < 0.5)
    if np.count_nonzero(close) < 8:
        return float(a), float(b)
    near = points.where(close)
    a, b = robust(near, polynomial(1)(near.x_m), scale_m=scale_m)
    return float(a), float(b)


def histogram_cubic(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    scale_m: Positive = 0.15,
) -> Boundaries:
    """Windows ahead from the peaks of the histogram across the road, then y = a + bx + cx² + dx³ (B29).

    Printed in pixels from above, x = ay³ + by² + cy + d, the same curve. Source: R [80]. Each window starts at the
    extrapolation of the last two. Limit: anything as long and as thin as a line.
    """

    def fitted(points: Points) -> Boundary | None:
        followed = _followed(points)
        if followed is None:
            return None
        basis = polynomial(3)(followed.x_m)
        coefficients = robust(followed, basis, scale_m=scale_m)
        return along(agreed(followed, basis, coefficients, scale_m=scale_m), polynomial(3))

    return each_side(features, view, predicted, fitted)


def _followed(points: Points, *, window_m: float = 2.0, half_m: float = 0.45) -> Points | None:
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


def hyperbola(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    scale_m: Positive = 0.12,
) -> Boundaries:
    """The hyperbola of the picture, u = k/(v − h) + b(v − h) + c, with h the row of the horizon (B30).

    On the road of a level camera it is exactly the parabola y = c₀ + c₁x + c₂x²: k ∝ c₂, c ∝ c₁, b ∝ c₀. The
    residual is in pixels, so it is weighted by 1/x. Source: R [14], [41].
    Limit: S-bends.
    """
    return each_side(
        features, view, predicted, lambda points: along(_in_pixels(points, view, scale_m), polynomial(2))
    )


def _in_pixels(points: Points, view: View, scale_m: float) -> Curve | None:
    """y/x = c₀/x + c₁ + c₂x by robust least squares: pixels, up to the focal length."""
    ahead = np.maximum(points.x_m - view.camera.x_m, 0.5)
    tangent = Points(points.x_m, points.y_m / ahead)
    basis = polynomial(2)(points.x_m)
    reference = float(np.median(ahead))
    coefficients = robust(tangent, basis / ahead[:, None], scale_m=scale_m / reference)
    return agreed(points, basis, coefficients, scale_m=scale_m)


def pchip(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    half_m: Positive = 0.4,
) -> Boundaries:
    """Hough segments joined by shape-preserving cubic interpolation, monotone between nodes (B20).

    Source: R [60], 87–98 %, the best of linear, cubic spline and PCHIP; Fritsch and Carlson, Monotone Piecewise
    Cubic Interpolation, SIAM J. Numer. Anal. 17(2), 1980. A node every ``NODE_M``: the median of the segments'
    points there. Limit: noise, since it interpolates every node.
    """
    binary = np.asarray(features.response > 0, np.uint8)
    found = cv2.HoughLinesP(binary, 1, np.pi / 180, 8, None, 5.0, 3.0)
    if found is None:
        return Boundaries(None, None, "no straight line found")
    points = _sampled(on_road(np.asarray(found, float).reshape(-1, 2, 2), view))
    sides = by_side(points, predicted, gate_m=half_m)
    return both(*(_interpolated(side) for side in sides))


def _sampled(segments: Segments) -> Points:
    """Points every 0.2 m of all segments along the road, near to far."""
    segments = segments.where(np.abs(segments.slope) < 0.7)
    pieces = [
        first + np.linspace(0, 1, max(2, round(length / 0.2)))[:, None] * (last - first)
        for (first, last), length in zip(segments.ends_m, segments.length_m, strict=True)
    ]
    road = np.concatenate(pieces) if pieces else np.empty((0, 2))
    road = road[(road[:, 0] < 35.0) & (np.abs(road[:, 1]) < 7.0)]
    road = road[np.argsort(road[:, 0], kind="stable")]
    return Points(road[:, 0], road[:, 1])


def _interpolated(points: Points | None) -> Boundary | None:
    """PCHIP through the medians of the followed points of each ``NODE_M``."""
    followed = _followed(points, window_m=NODE_M) if points is not None else None
    if followed is None:
        return None
    cell = np.floor(followed.x_m / NODE_M).astype(int)
    nodes = np.array(
        [
            (np.mean(followed.x_m[cell == number]), np.median(followed.y_m[cell == number]))
            for number in np.unique(cell)
        ]
    )
    if len(nodes) < 2:
        return None
    curve = PchipInterpolator(nodes[:, 0], nodes[:, 1])
    near, far = float(nodes[0, 0]), float(nodes[-1, 0])
    x_m = np.linspace(near, far, max(3, round((far - near) / STEP_M)))
    residual = float(np.sqrt(np.mean((followed.y_m - curve(np.clip(followed.x_m, near, far))) ** 2)))
    return Boundary(x_m, np.asarray(curve(x_m), float), residual, support(followed.x_m, near, far))
