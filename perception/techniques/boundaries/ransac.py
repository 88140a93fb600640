"""Curves through points with outliers, by random samples (inventory B17–B19, B21, B32).

Fischler and Bolles, Random Sample Consensus, Communications of the ACM 24(6), 1981.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.interpolate import BSpline

from perception.techniques.boundaries.evidence import STEP_M, Points, each_side, evenly, rms, sample_curve
from perception.techniques.image.picture import Boundaries, Boundary, Evidence
from trepid.types import Array, Mask, Positive

Tries = Annotated[int, Field(ge=1, le=2000)]
Basis = Callable[[Array], Array]  # x, shape (n,), to the values of k basis functions, shape (n, k)

RIDGE = 1e-9  # two equal points would make a sample singular
VOTERS = 240  # points that vote on samples
REFINED = 4  # samples: the best is often not quite free of outliers (Chum et al., LO-RANSAC, 2003)
KNOT_M = (12.0, 22.0)  # inner knots of the B-spline: one change of curvature within reach
BERNSTEIN = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float)  # from 1, t, t², t³
STRAIGHT = 0.4  # weight of the angles of the control polygon, relative to its length
BENDS_M = (0.0, 6.0, 12.0, 18.0)  # candidate ends of the straight section (B21)


@dataclass(frozen=True)
class Curve:
    """A curve y = basis(x)·c and its inliers."""

    coefficients: Array
    agreed: Points
    residual_m: float


def consensus(
    points: Points,
    basis: Basis,
    rng: np.random.Generator,
    *,
    size: int,
    inlier_m: float,
    tries: int,
    least: float = 0.2,
) -> Curve | None:
    """Least squares through the largest consensus within ``inlier_m``; None below the share ``least``.

    All samples are drawn and solved at once; a sample takes one point from each of ``size`` equal pieces of the
    road, because close points do not determine the course. With a share p of inliers the probability that every
    sample has an outlier is (1 − p^size)^n: 3·10⁻⁶ for p = 0.5, n = 100 and a parabola.
    """
    if len(points) < 2 * size:
        return None
    order = np.argsort(points.x_m, kind="stable")
    sorted_points = Points(points.x_m[order], points.y_m[order])
    whole = basis(sorted_points.x_m)
    weight = evenly(sorted_points)
    road = np.cumsum(weight**2)
    edges = np.searchsorted(road, np.linspace(0, road[-1], size + 1)[1:-1])
    edges = np.r_[0, np.clip(edges, 1, len(points) - 1), len(points)]
    picks = draw_samples(edges, tries, rng)
    matrices, values = whole[picks], sorted_points.y_m[picks]
    turned = matrices.transpose(0, 2, 1)
    guesses = np.linalg.solve(turned @ matrices + RIDGE * np.eye(size), (turned @ values[..., None]))[..., 0]
    voters = slice(None, None, -(-len(points) // VOTERS))
    agrees = np.abs(guesses @ whole[voters].T - sorted_points.y_m[voters]) < inlier_m
    best_first = np.argsort(-(agrees @ weight[voters]), kind="stable")
    best = [
        _refine_curve(
            sorted_points,
            whole,
            weight,
            np.abs(whole @ guesses[number] - sorted_points.y_m) < inlier_m,
            inlier_m=inlier_m,
            least=max(2 * size, least * len(points)),
        )
        for number in best_first[:REFINED]
    ]
    return max(
        (curve for curve in best if curve is not None),
        key=lambda curve: evenly(curve.agreed).sum(),
        default=None,
    )


def draw_samples(edges: Array | NDArray[np.int64], tries: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """``tries`` rows of random indices, one from each range between neighbours of ``edges``."""
    return np.floor(edges[:-1] + rng.random((tries, len(edges) - 1)) * np.diff(edges)).astype(np.int64)


def _refine_curve(
    points: Points, whole: Array, weight: Array, kept: Mask, *, inlier_m: float, least: float
) -> Curve | None:
    """Least squares through the points ``kept``, iterated with the inliers of each solution."""
    for _ in range(3):
        if np.count_nonzero(kept) < least:
            return None
        turned = whole[kept].T * weight[kept]
        coefficients = np.linalg.solve(
            turned @ whole[kept] + RIDGE * np.eye(whole.shape[1]), turned @ points.y_m[kept]
        )
        residual = np.abs(whole @ coefficients - points.y_m)
        kept = residual < inlier_m
    if not kept.any():
        return None
    return Curve(np.asarray(coefficients, float), points.where(kept), rms(residual[kept]))


def along(curve: Curve | None, basis: Basis) -> Boundary | None:
    """The curve from its first to its last inlier."""
    if curve is None or len(curve.agreed) < 2:
        return None
    near, far = float(curve.agreed.x_m[0]), float(curve.agreed.x_m[-1])
    if far - near < 2 * STEP_M:
        return None
    coefficients = curve.coefficients
    return sample_curve(lambda x_m: basis(x_m) @ coefficients, near, far, curve.agreed, curve.residual_m)


def polynomial(degree: int) -> Basis:
    """1, x, …, x^degree."""
    return lambda x_m: np.vander(x_m, degree + 1, increasing=True)


def two_sections(bend_m: float) -> Basis:
    """1, x, max(0, x − x₀)²: a straight line up to x₀ and a smooth parabola beyond (B21)."""
    return lambda x_m: np.column_stack([np.ones_like(x_m), x_m, np.maximum(0.0, x_m - bend_m) ** 2])


def cubic_spline(x_m: Array) -> Array:
    """The six cubic B-splines on the clamped knots 0, ``KNOT_M`` and 40 m (de Boor's recursion)."""
    knots = np.r_[[0.0] * 4, KNOT_M, [40.0] * 4]
    return np.asarray(BSpline.design_matrix(np.clip(x_m, 0.0, 40.0), knots, 3).toarray(), float)


def largest_consensus(
    evidence: Evidence, *families: Basis, size: int, inlier_m: float, tries: int
) -> Boundaries:
    """For each side the curve, of all ``families``, with the largest consensus."""

    def fit_points(points: Points) -> Boundary | None:
        best: Boundary | None = None
        most = 0.0
        for basis in families:
            curve = consensus(points, basis, evidence.rng, size=size, inlier_m=inlier_m, tries=tries)
            agreed = float(evenly(curve.agreed).sum()) if curve is not None else 0.0
            if agreed > most:
                best, most = along(curve, basis), agreed
        return best

    return each_side(evidence, fit_points)


def ransac_line(evidence: Evidence, *, inlier_m: Positive = 0.15, tries: Tries = 60) -> Boundaries:
    """A straight line y = a + bx a side (B17, B18). Source: R [81], [62], [70]. Limit: curves."""
    return largest_consensus(evidence, polynomial(1), size=2, inlier_m=inlier_m, tries=tries)


def ransac_parabola(evidence: Evidence, *, inlier_m: Positive = 0.15, tries: Tries = 100) -> Boundaries:
    """A parabola y = a + bx + cx² a side: an arc of R = 1/2c (B17, B18). Source: R [81]. Limit: S-bends."""
    return largest_consensus(evidence, polynomial(2), size=3, inlier_m=inlier_m, tries=tries)


def ransac_bspline(evidence: Evidence, *, inlier_m: Positive = 0.15, tries: Tries = 300) -> Boundaries:
    """A cubic B-spline with two inner knots a side (B19). Source: R [59]. Limit: gaps without paint."""
    return largest_consensus(evidence, cubic_spline, size=6, inlier_m=inlier_m, tries=tries)


def straight_curve(evidence: Evidence, *, inlier_m: Positive = 0.15, tries: Tries = 40) -> Boundaries:
    """Straight near, curved far, one smooth curve in two sections: y = a + bx + c·max(0, x − x₀)² (B21).

    Source: R [64], where the sections are fitted one after the other and meet in a fixed row; here both share one
    consensus, with the best x₀ of ``BENDS_M``. Limit: S-bends.
    """
    families = [two_sections(bend_m) for bend_m in BENDS_M]
    return largest_consensus(evidence, *families, size=3, inlier_m=inlier_m, tries=tries)


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

    def fit_points(points: Points) -> Boundary | None:
        if len(points) < 2 * samples or np.ptp(points.x_m) < 2 * STEP_M:
            return None
        picks = draw_samples(np.linspace(0, len(points), samples + 1), tries, evidence.rng)
        control = control_points(np.stack([points.x_m[picks], points.y_m[picks]], axis=-1))
        curves = bezier_points(control, np.linspace(0, 1, 24))
        scores = [_score(curve, legs, points, inlier_m) for curve, legs in zip(curves, control, strict=True)]
        kept = np.abs(points.y_m - _at(curves[int(np.argmax(scores))], points.x_m)) < inlier_m
        if np.count_nonzero(kept) < max(8, 0.2 * len(points)):
            return None
        return _through(points.where(kept))

    return each_side(evidence, fit_points)


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


def _through(points: Points) -> Boundary:
    """The Bezier curve through all inliers."""
    curve = bezier_points(control_points(np.column_stack([points.x_m, points.y_m])), np.linspace(0, 1, 60))
    curve = curve[np.argsort(curve[:, 0])]
    near, far = float(points.x_m[0]), float(points.x_m[-1])
    boundary = sample_curve(lambda x_m: np.interp(x_m, *curve.T), near, far, points)
    return replace(boundary, residual_m=rms(points.y_m - boundary.at(points.x_m)))
