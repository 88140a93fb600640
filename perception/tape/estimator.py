"""The estimator `tape`: the lane between lines of tape, by length and with a memory of what is beside the image.

For each frame: the lines on the floor in all directions (:mod:`.floor`); those seen before, moved with the vehicle,
where the image does not show the floor (:mod:`.memory`); the lane by length through both (:mod:`.curve`), from the
prediction, or from the best arcs where there is none or it is unsure. In a bend as tight as the lane is wide, the
image shows the outer line alone, from some lane widths ahead on; the inner one is in the memory.

Confidence = length × share of line on the visible boundaries × no lines inside the lane × small deviation at the
look-ahead × frames in a row. It falls with the way without lines; where the motion is unknown, it ends with them.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.model.geometry import distances
from perception.lane.model.prediction import VehicleMotion
from perception.lane.view import as_bgr, unusable
from perception.tape.curve import STEP_M, CurveFit, LaneCurve, arc_lane
from perception.tape.floor import FloorRaster, VotingPoints
from perception.tape.memory import THIN_M, LineMemory
from perception.tape.settings import TapeSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.scale import REFERENCE_LANE_M
from trepid.types import Array

NAME = "tape"
MAX_GAP_S = 1.0  # between frames, over which lines and lane are remembered
ON_M = 0.35  # of a line beside its boundary
LEAST = 8  # points of a lane
SEARCHED = 1.6  # of near_m, up to which lines count in the search
LEAST_MORE_M = 0.5  # of line, for which a bend ahead is replaced
BEHIND_M = 1.0  # lines behind the axle up to here count as near
NEAREST_M = 0.3  # before the lens, of a pixel of a boundary
BESIDE = 1.0  # image widths to either side of the image, within which a boundary is drawn


@dataclass(frozen=True)
class Evidence:
    """What speaks for a lane: lengths [m] near the car."""

    seen_m: tuple[float, float]  # of line on the left and the right boundary in the image
    visible_m: float  # of both boundaries in the image
    remembered_m: float  # of line on both boundaries beside the image
    inside_m: float  # of line between the boundaries

    @property
    def votes(self) -> float:
        """Of line for the lane, less that against it."""
        return sum(self.seen_m) + self.remembered_m - self.inside_m


class TapeLane:
    """Estimator "tape". Its state is the last lane and the lines around it."""

    def __init__(self, settings: TapeSettings, line_m: float, camera: Camera, vehicle: Vehicle) -> None:
        """``line_m``: usual width of the lines."""
        self._settings, self._vehicle = settings, vehicle
        lines_m = tuple(sorted(line_m * width for width in settings.lane.widths))
        self._raster = FloorRaster(camera, settings.floor, lines_m)
        self._memory = LineMemory(settings.memory)
        self._fit = CurveFit(settings.curve, REFERENCE_LANE_M, aside=settings.lane.aside)
        self._arcs = _arcs(settings)
        self._lane: LaneCurve | None = None
        self._t_s = -math.inf
        self._looks, self._unseen_m, self._sure = 0, 0.0, 0.0
        self._moved = False  # the lane is predicted by the motion of the car

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` gives the motion since the last frame."""
        if problem := unusable(frame.image):
            return self._nothing(frame.t_s, problem)
        height_px, width_px = frame.image.shape[:2]
        if (self._raster.camera.width_px, self._raster.camera.height_px) != (width_px, height_px):
            camera = self._raster.camera.resize(width_px, height_px)
            self._raster = FloorRaster(camera, self._settings.floor, self._raster.lines_m)
        if not self._raster.inside_image.any():
            return self._nothing(frame.t_s, "the image shows no floor")
        self._move(frame.t_s, VehicleMotion.of(state))
        points = self._memory.update(self._raster.points(as_bgr(frame.image)), self._raster)
        voting = VotingPoints.of(points, self._settings.lane)
        evidence = self._choose(voting)
        if evidence is None:
            return self._nothing(frame.t_s, "no lines of a lane found")
        return self._estimate(frame.t_s, evidence)

    def _move(self, t_s: float, motion: VehicleMotion) -> None:
        """Lane and lines at ``t_s``; nothing is remembered after a jump in time.

        Without speed and yaw rate the last lane is where the fit begins, and lines beside the image are unknown.
        """
        dt_s, self._t_s = t_s - self._t_s, t_s
        self._moved = False
        if not 0 <= dt_s <= MAX_GAP_S:
            self._memory.forget()
            self._lane, self._looks, self._unseen_m, self._sure = None, 0, 0.0, 0.0
            return
        if motion.speed_mps is None or motion.yaw_rate_radps is None:
            self._memory.forget()
            return
        self._moved = True
        way_m, turned_rad = motion.speed_mps * dt_s, motion.yaw_rate_radps * dt_s
        self._memory.move(way_m, turned_rad)
        if self._lane is not None:
            self._lane = self._lane.after(way_m, turned_rad)
            self._unseen_m += abs(way_m)
            if self._unseen_m > self._settings.sure.forget_m:
                self._lane, self._looks, self._sure = None, 0, 0.0

    def _choose(self, voting: VotingPoints) -> Evidence | None:
        """Keep the tracked lane, or the best of the search where that is unsure and this has more line.

        Returns what speaks for the lane; None without one.
        """
        least = self._settings.sure.least
        kept = None if self._lane is None else self._fit.fit(self._lane, voting, tracked=self._moved)
        if kept is not None and self._moved and self._sure >= least:
            self._lane, evidence = self._with_other_bend(kept, voting)
            return evidence
        best = None if kept is None else self._evidence(kept, voting)
        most = -math.inf if best is None else best.votes
        for start in self._search(voting):
            found = self._fit.fit(start, voting, tracked=False)
            evidence = self._evidence(found, voting)
            votes = evidence.votes - _strangeness(found)
            if votes > max(most, 0.0) + (1.0 if kept is not None else 0.0):
                kept, best, most, self._looks = found, evidence, votes, 0
        self._lane = kept
        return best

    def _with_other_bend(self, kept: LaneCurve, voting: VotingPoints) -> tuple[LaneCurve, Evidence]:
        """``kept``; or, where it passes lines by, the lane with another bend ahead that has more line on it.

        The robust weights of the fit hold it at a lane whose far part has no line near it.
        """
        sure, here = self._settings.sure, self._evidence(kept, voting)
        if self._lane is None or sum(here.seen_m) >= sure.plain * here.visible_m:
            return kept, here
        start = max(self._fit.bends(self._lane, sure.near_m), key=lambda lane: self._support(lane, voting))
        other = self._fit.fit(start, voting, tracked=True, predicted=self._lane)
        there = self._evidence(other, voting)
        return (other, there) if there.votes > here.votes + LEAST_MORE_M else (kept, here)

    def _support(self, lane: LaneCurve, voting: VotingPoints) -> float:
        """Sum of the weights of the points near the boundaries of ``lane`` and near the car."""
        placed = lane.place(voting.points, lane.draw(), self._settings.curve.slant_rad)
        near = placed.beside & (lane.table.fine_m[placed.station] < SEARCHED * self._settings.sure.near_m)
        return float(np.sum(near * self._weight(voting, placed.left_m, lane.width_m)))

    def _weight(self, voting: VotingPoints, left_m: Array, width_m: float) -> Array:
        """Weight of points ``left_m`` left of a lane's middle: their own, less the farther from its boundaries."""
        off_m = np.abs(left_m) - self._settings.lane.aside * width_m
        return np.asarray(voting.weight(left_m) / (1 + (off_m / ON_M) ** 2) ** 2, float)

    def _search(self, voting: VotingPoints) -> list[LaneCurve]:
        """The arcs with most line on their boundaries, clearly different ones."""
        points, arcs = voting.points, self._arcs
        if len(points.x_m) < LEAST:
            return []
        left_m = distances(points.x_m, points.y_m, arcs)
        ahead = np.hypot(points.x_m, points.y_m) < SEARCHED * self._settings.sure.near_m
        votes = self._weight(voting, left_m, REFERENCE_LANE_M) @ ahead * THIN_M
        votes -= 0.5 * ((arcs[:, 0] / 0.8) ** 2 + (arcs[:, 1] / 0.4) ** 2 + (arcs[:, 2] / 0.2) ** 2)
        found: list[Array] = []
        for number in np.argsort(-votes):
            arc = arcs[number]
            if all(abs(arc[0] - other[0]) > 0.7 or abs(arc[1] - other[1]) > 0.25 for other in found):
                found.append(arc)
            if len(found) == self._settings.search.tried:
                break
        return [
            arc_lane(
                self._settings.curve,
                offset_m=float(e),
                heading_rad=float(psi),
                bend_1pm=float(kappa),
                width_m=REFERENCE_LANE_M,
            )
            for e, psi, kappa, *_ in found
        ]

    def _evidence(self, lane: LaneCurve, voting: VotingPoints) -> Evidence:
        """The lengths of line on and between the boundaries of ``lane`` near the car."""
        settings, drawn, table = self._settings, lane.draw(), lane.table
        placed = lane.place(voting.points, drawn, settings.curve.slant_rad)
        aside_m = settings.lane.aside * lane.width_m
        s_m = table.fine_m[placed.station]
        near = placed.beside & (s_m > -BEHIND_M) & (s_m < settings.sure.near_m)
        on = near & (np.abs(np.abs(placed.left_m) - aside_m) < ON_M) & (voting.weight(placed.left_m) > 0)
        now = voting.points.way_m == 0
        lengths = [
            STEP_M * len(np.unique(placed.station[on & part & (sign * placed.left_m > 0)]))
            for part in (now, ~now)
            for sign in (1.0, -1.0)
        ]
        inside = near & now & (np.abs(placed.left_m) < aside_m - 2 * ON_M)
        visible_m = 0.0
        part = (table.fine_m > -BEHIND_M) & (table.fine_m < settings.sure.near_m)
        for sign in (1.0, -1.0):
            side = drawn.centre[part] + sign * 1j * aside_m * drawn.along[part]
            line_m = self._usual_width_m(voting.points.line_m[on & (sign * placed.left_m > 0)])
            shown = self._raster.sees(side.real, side.imag, np.full(len(side), line_m))
            visible_m += STEP_M * np.count_nonzero(shown)
        return Evidence(
            seen_m=(lengths[0], lengths[1]),
            visible_m=visible_m,
            remembered_m=lengths[2] + lengths[3],
            inside_m=STEP_M * len(np.unique(placed.station[inside])),
        )

    def _usual_width_m(self, widths_m: Array) -> float:
        """The most frequent of ``widths_m`` of the points of a boundary; the narrowest width without a point."""
        return max(self._raster.lines_m, key=lambda line_m: np.count_nonzero(widths_m == line_m))

    def _estimate(self, t_s: float, evidence: Evidence) -> SteeringEstimate:
        lane, sure = self._lane, self._settings.sure
        assert lane is not None
        gradient = lane.gradient(lane.draw())
        seen_m = sum(evidence.seen_m)
        if seen_m >= 2 * STEP_M:
            self._looks, self._unseen_m = min(self._looks + 1, sure.looks), 0.0
        elif not self._moved:
            self._looks = 0
        sides = sum(length >= 2 * STEP_M for length in evidence.seen_m)
        sides = sides if self._settings.lane.aside else min(sides, 1)
        enough_m = min(max(evidence.visible_m, sure.least_line_m), sure.line_m)
        line = min(1.0, (seen_m + evidence.remembered_m) / enough_m)
        share = min(1.0, seen_m / max(sure.share * evidence.visible_m, STEP_M)) if evidence.visible_m else 1.0
        clear = (seen_m + evidence.remembered_m) / max(
            seen_m + evidence.remembered_m + evidence.inside_m, STEP_M
        )
        aim = math.exp(-0.5 * (lane.sigma_m(self._settings.lookahead_m, gradient) / sure.aim_sigma_m) ** 2)
        fade = math.exp(-self._unseen_m / sure.coast_m) * self._looks / sure.looks
        self._sure = line * share * clear * aim * fade
        clothoid = lane.clothoid(self._settings.lookahead_m)
        reach_m = clothoid.lookahead_m
        left, right = _boundary_pixels(lane, self._raster.camera)
        return SteeringEstimate(
            t_s=t_s,
            estimator=NAME,
            lateral_offset_m=clothoid.offset_m,
            heading_error_rad=clothoid.heading_rad,
            curvature_1pm=clothoid.curvature_at(reach_m),
            curvature_rate_1pm2=clothoid.curvature_rate_1pm2,
            lookahead_m=reach_m,
            road_wheel_angle_rad=road_wheel_angle(
                clothoid.pursuit_curvature(reach_m), wheelbase_m=self._vehicle.wheelbase_m
            ),
            confidence=self._sure,
            lanes_detected=sides,
            lane_width_m=lane.width_m,
            reason="" if seen_m else f"no line seen for {self._unseen_m:.1f} m",
            left_boundary_px=left,
            right_boundary_px=right,
            marked=True,
            ahead_sigma_m=lane.ahead_sigma_m(gradient),
        )

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            t_s, estimator=NAME, lookahead_m=self._settings.lookahead_m, reason=reason
        )


