"""From boundary points to a lane with evidence: fit it, count the points on its boundaries."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.grid import LateralGrid
from perception.lane.model.evidence import EvidenceSettings, LaneFit, boundary_support, support_end_m
from perception.lane.model.fit import FitSettings, LaneSolution, fit_lane, log_evidence
from perception.lane.model.geometry import (
    PITCH,
    WIDTH,
    E,
    LaneState,
    RoadPoints,
    lane_coordinates,
    level_points,
    parallel_curve,
)
from trepid.types import Array

STRAIGHT = np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0])  # times a state: the state without its bend
EVIDENCE_REACH_M = 30.0  # rows beyond are too few to count as evidence
WITHIN_M = 0.7  # from a boundary; nearer lines belong to it, as the second line of a kerb
WITHIN_SIGMAS = 3.0  # of a point that supports a lane; the gate would take lines that bend away from it
TWO_DASHES_M = 6.0  # of 3 m each, or one and a gap
MIN_DOUBLE = 0.2  # share of the points of a double line that lie between two stripes


@dataclass(frozen=True)
class LaneFitter:
    """Fits lanes to the points of one kind of boundary (lines or edges) on a grid."""

    grid: LateralGrid
    fit: FitSettings
    evidence: EvidenceSettings

    def solve(
        self, points: RoadPoints, side: Array, prior: LaneState, start: Array, straight: LaneState | None
    ) -> LaneSolution:
        """The lane fitted with ``prior``, or with the prior ``straight`` for a straight road.

        The straight lane wins unless the log evidence of the bent one exceeds it by ``straight_log_odds``.
        """
        camera, fit = self.grid.camera, self.fit
        bent = fit_lane(points, side, prior, start, camera, fit)
        if straight is None:
            return bent
        plain = fit_lane(points, side, straight, start * STRAIGHT, camera, fit)
        odds = log_evidence(plain, points, side, straight, fit) - log_evidence(bent, points, side, prior, fit)
        return plain if odds + fit.straight_log_odds > 0 else bent

    def assign_sides(self, points: RoadPoints, mean: Array) -> tuple[RoadPoints, Array]:
        """The points near a boundary of ``mean`` and the side (+1 left, −1 right) that each is on."""
        x_m, y_m = level_points(points, mean[PITCH], self.grid.camera)
        _, distance, _ = lane_coordinates(x_m, y_m, mean)
        side = np.where(distance > 0, 1.0, -1.0)
        gate = 3 * (self.fit.gate_m + self.fit.gate_growth * points.x_m) + points.sigma_m
        close = np.flatnonzero(np.abs(distance - side * (mean[WIDTH] / 2)) < gate)
        return points.part(close), side[close]

    def with_evidence(
        self, fitted: LaneSolution, near: RoadPoints, side: Array, *, count: int, foreseen: bool = False
    ) -> LaneFit:
        """The lane fitted to ``near`` with the support of each boundary; ``count``: of all points of the frame.

        A boundary that is seen predicts the other one; with ``foreseen`` both are predicted.
        """
        state, residual, gate_m = fitted.state, fitted.residual_m, self.fit.gate_m
        accepted = (fitted.weight > 0) & (np.abs(residual) < gate_m + near.sigma_m)
        density_per_m = count / self.grid.area_m2
        shown, ahead_m = self._bands_in_image(state.mean)
        sides = accepted & (side > 0), accepted & (side < 0)
        left, right = (
            boundary_support(
                near, own, visible, density_per_m=density_per_m, gate_m=gate_m, settings=self.evidence
            )
            for own, visible in zip(sides, shown & (ahead_m < EVIDENCE_REACH_M), strict=True)
        )
        if foreseen or left.seen != right.seen:
            left, right = left.foreseen(self.evidence), right.foreseen(self.evidence)
        scaled = (residual / near.sigma_m)[accepted]
        rms = math.sqrt(float(scaled @ scaled) / len(scaled)) if len(scaled) else 0.0
        covered = np.zeros(shown.shape, bool)
        within = np.abs(residual) < WITHIN_SIGMAS * near.sigma_m
        for row, own in zip(covered, sides, strict=True):
            row[near.band[own & within]] = True
        within_m = WITHIN_SIGMAS * float(near.sigma_m.mean()) if len(side) else gate_m
        chance = 1 - math.exp(-2 * within_m * density_per_m)
        end_m = support_end_m(covered, shown, ahead_m, chance=chance, share=self.evidence.full_excess)
        return LaneFit(state=state, left=left, right=right, residual=rms, end_m=end_m)

    def line_within(self, points: RoadPoints, mean: Array) -> float:
        """Support of the strongest line inside the lane ``mean``, as ``BoundarySupport.excess``; 0 without one.

        Two dashes of a dashed line or more count, because an arrow or a crack is shorter.
        """
        x_m, y_m = level_points(points, mean[PITCH], self.grid.camera)
        _, distance, _ = lane_coordinates(x_m, y_m, mean)
        inner_m, gate_m = mean[WIDTH] / 2 - WITHIN_M, self.fit.gate_m
        best = 0.0
        for place_m in np.arange(-inner_m, inner_m, gate_m):
            line = mean.copy()
            line[E], line[WIDTH] = mean[E] - place_m, 0.0
            shown, ahead_m = self._bands_in_image(line)
            support = boundary_support(
                points,
                np.abs(distance - place_m) < gate_m,
                shown[0] & (ahead_m < EVIDENCE_REACH_M),
                density_per_m=len(x_m) / self.grid.area_m2,
                gate_m=gate_m,
                settings=self.evidence,
            )
            if support.extent_m > TWO_DASHES_M:
                best = max(best, support.excess)
        return best

    def _bands_in_image(self, mean: Array) -> tuple[NDArray[np.bool_], Array]:
        """Whether the left and the right boundary are inside the image, per band, shape (2, bands); x of the bands.

        Approximates the boundaries by circles plus κ'·x³/6, accurate to a few columns.
        """
        grid, camera = self.grid, self.grid.camera
        e, psi, kappa, rate, width, pitch = mean
        stretch = np.maximum(1 + pitch / camera.height_m * grid.ahead_m, 0.3)
        x_m = camera.x_m + grid.ahead_m / stretch
        place_m = np.array([[0.5], [-0.5]]) * width - e
        y_m = parallel_curve(x_m, psi, kappa, place_m) + rate / 6 * x_m**3
        aside_m = (y_m - camera.y_m) * stretch - math.tan(camera.yaw_rad) * grid.ahead_m
        column = camera.cx_px - aside_m * grid.metre_px
        return (column >= 0) & (column < camera.width_px), x_m


def on_middles(points: RoadPoints, side: Array, residual_m: Array) -> RoadPoints:
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
    return points._replace(y_m=points.y_m - shift_m) if shift_m.any() else points
