"""Aly's fast urban detector: Bezier curves by random samples of a filtered picture (inventory B32; R [61])."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.techniques.boundaries.evidence import STEP_M, Points, each_side, rms, sampled
from perception.techniques.boundaries.ransac import drawn_from
from perception.techniques.image.picture import Boundaries, Boundary, Evidence
from trepid.types import Array, Positive

BERNSTEIN = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float)  # from 1, t, t², t³
STRAIGHT = 0.4  # weight of the angles of the control polygon, relative to its length


def bezier_points(control_m: Array, t: Array) -> Array:
    """B(t) = (1−t)³P₀ + 3(1−t)²tP₁ + 3(1−t)t²P₂ + t³P₃; control points (…, 4, 2) to points (…, n, 2)."""
    return np.vander(t, 4, increasing=True) @ BERNSTEIN @ control_m


def control_points(points_m: Array) -> Array:
    """Least-squares control points, shape (…, 4, 2), of ordered points (…, n, 2), n ≥ 4; t by the chord length."""
    chord = np.linalg.norm(np.diff(points_m, axis=-2), axis=-1)
    t = np.concatenate([np.zeros((*chord.shape[:-1], 1)), np.cumsum(chord, axis=-1)], axis=-1)
    t /= np.maximum(t[..., -1:], 1e-9)
    matrix = t[..., None] ** np.arange(4) @ BERNSTEIN
    turned = np.swapaxes(matrix, -1, -2)
    return np.asarray(np.linalg.solve(turned @ matrix + 1e-6 * np.eye(4), turned @ points_m), float)


def ransac_bezier(
    evidence: Evidence,
    *,
    inlier_m: Positive = 0.2,
    tries: Annotated[int, Field(ge=1, le=500)] = 60,
    samples: Annotated[int, Field(ge=4, le=20)] = 6,
) -> Boundaries:
    """The Bezier curve of third order, of ``tries`` random ones, with the best score for each side (B32).

    The score is Aly's: evidence under the curve, more for long and for straight curves. Use after ``bird_eye`` and
    ``oriented``. Source: R [61]; Aly, Real Time Detection of Lane Markers in Urban Streets (2008).
    Limit: lines that begin outside of its corridor; the score has no memory.
    """
    return each_side(evidence, lambda points: _best(points, evidence.rng, inlier_m, tries, samples))


def _best(
    points: Points, rng: np.random.Generator, inlier_m: float, tries: int, samples: int
) -> Boundary | None:
    if len(points) < 2 * samples or np.ptp(points.x_m) < 2 * STEP_M:
        return None
    edges = np.linspace(0, len(points), samples + 1)
    picks = drawn_from(edges, tries, rng)
    chosen = np.stack([points.x_m[picks], points.y_m[picks]], axis=-1)
    control = control_points(chosen)
    curves = bezier_points(control, np.linspace(0, 1, 24))
    scores = [_score(curve, legs, points, inlier_m) for curve, legs in zip(curves, control, strict=True)]
    curve = curves[int(np.argmax(scores))]
    off = np.abs(points.y_m - _at(curve, points.x_m))
    kept = off < inlier_m
    if np.count_nonzero(kept) < max(8, 0.2 * len(points)):
        return None
    return _refined(points.where(kept))


def _score(curve: Array, legs: Array, points: Points, inlier_m: float) -> float:
    """Points under the curve × (1 + length + straightness), both as shares as in Aly's section III.D."""
    agreed = np.count_nonzero(np.abs(points.y_m - _at(curve, points.x_m)) < inlier_m)
    length = np.ptp(curve[:, 0]) / max(float(np.ptp(points.x_m)), 1e-6)
    steps = np.diff(legs, axis=0)
    turn = float(np.abs(np.diff(np.arctan2(steps[:, 1], steps[:, 0]))).mean())
    return agreed * (1 + length - STRAIGHT * turn)


def _at(curve: Array, x_m: Array) -> Array:
    """y of the curve at ``x_m``; NaN beyond its ends."""
    order = np.argsort(curve[:, 0])
    return np.interp(x_m, curve[order, 0], curve[order, 1], left=np.nan, right=np.nan)


def _refined(points: Points) -> Boundary:
    """The Bezier curve through all inliers."""
    curve = bezier_points(control_points(np.column_stack([points.x_m, points.y_m])), np.linspace(0, 1, 60))
    curve = curve[np.argsort(curve[:, 0])]
    near, far = float(points.x_m[0]), float(points.x_m[-1])
    boundary = sampled(lambda x_m: np.interp(x_m, *curve.T), near, far, points)
    return replace(boundary, residual_m=rms(points.y_m - boundary.at(points.x_m)))
