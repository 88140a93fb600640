"""From boundary points to a lane with evidence: vote for a shape, fit it, count the points on its boundaries."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.edges import RoadEdgeFinder, RoadImage
from perception.lane.detection.grid import LateralGrid
from perception.lane.detection.vote import LaneGuess, VoteSettings, vote_lane
from perception.lane.model.evidence import NO_SUPPORT, EvidenceSettings, LaneFit, boundary_support
from perception.lane.model.fit import FitSettings, Fitted, fit_lane, log_evidence
from perception.lane.model.geometry import (
    KAPPA,
    KAPPA_RATE,
    PITCH,
    PSI,
    WIDTH,
    E,
    LaneState,
    RoadPoints,
    lane_coordinates,
    levelled,
    parallel_curve,
)
from trepid.camera import Camera
from trepid.types import Array, Floats

STRAIGHT = np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0])  # times a state: the state without its bend
EVIDENCE_REACH_M = 30.0  # rows beyond are too few to count as evidence
MIN_DOUBLE = 0.2  # share of the points of a double line that lie between two stripes


def find_lane(
    points: RoadPoints,
    prior: LaneState,
    stages: Sequence[VoteSettings],
    grid: LateralGrid,
    *,
    fit: FitSettings,
    evidence: EvidenceSettings,
    prior_weight: float,
    min_support: float,
    straight: LaneState | None = None,
) -> LaneFit:
    """The lane that ``points`` support best, searched in ``stages`` around ``prior`` and fitted with it.

    Without stages the fit starts at ``prior`` itself, and shorter pieces of line count as seen. With a prior
    ``straight`` for a straight road, the straight lane wins unless the points favour the bent one.
    """
    start = prior.mean
    if stages:
        guess = _voted(points, prior, stages, grid, prior_weight)
        if guess.support < min_support:
            return LaneFit(state=prior, left=NO_SUPPORT, right=NO_SUPPORT, residual=0.0)
        start = prior.mean.copy()
        start[[E, PSI, KAPPA, WIDTH]] = (
            guess.offset_m, guess.heading_rad, guess.curvature_1pm, guess.width_m,
        )  # fmt: skip
    near, side = _assign(points, start, grid.camera, fit)
    fitted = _fitted(near, side, prior, straight, start, grid.camera, fit)
    on_middles = _on_middles(near, side, fitted.residual_m)
    if on_middles is not near:
        near = on_middles
        fitted = _fitted(near, side, prior, straight, fitted.state.mean, grid.camera, fit)
    foreseen = not stages
    lane = _with_evidence(fitted, points, near, side, grid, fit, evidence, foreseen=foreseen)
    if lane.boundaries_seen != 1:
        return lane
    # Points near the missing line are no line, so they must not change the width.
    own = np.flatnonzero(side == (1.0 if lane.left.seen else -1.0))
    near, side = near.part(own), side[own]
    fitted = _fitted(near, side, prior, straight, fitted.state.mean, grid.camera, fit)
    return _with_evidence(fitted, points, near, side, grid, fit, evidence, foreseen=foreseen)


def _on_middles(points: RoadPoints, side: Array, residual_m: Array) -> RoadPoints:
    """``points`` with single stripes of a double line moved to its middle, where the lane ends.

    Where one stripe is worn away, only the other is detected; its distance from the middle is known from the
    places with both.
    """
    double = points.half_m > 0
    if not double.any():
        return points
    shift_m = np.zeros(len(side))
    for own in (side > 0, side < 0):
        both = own & double
        if np.count_nonzero(both) > MIN_DOUBLE * np.count_nonzero(own):
            half_m = float(np.median(points.half_m[both]))
            alone = own & ~double & (np.abs(np.abs(residual_m) - half_m) < half_m / 2)
            shift_m[alone] = np.copysign(half_m, residual_m[alone])
    return replace(points, y_m=points.y_m - shift_m) if shift_m.any() else points


def _fitted(
    points: RoadPoints,
    side: Array,
    prior: LaneState,
    straight: LaneState | None,
    start: Array,
    camera: Camera,
    fit: FitSettings,
) -> Fitted:
    """The lane fitted with ``prior``, or with the prior ``straight`` where the straight lane wins."""
    bent = fit_lane(points, side, prior, start, camera, fit)
    if straight is None:
        return bent
    plain = fit_lane(points, side, straight, start * STRAIGHT, camera, fit)
    return _simpler(plain, straight, bent, prior, points, side, fit)


def _voted(
    points: RoadPoints,
    prior: LaneState,
    stages: Sequence[VoteSettings],
    grid: LateralGrid,
    prior_weight: float,
) -> LaneGuess:
    """The lane with the most votes, refined stage by stage."""
    x_m, y_m = levelled(points, prior.mean[PITCH], grid.camera)
    flat = replace(points, x_m=x_m, y_m=y_m)
    guess = _guess(prior)
    for stage in stages:
        guess = vote_lane(flat, guess, stage, bands=len(grid.ahead_m), prior_weight=prior_weight)
    return guess


def find_road(
    finder: RoadEdgeFinder,
    image: RoadImage,
    prior: LaneState,
    *,
    straight: LaneState,
    fit: FitSettings,
    evidence: EvidenceSettings,
) -> LaneFit:
    """The unmarked road whose edges enclose the most road likelihood, as a lane as wide as the road.

    Searches all shapes, then shapes near the best; as in :func:`find_lane`, ``prior`` competes with
    ``straight``.
    """
    sums, steps = finder.sums(image), finder.steps(image)
    start = finder.search(sums, steps, prior)
    sums = finder.sums(image, lane=start)
    start = finder.search(sums, steps, prior, near=start)
    return _road(finder, sums, start, prior, straight, fit, evidence)


def follow_road(
    finder: RoadEdgeFinder,
    sums: Floats,
    prior: LaneState,
    *,
    fit: FitSettings,
    evidence: EvidenceSettings,
) -> LaneFit:
    """The edges near those of ``prior`` in the likelihood ``sums``, without a search."""
    return _road(finder, sums, prior.mean, prior, None, fit, evidence)


def _road(
    finder: RoadEdgeFinder,
    sums: Floats,
    start: Array,
    prior: LaneState,
    straight: LaneState | None,
    fit: FitSettings,
    evidence: EvidenceSettings,
) -> LaneFit:
    points, side = finder.points(sums, start)
    fitted = _fitted(points, side, prior, straight, start, finder.grid.camera, fit)
    found = _with_evidence(fitted, points, points, side, finder.grid, fit, evidence)
    return replace(found, by_edges=True, apart=finder.apart(sums, found.state.mean))


def _simpler(
    plain: Fitted,
    straight: LaneState,
    bent: Fitted,
    prior: LaneState,
    points: RoadPoints,
    side: Array,
    fit: FitSettings,
) -> Fitted:
    """The straight lane unless the log evidence of the bent one exceeds it by ``straight_log_odds``."""
    odds = log_evidence(plain, points, side, straight, fit) - log_evidence(bent, points, side, prior, fit)
    return plain if odds + fit.straight_log_odds > 0 else bent


def _guess(prior: LaneState) -> LaneGuess:
    """The prior as the start of a vote, with minimum deviations that leave room for a search."""
    sigma = np.sqrt(np.diag(prior.covariance))
    return LaneGuess(
        offset_m=float(prior.mean[E]),
        heading_rad=float(prior.mean[PSI]),
        curvature_1pm=float(prior.mean[KAPPA]),
        width_m=float(prior.mean[WIDTH]),
        offset_sigma_m=float(max(sigma[E], 0.15)),
        heading_sigma_rad=float(max(sigma[PSI], 0.03)),
        curvature_sigma_1pm=float(max(sigma[KAPPA], 0.01)),
        width_sigma_m=float(max(sigma[WIDTH], 0.15)),
    )


def _assign(points: RoadPoints, mean: Array, camera: Camera, fit: FitSettings) -> tuple[RoadPoints, Array]:
    """The points near a boundary of ``mean`` and the side (+1 left, −1 right) that each is on."""
    x_m, y_m = levelled(points, mean[PITCH], camera)
    _, distance, _ = lane_coordinates(x_m, y_m, mean)
    side = np.where(distance > 0, 1.0, -1.0)
    gate = 3 * (fit.gate_m + fit.gate_growth * points.x_m) + points.sigma_m
    close = np.flatnonzero(np.abs(distance - side * (mean[WIDTH] / 2)) < gate)
    return points.part(close), side[close]


def _with_evidence(
    fitted: Fitted,
    points: RoadPoints,
    near: RoadPoints,
    side: Array,
    grid: LateralGrid,
    fit: FitSettings,
    evidence: EvidenceSettings,
    *,
    foreseen: bool = False,
) -> LaneFit:
    """The fitted state with the support of each boundary; a boundary that is seen predicts the other one."""
    state, residual = fitted.state, fitted.residual_m
    accepted = (fitted.weight > 0) & (np.abs(residual) < fit.gate_m + near.sigma_m)
    density = len(points.x_m) / grid.area_m2
    seen_in = _visible(state.mean, grid)
    left, right = (
        boundary_support(near, own, visible, density_per_m=density, gate_m=fit.gate_m, settings=evidence)
        for own, visible in zip((accepted & (side > 0), accepted & (side < 0)), seen_in, strict=True)
    )
    if foreseen or left.seen != right.seen:
        left, right = left.foreseen(evidence), right.foreseen(evidence)
    scaled = (residual / near.sigma_m)[accepted]
    rms = math.sqrt(float(scaled @ scaled) / len(scaled)) if len(scaled) else 0.0
    return LaneFit(state=state, left=left, right=right, residual=rms)


def _visible(mean: Array, grid: LateralGrid) -> NDArray[np.bool_]:
    """Whether the left and the right boundary are inside the image and in reach, per band, shape (2, bands).

    Approximates the boundaries by circles plus κ'·x³/6, accurate to a few columns.
    """
    camera = grid.camera
    stretch = np.maximum(1 + mean[PITCH] / camera.height_m * grid.ahead_m, 0.3)
    x_m = camera.x_m + grid.ahead_m / stretch
    place_m = np.array([[0.5], [-0.5]]) * mean[WIDTH] - mean[E]
    y_m = parallel_curve(x_m, mean[PSI], mean[KAPPA], place_m) + mean[KAPPA_RATE] / 6 * x_m**3
    aside_m = (y_m - camera.y_m) * stretch - math.tan(camera.yaw_rad) * grid.ahead_m
    column = camera.cx_px - aside_m * grid.metre_px
    return (column >= 0) & (column < camera.width_px) & (x_m < EVIDENCE_REACH_M)
