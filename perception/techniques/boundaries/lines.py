"""Straight boundaries from line features (inventory B08, B09)."""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.techniques.boundaries.evidence import both
from perception.techniques.image.picture import Boundaries, Boundary, Features, View
from trepid.types import Array, Positive

NEAR_M = 6.0  # where the places of lines are compared: the nearest road of most cameras
STEP_M = 0.5


@dataclass(frozen=True)
class Segments:
    """Straight pieces on the road, shape (n, 2, 2): ends (x, y) [m], the nearer end first."""

    ends_m: Array

    @property
    def slope(self) -> Array:
        """dy/dx: the direction, + to the left."""
        first, last = self.ends_m[:, 0], self.ends_m[:, 1]
        return (last[:, 1] - first[:, 1]) / np.maximum(last[:, 0] - first[:, 0], 1e-6)

    def place_m(self, x_m: float) -> Array:
        """y at ``x_m``."""
        return self.ends_m[:, 0, 1] + self.slope * (x_m - self.ends_m[:, 0, 0])

    @property
    def length_m(self) -> Array:
        """Distance between the ends."""
        return np.hypot(*(self.ends_m[:, 1] - self.ends_m[:, 0]).T)

    def where(self, kept: np.ndarray) -> "Segments":
        """The segments selected by the mask ``kept``."""
        return Segments(self.ends_m[kept])


def hough(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    rng: np.random.Generator,
    *,
    votes: Annotated[int, Field(ge=1)] = 12,
    min_length_px: Positive = 9.0,
    max_gap_px: Positive = 10.0,
    max_heading_rad: Annotated[float, Field(gt=0, lt=1.4)] = 0.35,
    min_length_m: Positive = 3.0,
) -> Boundaries:
    """The nearest line on each side among the segments of the probabilistic Hough transform (B08, B09).

    ρ = x·cosθ + y·sinθ. Segments along the road (±``max_heading_rad``) on one line are joined. Source: R [58]–[64],
    R 1.1. Limit: curves, which become chords; arrows, text and the edges of shadows, which become lines.
    """
    found = cv2.HoughLinesP(
        np.asarray(features.response > 0, np.uint8), 1, np.pi / 360, votes, None, min_length_px, max_gap_px
    )
    if found is None:
        return Boundaries(None, None, "no straight line found")
    segments = on_road(np.asarray(found, float).reshape(-1, 2, 2), view)
    segments = segments.where(np.abs(segments.slope) < np.tan(max_heading_rad))
    return nearest_pair(segments, min_length_m=min_length_m)


def on_road(ends_px: Array, view: View) -> Segments:
    """Segments of the picture, shape (n, 2, 2), on the road, without those that reach the horizon."""
    ends = view.ground(ends_px.reshape(-1, 2)).reshape(-1, 2, 2)
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    order = np.argsort(ends[:, :, 0], axis=1)
    return Segments(np.take_along_axis(ends, order[:, :, None], axis=1))


def nearest_pair(segments: Segments, *, min_length_m: float, join_m: float = 0.3) -> Boundaries:
    """The nearest line to the left and to the right of the vehicle, of pieces within ``join_m``.

    A line has at least ``min_length_m`` of pieces (a dash is 3 m long). Its side is that of its place ``NEAR_M``
    ahead.
    """
    place = segments.place_m(NEAR_M)
    left = _line(segments, place, min_length_m=min_length_m, join_m=join_m)
    right = _line(segments, -place, min_length_m=min_length_m, join_m=join_m)
    return both(left, right)


def _line(segments: Segments, aside_m: Array, *, min_length_m: float, join_m: float) -> Boundary | None:
    """The nearest group of pieces with ``aside_m`` > 0 and the least length, as one straight line."""
    for number in np.argsort(np.where(aside_m > 0, aside_m, np.inf)):
        if aside_m[number] <= 0:
            return None
        group = segments.where((aside_m >= aside_m[number]) & (aside_m < aside_m[number] + join_m))
        if group.length_m.sum() >= min_length_m:
            return _fitted(group)
    return None


def _fitted(group: Segments) -> Boundary:
    """The least-squares line y = a + b·x through points every ``STEP_M`` of the pieces.

    The width of a pixel on the road grows with x, so points and residuals are weighted by 1/x.
    """
    pieces = [
        first + np.linspace(0, 1, max(2, round(length / STEP_M)))[:, None] * (last - first)
        for (first, last), length in zip(group.ends_m, group.length_m, strict=True)
    ]
    points = np.concatenate(pieces)
    weight = 1 / np.maximum(points[:, 0], STEP_M)
    b, a = np.polyfit(points[:, 0], points[:, 1], 1, w=weight)
    near, far = float(points[:, 0].min()), float(points[:, 0].max())
    steps = [np.arange(first // STEP_M, last // STEP_M + 1) for first, last in group.ends_m[:, :, 0]]
    covered = np.unique(np.concatenate(steps)).size * STEP_M
    x_m = np.linspace(near, far, max(2, round((far - near) / STEP_M)))
    away = points[:, 1] - a - b * points[:, 0]
    residual = float(np.sqrt(np.average(away**2, weights=weight**2)))
    return Boundary(x_m, a + b * x_m, residual, min(1.0, covered / max(far - near, STEP_M)))
