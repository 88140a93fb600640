"""Straight boundaries from line features by Hough transforms (inventory B08, B09)."""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.techniques.boundaries.evidence import STEP_M, Points, both
from perception.techniques.image.picture import Boundaries, Boundary, Evidence, GroundView
from trepid.types import Array, Mask, Positive, PositiveShare

Votes = Annotated[int, Field(ge=1)]
MaxHeading = Annotated[float, Field(gt=0, lt=1.4)]  # [rad]
NEAR_M = 6.0  # where the places of lines are compared: the nearest road of most cameras
STRONGEST = 200  # lines of the standard Hough transform that are used
NO_LINE = Boundaries(None, None, "no straight line found")


@dataclass(frozen=True)
class RoadPieces:
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

    def where(self, kept: Mask) -> "RoadPieces":
        """The segments selected by the mask ``kept``."""
        return RoadPieces(self.ends_m[kept])

    def within(self, max_heading_rad: float) -> "RoadPieces":
        """The segments along the road."""
        return self.where(np.abs(self.slope) < np.tan(max_heading_rad))

    def points(self, step_m: float) -> Points:
        """Points about every ``step_m`` of all segments."""
        pieces = [
            first + np.linspace(0, 1, max(2, round(length / step_m)))[:, None] * (last - first)
            for (first, last), length in zip(self.ends_m, self.length_m, strict=True)
        ]
        road = np.concatenate(pieces) if pieces else np.empty((0, 2))
        return Points(road[:, 0], road[:, 1])


def hough(
    evidence: Evidence,
    *,
    votes: Votes = 12,
    min_length_px: Positive = 9.0,
    max_gap_px: Positive = 10.0,
    max_heading_rad: MaxHeading = 0.35,
    min_length_m: Positive = 3.0,
) -> Boundaries:
    """The nearest line on each side among the segments of the probabilistic Hough transform (B08, B09).

    ρ = x·cosθ + y·sinθ. Segments along the road (±``max_heading_rad``) on one line are joined. Source: R [58]–[64],
    R 1.1. Limit: curves, which become chords; arrows, text and the edges of shadows.
    """
    segments = hough_segments(evidence, np.pi / 360, votes, min_length_px, max_gap_px)
    if segments is None:
        return NO_LINE
    return nearest_pair(segments.within(max_heading_rad), min_length_m=min_length_m)


def hough_standard(
    evidence: Evidence, *, votes: Votes = 15, share: PositiveShare = 0.35, max_heading_rad: MaxHeading = 0.35
) -> Boundaries:
    """The nearest pair among the strongest lines of the standard Hough transform (B08).

    ρ = x·cosθ + y·sinθ; lines with less than ``share`` of the votes of the strongest do not count. Source: R
    [58]–[64]. It joins dashes over any gap. Limit: the ends of a line; curves; arrows and text.
    """
    view = evidence.view
    rows = np.flatnonzero((view.ahead_m > 0) & (view.ahead_m < 25.0))
    binary = np.asarray(evidence.features.response > 0, np.uint8)
    found = cv2.HoughLinesWithAccumulator(binary, 1, np.pi / 360, votes) if len(rows) > 1 else None
    if found is None:
        return NO_LINE
    rho, theta, strength = np.asarray(found, float).reshape(-1, 3)[:STRONGEST].T
    good = (np.abs(np.cos(theta)) > 0.05) & (strength >= share * strength[0])
    rho, theta = rho[good], theta[good]
    ends = [
        np.column_stack([(rho - row * np.sin(theta)) / np.cos(theta), np.full(len(rho), row)])
        for row in (float(rows[-1]), float(rows[0]))
    ]
    segments = _on_road(np.stack(ends, axis=1), view).within(max_heading_rad)
    return nearest_pair(_apart(segments), min_length_m=3.0)


def _apart(segments: RoadPieces, *, least_m: float = 0.6) -> RoadPieces:
    """The lines (strongest first) that lie ``least_m`` from all stronger ones at ``NEAR_M``."""
    place = segments.place_m(NEAR_M)
    kept: list[int] = []
    for number, here in enumerate(place):
        if all(abs(here - place[other]) > least_m for other in kept):
            kept.append(number)
    return segments.where(np.isin(np.arange(len(place)), kept))


def hough_segments(
    evidence: Evidence, step_rad: float, votes: int, min_length_px: float, max_gap_px: float
) -> RoadPieces | None:
    """The segments of the probabilistic Hough transform on the road; None without any in the picture."""
    binary = np.asarray(evidence.features.response > 0, np.uint8)
    found = cv2.HoughLinesP(binary, 1, step_rad, votes, None, min_length_px, max_gap_px)
    return None if found is None else _on_road(np.asarray(found, float).reshape(-1, 2, 2), evidence.view)


def _on_road(ends_px: Array, view: GroundView) -> RoadPieces:
    """Segments of the picture, shape (n, 2, 2), on the road, without those that reach the horizon."""
    ends = view.ground(ends_px.reshape(-1, 2)).reshape(-1, 2, 2)
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    order = np.argsort(ends[:, :, 0], axis=1)
    return RoadPieces(np.take_along_axis(ends, order[:, :, None], axis=1))


def nearest_pair(segments: RoadPieces, *, min_length_m: float) -> Boundaries:
    """The nearest line to the left and to the right of the vehicle ``NEAR_M`` ahead."""
    place = segments.place_m(NEAR_M)
    return both(_nearest(segments, place, min_length_m), _nearest(segments, -place, min_length_m))


def _nearest(
    segments: RoadPieces, aside_m: Array, min_length_m: float, *, join_m: float = 0.3
) -> Boundary | None:
    """The nearest group of pieces within ``join_m`` with ``aside_m`` > 0 and the least length, as one line."""
    for number in np.argsort(np.where(aside_m > 0, aside_m, np.inf)):
        if aside_m[number] <= 0:
            return None
        group = segments.where((aside_m >= aside_m[number]) & (aside_m < aside_m[number] + join_m))
        if group.length_m.sum() >= min_length_m:
            return _fit_line(group)
    return None


def _fit_line(group: RoadPieces) -> Boundary:
    """The least-squares line y = a + b·x through points every ``STEP_M`` of the pieces.

    The width of a pixel on the road grows with x, so points and residuals are weighted by 1/x.
    """
    points = group.points(STEP_M)
    weight = 1 / np.maximum(points.x_m, STEP_M)
    b, a = np.polyfit(points.x_m, points.y_m, 1, w=weight)
    near, far = float(points.x_m.min()), float(points.x_m.max())
    steps = [np.arange(first // STEP_M, last // STEP_M + 1) for first, last in group.ends_m[:, :, 0]]
    covered = np.unique(np.concatenate(steps)).size * STEP_M
    x_m = np.linspace(near, far, max(2, round((far - near) / STEP_M)))
    away = points.y_m - a - b * points.x_m
    residual = float(np.sqrt(np.average(away**2, weights=weight**2)))
    return Boundary(x_m, a + b * x_m, residual, min(1.0, covered / max(far - near, STEP_M)))
