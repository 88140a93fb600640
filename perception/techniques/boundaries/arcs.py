"""A clothoid lane through both boundaries, and through where they were: for bends too tight for a parabola y(x).

Unknown are p = (e, ψ, κ, κ', W): offset, heading, curvature and its rate at the axle, and the width. A road point
lies d(p) to the left of the lane centre (:func:`perception.lane.model.geometry.lane_coordinates`); on a boundary

    r = |d(p)| - W/2 = 0.

The arc through three points of one line gives a lane on each side of it. The lane with most points on both of its
boundaries is refined by Gauss-Newton steps with the weights 1/(1 + (r/s)²)² (Geman-McClure). The boundaries of
earlier frames, moved by odometry, count beside and behind the nearest visible road: e and ψ at the axle are then
measured and not extrapolated. In the reference world a parabola of R = 9 m lies 1 m beside its arc at 8 m.

Chernov, Circular and Linear Regression (2010), chapter 4.
"""

import numpy as np

from perception.lane.model.geometry import (
    KAPPA,
    PSI,
    WIDTH,
    E,
    distances,
    lane_coordinates,
    lane_curve,
    lane_derivatives,
)
from perception.techniques.boundaries.evidence import (
    LEAST,
    STEP_M,
    Points,
    both,
    evenly,
    rms,
    road_points,
    support,
)
from perception.techniques.boundaries.ransac import VOTERS, Tries, draw_samples
from perception.techniques.image.picture import (
    Boundaries,
    Boundary,
    Evidence,
    GroundView,
    MeasuredLane,
    sight_share,
)
from trepid.clothoid import Lane
from trepid.types import Array, Mask, Positive

REACH_M, BEND_1PM = 25.0, 0.02  # of a camera at its usual height
STEPS = 6
SPREAD_M = 0.1  # σ of a point
PRIOR_SIGMA = np.array([0.4, 0.06, 1.0, 0.2, 0.3])  # of (e, ψ, κ, κ', W); κ and κ' times bend_1pm
BEHIND_M = 3.0  # the remembered boundaries reach so far behind the axle
KEPT = 0.9  # share of the last width in that expected now
UNSEEN = 0.36  # support of a boundary that is not visible; its root is ONE_SIDE of the score
MEMORY = 2.0  # weight of a remembered point; the visible points of STEP_M weigh up to 8
MOST_OFFSET, MOST_HEADING_RAD, MOST_BEND_1PM = 0.6, 0.8, 0.2  # the offset in lane widths
MOST_WIDENING = 0.35
DRAWN_M, DRAWN = 0.3, 100.0  # scale and weight of the points of boundaries that are drawn, not measured