def _arcs(settings: TapeSettings) -> Array:
    """The arcs of the search, shape (n, 5): e, ψ, κ, κ' = 0, W."""
    search = settings.search
    axes = [
        np.linspace(-limit, limit, count)
        for limit, count in (
            (search.offset_m, search.offsets),
            (search.heading_rad, search.headings),
            (search.bend_1pm, search.bends),
        )
    ]
    grid: NDArray[np.float64] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    rest = np.column_stack([np.zeros(len(grid)), np.full(len(grid), REFERENCE_LANE_M)])
    return np.column_stack([grid, rest])


def _strangeness(lane: LaneCurve) -> float:
    """Metres of line that a lane far from the car, or askew to it, needs more than another."""
    e, psi = float(lane.p[0]), float(lane.p[1])
    return 0.5 * ((e / 0.8) ** 2 + (psi / 0.4) ** 2)


def _boundary_pixels(lane: LaneCurve, camera: Camera) -> tuple[PixelPath, PixelPath]:
    """The left and the right boundary, from near to far along the lane, with lens distortion."""
    drawn = lane.draw()
    left, right = (drawn.centre + sign * 1j * lane.width_m / 2 * drawn.along for sign in (1.0, -1.0))
    return _pixels(left.real, left.imag, camera), _pixels(right.real, right.imag, camera)


def _pixels(x_m: Array, y_m: Array, camera: Camera) -> PixelPath:
    at = np.column_stack([x_m - camera.x_m, y_m - camera.y_m, np.full(len(x_m), -camera.height_m)])
    rays = at @ camera.optical_from_vehicle.T
    rays = rays[rays[:, 2] > np.maximum(NEAREST_M, np.abs(rays[:, 0]) / 3)]
    if len(rays) < 2:
        return ()
    zero = np.zeros(3)
    pixels = cv2.projectPoints(rays, zero, zero, camera.intrinsics, camera.lens)[0].reshape(-1, 2)
    near = (pixels[:, 0] > -BESIDE * camera.width_px) & (pixels[:, 0] < (1 + BESIDE) * camera.width_px)
    near &= (pixels[:, 1] > 0) & (pixels[:, 1] < 1.2 * camera.height_px)
    return tuple((float(u), float(v)) for u, v in pixels[near])