def arcs(
    evidence: Evidence,
    *,
    width_m: Positive = 3.4,
    reach_m: Positive | None = None,
    inlier_m: Positive = 0.15,
    bend_1pm: Positive | None = None,
    tries: Tries = 120,
) -> Boundaries:
    """The boundaries of the clothoid lane with most points within ``inlier_m``, up to ``reach_m`` ahead.

    ``bend_1pm``: σ of the curvature of its roads. By default the camera decides: it sees as far as its height lets
    it (REACH_M), and there a bend leads as far aside as one of BEND_1PM at REACH_M, by κ·x²/2.
    The lane of the last frame is one more candidate. Source: derived. Limit: S-bends within the reach.
    """
    share = sight_share(evidence.view.camera)
    reach_m = REACH_M * share if reach_m is None else reach_m
    bend_1pm = BEND_1PM / share**2 if bend_1pm is None else bend_1pm
    points = road_points(evidence)
    points = points.where(points.x_m < reach_m)
    lanes = _candidates(points, width_m, tries, evidence.rng)
    before = evidence.predicted or Boundaries(None, None)
    if (last := _through(before, width_m)) is not None:
        lanes = np.vstack([lanes, last])
    if len(points) < LEAST or not len(lanes):
        return both(None, None)
    old = _remembered_points(before, float(points.x_m[0]))
    few = slice(None, None, -(-len(points) // VOTERS))
    x_m, y_m = np.r_[points.x_m[few], old.x_m], np.r_[points.y_m[few], old.y_m]
    weight = np.r_[evenly(points)[few], np.full(len(old), MEMORY)]
    usual_m = width_m if last is None else KEPT * float(last[WIDTH]) + (1 - KEPT) * width_m
    lane = _refine_lanes(x_m, y_m, weight, lanes, usual_m, inlier_m, bend_1pm)
    left, right = (_boundary(points, lane, side, before, inlier_m) for side in (1, -1))
    missing = [name for name, side in (("left", left), ("right", right)) if side.support <= UNSEEN]
    if len(missing) == 2:
        return both(None, None)
    return Boundaries(left, right, f"no {missing[0]} line" if missing else "")


def arc_lane(boundaries: Boundaries, view: GroundView, *, width_m: Positive = 3.4) -> MeasuredLane | None:
    """The clothoid lane through the boundaries; its width is ``width_m`` with one of them; None without.

    The lane state of :func:`arcs`. Limit: as there.
    """
    lane = _through(boundaries, width_m)
    if lane is None:
        return None
    e, psi, kappa, rate, width = lane.tolist()
    return MeasuredLane(Lane(e, psi, kappa, rate), width if boundaries.side_count == 2 else None)


def _through(boundaries: Boundaries, width_m: float) -> Array | None:
    """The lane (5,) through the points of the boundaries; None without, or where there is none."""
    if not boundaries.signed_sides:
        return None
    starts = []
    for side, sign in boundaries.signed_sides:
        for last in (len(side.x_m) - 1, len(side.x_m) // 2):
            three = [0, last // 2, last]
            starts.append(_lanes(side.x_m[three, None], side.y_m[three, None], sign * width_m / 2, width_m))
    x_m = np.concatenate([side.x_m for side, _ in boundaries.signed_sides])
    y_m = np.concatenate([side.y_m for side, _ in boundaries.signed_sides])
    lane = _refine_lanes(
        x_m, y_m, np.full(len(x_m), DRAWN), np.concatenate(starts), width_m, DRAWN_M, MOST_BEND_1PM
    )
    return lane if _is_plausible(lane[None], width_m)[0] else None


def _candidates(points: Points, width_m: float, tries: int, rng: np.random.Generator) -> Array:
    """Lanes (n, 5) on both sides of arcs through three points, one from each third of the road."""
    if len(points) < LEAST:
        return np.empty((0, 5))
    road = np.cumsum(evenly(points) ** 2)
    edges = np.r_[0, np.searchsorted(road, road[-1] * np.array([1, 2]) / 3), len(points)]
    picks = draw_samples(edges, tries, rng)
    x_m, y_m = points.x_m[picks].T, points.y_m[picks].T
    found = np.concatenate([_lanes(x_m, y_m, aside * width_m, width_m) for aside in (0.5, -0.5)])
    return np.asarray(found[_is_plausible(found, width_m)], float)


def _is_plausible(lanes: Array, width_m: float) -> Mask:
    """Which of the lanes (n, 5) contain the vehicle, lead ahead, and are no tighter than roads are."""
    good = np.isfinite(lanes).all(axis=1) & (np.abs(lanes[:, E]) < MOST_OFFSET * width_m)
    good &= (np.abs(lanes[:, PSI]) < MOST_HEADING_RAD) & (np.abs(lanes[:, KAPPA]) < MOST_BEND_1PM)
    return np.asarray(good & (np.abs(lanes[:, WIDTH] / width_m - 1) < MOST_WIDENING))


def _lanes(x_m: Array, y_m: Array, aside_m: float, width_m: float) -> Array:
    """The lanes (n, 5) with a boundary, ``aside_m`` left of their centre, through three points (3, n) each."""
    (x1, x2, x3), (y1, y2, y3) = x_m, y_m
    across = (x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1)
    sides = np.hypot(x2 - x1, y2 - y1) * np.hypot(x3 - x2, y3 - y2) * np.hypot(x3 - x1, y3 - y1)
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = 2 * across / sides  # of the circle through them
        course, middle_m = np.arctan2(y3 - y1, x3 - x1), (x1 + x3) / 2  # of the chord
        half = np.arcsin(np.clip(kappa * np.hypot(x3 - x1, y3 - y1) / 2, -0.99, 0.99))
        # Above the middle of the chord the circle has the course of the chord, sag = tan(half/2)·chord/2 aside.
        sag_m = np.tan(half / 2) * np.hypot(x3 - x1, y3 - y1) / 2
        x0, y0 = middle_m + sag_m * np.sin(course), (y1 + y3) / 2 - sag_m * np.cos(course)
        start = np.arcsin(np.clip(np.sin(course) - kappa * x0, -0.99, 0.99))  # of the circle at x = 0
        place_m = y0 - x0 * (np.sin(course) + np.sin(start)) / (np.cos(course) + np.cos(start))
        bend = kappa / (1 + kappa * aside_m)
    return np.stack([aside_m - place_m * np.cos(start), -start, bend, 0 * bend, 0 * bend + width_m], axis=1)


def _refine_lanes(
    x_m: Array, y_m: Array, weight: Array, lanes: Array, width_m: float, scale_m: float, bend_1pm: float
) -> Array:
    """The best of ``lanes`` (n, 5) for the points, and of Gauss-Newton steps from there."""

    fits = _is_plausible(lanes, width_m)
    lanes = lanes[fits] if fits.any() else lanes[:1]
    likeness = _alike(_off(x_m, y_m, lanes), scale_m)
    best = int(np.argmax(likeness @ weight))
    lane, alike = lanes[best], likeness[best]
    found, most = lane, float(alike @ weight) if fits.any() else 0.0
    off, slope = _linearise(x_m, y_m, lane)
    for _ in range(STEPS):
        lane = _step_lane(lane, off, slope, weight * alike, width_m, bend_1pm)
        off, slope = _linearise(x_m, y_m, lane)
        alike = _alike(off, scale_m)
        if (votes := float(alike @ weight)) > most and _is_plausible(lane[None], width_m)[0]:
            found, most = lane, votes
    return found


def _off(x_m: Array, y_m: Array, lanes: Array) -> Array:
    """r of the points (m,) for each of the lanes (n, 5), (n, m)."""
    return np.asarray(np.abs(distances(x_m, y_m, lanes)) - lanes[:, WIDTH, None] / 2)


def _alike(off_m: Array, scale_m: float) -> Array:
    near = off_m / scale_m
    near *= near
    near += 1
    near *= near
    return np.asarray(np.reciprocal(near, out=near))


def _linearise(x_m: Array, y_m: Array, lane: Array) -> tuple[Array, Array]:
    """r of the points (m,) for one lane, and ∂r/∂p (5, m)."""
    slope = np.empty((5, len(x_m)))
    _, across_m = lane_derivatives(x_m, y_m, lane, slope)
    slope[:WIDTH] *= np.where(across_m < 0, -1.0, 1.0)
    slope[WIDTH] = -0.5
    return np.abs(across_m) - lane[WIDTH] / 2, slope


def _step_lane(
    lane: Array, off: Array, slope: Array, weight: Array, width_m: float, bend_1pm: float
) -> Array:
    """The lane after a Gauss-Newton step towards the usual lane, ``width_m`` wide, by r and ∂r/∂p of the points."""
    prior = 1 / (PRIOR_SIGMA * [1.0, 1.0, bend_1pm, bend_1pm, 1.0]) ** 2
    weighted = slope * (weight / SPREAD_M**2)
    normal = weighted @ slope.T
    normal[np.diag_indices(5)] += prior
    away = lane - [0.0, 0.0, 0.0, 0.0, width_m]
    return np.asarray(lane - np.linalg.solve(normal, weighted @ off + prior * away), float)


def _remembered_points(before: Boundaries, near_m: float) -> Points:
    """Points of earlier boundaries clearly nearer than the visible road: at standstill there are none."""
    kept = [(side.x_m, side.y_m) for side, _ in before.signed_sides]
    x_m = np.concatenate([x for x, _ in kept] or [np.empty(0)])
    y_m = np.concatenate([y for _, y in kept] or [np.empty(0)])
    return Points(x_m, y_m).where((x_m > -BEHIND_M) & (x_m < near_m - STEP_M))


def _boundary(points: Points, lane: Array, side: int, before: Boundaries, inlier_m: float) -> Boundary:
    """The boundary of the lane on ``side`` and, nearer than the visible road, what is remembered of it.

    Its support is UNSEEN where too few points lie on it, as of the inner line of a bend beside the picture.
    """
    off = side * lane_coordinates(points.x_m, points.y_m, lane)[1] - lane[WIDTH] / 2
    on: Mask = np.abs(off) < 2 * inlier_m
    seen = points.where(on)
    near_m, far_m = float(points.x_m[0]), float(points.x_m[-1])
    found = len(seen) >= LEAST and np.ptp(seen.x_m) > 2 * STEP_M
    if found:
        near_m, far_m = float(seen.x_m[0]), float(seen.x_m[-1])
    curve = lane_curve(lane, np.arange(-BEHIND_M, 2 * far_m, STEP_M))[0 if side > 0 else 1]
    curve = curve[np.gradient(curve.real) > 0]  # to where it turns back
    x_m = np.arange(near_m, max(min(far_m, float(curve.real.max())), near_m + STEP_M), STEP_M / 2)
    y_m = np.interp(x_m, curve.real, curve.imag)
    old = before.left if side > 0 else before.right
    if old is not None:
        kept = _apart(old.x_m, near_m)
        x_m, y_m = np.r_[old.x_m[kept], x_m], np.r_[old.y_m[kept], y_m]
    if not found:
        return Boundary(x_m, y_m, 0.0, UNSEEN)
    return Boundary(x_m, y_m, rms(off[on]), max(support(seen.x_m, near_m, far_m), 2 * UNSEEN))


def _apart(x_m: Array, near_m: float) -> list[int]:
    """Indices of remembered points behind ``near_m``, half of STEP_M apart at least; the oldest stay."""
    kept: list[int] = []
    for number, x in enumerate(x_m.tolist()):
        if -BEHIND_M < x < near_m and (not kept or x - x_m[kept[-1]] > STEP_M / 2):
            kept.append(number)
    return kept
