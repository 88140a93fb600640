"""The classical lane finder: marking filter or road surface, vote, fit and track (inventory P04)."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.camera.self_calibration import SelfCalibrationSettings
from perception.lane.camera_check import CameraCheck, CameraCheckSettings
from perception.lane.confidence import ConfidenceSettings, confidence, grounds
from perception.lane.edges import EdgeSettings, RoadEdgeFinder
from perception.lane.evidence import NO_BELIEF, Belief, EvidenceSettings, LaneFit, belief_of, believed_reach_m
from perception.lane.fit import KAPPA, KAPPA_RATE, PSI, WIDTH, E, FitSettings, LaneState
from perception.lane.grid import LateralGrid, lateral_grid
from perception.lane.memory import (
    PriorSettings,
    TrackSettings,
    at_most_sigma,
    held,
    looks_straight,
    on_straight,
    predict,
    prior_state,
    steady,
    straightened,
    with_own_sigma,
)
from perception.lane.paths import boundary_paths
from perception.lane.points import MarkingFilter, MarkingSettings, RoadPoints
from perception.lane.search import find_lane, find_road, follow_road
from perception.lane.vote import VoteSettings
from trepid.camera import Camera
from trepid.clothoid import Lane
from trepid.config import Settings
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.steering import SteeringSettings, road_wheel_angle
from trepid.types import Floats, Image, Positive
from trepid.vehicle import Vehicle

NAME = "cv"
MIN_SIZE_PX = 32  # below this there is no road to be seen
MIN_BANDS = 8  # rows of road that a look needs
MAX_STEP_S = 0.25  # between two looks at the same lane
LINES, EDGES = "lines", "edges"
SIDES = (0, 1, -1)  # where a road has another lane than ours: nowhere, on our left, on our right
NOTHING_SEEN = "no lane line or road edge found"


class VoteStages(Settings):
    """Section ``vote``: what is tried with and without a prediction."""

    cold: VoteSettings
    refine: VoteSettings
    tracked: VoteSettings
    prior_weight: Positive
    min_support: Positive


class LaneCvSettings(Settings):
    """``config/perception.yaml``."""

    working_width_px: Annotated[int, Field(ge=64, le=1280)]
    reach_m: Positive
    drawn_reach_m: Positive
    band_m: Positive
    max_band_px: Annotated[int, Field(ge=1)]
    min_confidence: Annotated[float, Field(ge=0, le=1)]
    enough_confidence: Annotated[float, Field(ge=0, le=1)]
    good_confidence: Annotated[float, Field(ge=0, le=1)]
    sure_confidence: Annotated[float, Field(ge=0, le=1)]
    markings: MarkingSettings
    fit: FitSettings
    edge_fit: FitSettings
    vote: VoteStages
    prior: PriorSettings
    track: TrackSettings
    evidence: EvidenceSettings
    confidence: ConfidenceSettings
    steering: SteeringSettings
    self_calibration: SelfCalibrationSettings
    camera_check: CameraCheckSettings
    edges: EdgeSettings


@dataclass(frozen=True)
class View:
    """Everything that depends only on the camera and on the size of its images."""

    camera: Camera  # of the input image
    undistort: tuple[cv2.typing.MatLike, cv2.typing.MatLike] | None  # maps for the working image
    grid: LateralGrid  # of the working image
    markings: MarkingFilter
    edges: RoadEdgeFinder


@lru_cache(maxsize=8)
def make_view(settings: LaneCvSettings, camera: Camera) -> View | None:
    """The view of ``camera``, worked on at most ``working_width_px`` wide; None when it sees no road."""
    width_px = min(camera.width_px, settings.working_width_px)
    height_px = max(1, round(camera.height_px * width_px / camera.width_px))
    working = _shrunk(camera, width_px, height_px)
    grid = lateral_grid(
        working, reach_m=settings.reach_m, band_m=settings.band_m, max_band_px=settings.max_band_px
    )
    if len(grid.ahead_m) < MIN_BANDS:
        return None
    return View(
        camera=camera,
        undistort=_undistortion(working),
        grid=grid,
        markings=MarkingFilter(settings.markings, grid),
        edges=RoadEdgeFinder(settings.edges, grid.camera),
    )


def _shrunk(camera: Camera, width_px: int, height_px: int) -> Camera:
    """The camera of the area-averaged image, whose pixel u covers the columns around s·(u + ½) − ½."""
    smaller = camera.resized(width_px, height_px)
    shift_x = (width_px / camera.width_px - 1) / 2
    shift_y = (height_px / camera.height_px - 1) / 2
    return smaller.model_copy(update=dict(cx_px=smaller.cx_px + shift_x, cy_px=smaller.cy_px + shift_y))


def _undistortion(working: Camera) -> tuple[cv2.typing.MatLike, cv2.typing.MatLike] | None:
    if not any(working.distortion):
        return None
    size = (working.width_px, working.height_px)
    intrinsics, distortion = working.intrinsics, np.array(working.distortion)
    return cv2.initUndistortRectifyMap(intrinsics, distortion, np.eye(3), intrinsics, size, cv2.CV_16SC2)


class LaneCv:
    """Estimator "cv". Its only state is the tracked lane."""

    def __init__(self, settings: LaneCvSettings, camera: Camera, vehicle: Vehicle) -> None:
        self._settings, self._camera, self._vehicle = settings, camera, vehicle
        self._view = make_view(settings, camera)
        self._track: LaneState | None = None
        self.camera_check = CameraCheck(settings.camera_check)
        self._looks = 0  # in how many frames it was seen
        self._track_t_s = 0.0  # time that the tracked lane holds at
        self._seen_t_s = 0.0  # when it was last seen
        self._grounds = NO_BELIEF  # what it was last believed for
        self._worth = 0.0  # the confidence when it was last seen
        self._straight = False  # whether the road did not bend where it was last seen
        self.rests_on: tuple[float, ...] | None = (
            None  # the last confidence, as the fit of its weights needs it
        )
        self._source = LINES  # what tells its place and width
        self._by_edges = False  # whether edges of the road were last seen
        self._other_lane = 0  # of SIDES
        self._unmarked_m = 0.0  # driven since lines were seen
        self._weak_frames = 0  # how many in a row gave no good tracked lane
        self._rival_looks = 0  # how often in a row a better lane contradicted the track

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` moves the remembered lane to the capture time of the frame."""
        if frame.image.dtype != np.uint8 or frame.image.ndim not in (2, 3):
            return self._nothing(frame.t_s, f"not an 8-bit image: {frame.image.dtype} {frame.image.shape}")
        if min(frame.image.shape[:2]) < MIN_SIZE_PX:
            return self._nothing(frame.t_s, "image too small")
        image = as_bgr(frame.image)
        view = self._view_of(image.shape[1], image.shape[0])
        if view is None:
            return self._nothing(frame.t_s, "the camera sees no road")
        self._predict(frame.t_s, state)
        fit = self._measure(_working_image(image, view), view)
        if fit is not None and self._memory_is_surer(fit, frame.t_s):
            fit = None
        if fit is not None:
            self._looks = min(self._looks + 1, self._settings.evidence.sure_looks)
            if not fit.by_edges:
                self._unmarked_m = 0.0
            self._source = EDGES if fit.by_edges and not self._lines_tell_place else LINES
            self._track = fit.state
            self._by_edges, self._grounds = fit.by_edges, self._grounds_of(fit)
            self._check_camera(fit, state, frame.t_s)
            self._track_t_s = self._seen_t_s = frame.t_s
            odds = (self._settings.edge_fit if fit.by_edges else self._settings.fit).straight_log_odds
            self._straight = looks_straight(self._track, self._settings.prior, log_odds=odds)
            lane = self._straightened(self._track)
            seen, reason = fit.boundaries_seen, self.camera_check.reason
        elif self._track is None:
            return self._nothing(frame.t_s, NOTHING_SEEN)
        else:
            lane = self._track = steady(self._straightened(self._track))
            seen, reason = 0, f"lane not seen for {frame.t_s - self._seen_t_s:.2f} s"
        estimate = self._estimate(frame.t_s, lane, seen, reason, view)
        if fit is not None:
            self._worth = estimate.confidence
        return estimate

    def _memory_is_surer(self, fit: LaneFit, t_s: float) -> bool:
        """Whether ``fit`` is of edges that are believed less than lines of a moment ago: a pause, not their end."""
        if not fit.by_edges or self._track is None or self._source != LINES or self._by_edges:
            return False
        remembered = self._fade(t_s) * self._believed(self._rests_on(self._grounds, self._track))
        return self._probable(fit) < remembered

    def _probable(self, fit: LaneFit) -> float:
        """The probability that ``fit`` is right."""
        return self._believed(self._rests_on(self._grounds_of(fit), fit.state))

    def _straightened(self, lane: LaneState) -> LaneState:
        """``lane`` without the bend that noise makes of a straight road; unseen, such a road goes straight on."""
        return on_straight(lane, self._settings.prior) if self._straight else lane

    def _check_camera(self, fit: LaneFit, state: VehicleState | None, t_s: float) -> None:
        dt_s = t_s - self._seen_t_s
        if fit.by_edges or fit.boundaries_seen < 2 or not 0 < dt_s < MAX_STEP_S:
            self.camera_check.pause()
            return
        self.camera_check.step(
            fit.state,
            speed_mps=_finite(state.speed_mps if state else None),
            yaw_rate_radps=_finite(state.yaw_rate_radps if state else None),
            dt_s=dt_s,
        )

    @property
    def _lines_tell_place(self) -> bool:
        """Whether lines, seen or of a moment ago, tell the place and the width of the remembered lane.

        Where they end or pause, the edges of the road tell for a while only where it goes: how far its edges lie
        from the lines is not known, and they may widen into a lay-by or the mouth of a side road.
        """
        return (
            self._track is not None
            and self._source == LINES
            and self._unmarked_m <= self._settings.track.hold_m
        )

    def _view_of(self, width_px: int, height_px: int) -> View | None:
        if (self._camera.width_px, self._camera.height_px) != (width_px, height_px):
            self._camera = self._camera.resized(width_px, height_px)
            self._view = make_view(self._settings, self._camera)
        return self._view

    def _predict(self, t_s: float, state: VehicleState | None) -> None:
        """Move the remembered lane to ``t_s``; forget it when time jumps or it has not been seen for long.

        What was hardly believed when it was last seen is forgotten sooner.
        """
        if self._track is None:
            return
        dt_s = t_s - self._track_t_s
        worth = min(1.0, self._worth / self._settings.good_confidence)
        if dt_s < 0 or t_s - self._seen_t_s > max(worth * self._settings.track.max_coast_s, MAX_STEP_S):
            self._track, self._looks, self._other_lane = None, 0, 0
            return
        speed_mps = _finite(state.speed_mps if state else None)
        self._unmarked_m += dt_s * (
            self._settings.track.blind_speed_mps if speed_mps is None else abs(speed_mps)
        )
        self._track = predict(
            self._track,
            dt_s,
            speed_mps=speed_mps,
            yaw_rate_radps=_finite(state.yaw_rate_radps if state else None),
            track=self._settings.track,
            prior=self._settings.prior,
        )
        self._track_t_s = t_s

    def _measure(self, image: Image, view: View) -> LaneFit | None:
        """The best lane of this frame; None when there is none to be believed.

        Painted lines come first, road edges when there are none; a remembered lane comes before a new one, which
        must be better and either agree with it or contradict it for some frames in a row.
        """
        settings = self._settings
        points = view.markings.points(image)
        if self._track is None:
            return self._first_look(points, image, view)
        lines, belief = self._follow_lines(points, view)
        if belief >= settings.good_confidence:
            return self._keep(lines)
        if self._source == LINES and belief >= settings.min_confidence:
            return self._unless_better(lines, belief, points, view)
        edges, edge_belief = self._follow_edges(image, view)
        if edge_belief >= settings.good_confidence:
            return self._keep(edges)
        best, best_belief = self._lines_or_edges(lines, belief, edges, edge_belief)
        return self._unless_better(best, best_belief, points, view)

    def _follow_lines(self, points: RoadPoints, view: View) -> tuple[LaneFit, float]:
        """The lines of the remembered lane: right where they must be now, else the best near there."""
        prior = self._with_width_of(LINES)
        if self._source == LINES:
            lines = self._find_lines(points, prior, (), view)
            belief = self._belief(lines)
            if belief >= self._settings.good_confidence:
                return lines, belief
        lines = self._find_lines(points, prior, (self._settings.vote.tracked,), view)
        return lines, self._belief(lines)

    def _follow_edges(self, image: Image, view: View) -> tuple[LaneFit, float]:
        """The edges of the remembered road, or those beside the lane that lines told of; and their belief.

        That road is the lane alone or, for as long as lines tell the place of the lane, has another one on its left
        or right: what was found last comes first.
        """
        assert self._track is not None
        road, sums = self._with_width_of(EDGES), view.edges.sums(view.edges.look(image))
        if self._source == EDGES:
            edges = self._edges_near(road, sums, view)
            return edges, self._belief(edges) if self._agrees(edges) else 0.0
        held_place = self._lines_tell_place
        for side in sorted(SIDES, key=lambda side: side != self._other_lane) if held_place else (0,):
            edges = self._edges_near(_with_lane_beside(road, self._track, side), sums, view)
            if self._lies_between(edges, side):
                self._other_lane = side
                if held_place:
                    edges = replace(edges, state=held(edges.state, self._track))
                return edges, self._belief(edges)
        return edges, 0.0

    def _lines_or_edges(
        self, lines: LaneFit, belief: float, edges: LaneFit, edge_belief: float
    ) -> tuple[LaneFit, float]:
        """Whichever is believed more; edges that are hardly likely to be a lane's give way to any lines.

        Those of two lanes do to lines that are surely a lane's, however weak: on worn roads they are.
        """
        edges_surely = self._probable(edges)
        if belief >= self._settings.min_confidence > edges_surely:
            return lines, belief
        if not self._lines_tell_place and self._of_two_lanes(edges):
            surely = self._probable(lines)
            if surely >= max(self._settings.sure_confidence, edges_surely):
                return lines, surely
        return (lines, belief) if belief >= edge_belief else (edges, edge_belief)

    def _keep(self, fit: LaneFit) -> LaneFit:
        self._rival_looks = self._weak_frames = 0
        return fit

    def _first_look(self, points: RoadPoints, image: Image, view: View) -> LaneFit | None:
        """The lane without memory: two good lines, else road edges, else whatever is believed most."""
        settings = self._settings
        lines, belief = self._lines_anywhere(points, view)
        if belief >= settings.enough_confidence and lines.boundaries_seen == 2:
            return lines
        edges = self._edges_anywhere(image, view)
        edge_belief = self._belief(edges)
        if edges.boundaries_seen == 1:
            edge_belief *= settings.evidence.lone_edge_trust
        foreseen = self._lane_within(edges) if edge_belief >= settings.min_confidence else None
        if foreseen is not None:
            within = self._find_lines(points, foreseen, (settings.vote.tracked,), view)
            if self._probable(within) > self._probable(lines):
                lines, belief = within, self._belief(within)
        best, best_belief = self._lines_or_edges(lines, belief, edges, edge_belief)
        return best if best_belief >= settings.min_confidence else None

    def _of_two_lanes(self, edges: LaneFit) -> bool:
        """Whether the road between ``edges`` is too wide to be one lane."""
        evidence = self._settings.evidence
        wide_m = evidence.road_width_m + evidence.road_width_sigma_m
        return edges.boundaries_seen == 2 and float(edges.state.mean[WIDTH]) > wide_m

    def _lane_within(self, edges: LaneFit) -> LaneState | None:
        """The half of a road of two lanes that has the vehicle in it, as far as its edges foresee the lines.

        None for any other road, and where the vehicle is in the middle of it: then it is in neither half.
        """
        prior = self._settings.prior
        mean = edges.state.mean.copy()
        road_m = float(mean[WIDTH])
        mean[WIDTH] = road_m / 2 - prior.shoulder_m
        mean[E] -= math.copysign(road_m / 4, mean[E])
        if not self._of_two_lanes(edges) or abs(mean[E]) > prior.offset_sigma_m:
            return None
        covariance = with_own_sigma(edges.state.covariance, WIDTH, prior.width_sigma_m)
        return LaneState(mean=mean, covariance=with_own_sigma(covariance, E, prior.offset_sigma_m))

    def _lines_anywhere(self, points: RoadPoints, view: View) -> tuple[LaneFit, float]:
        """The best lane between lines, whatever is remembered."""
        settings, prior = self._settings, self._prior_of(LINES)
        stages, straight = (settings.vote.cold, settings.vote.refine), straightened(prior, settings.prior)
        lines = self._find_lines(points, prior, stages, view, straight=straight)
        return lines, self._belief(lines)

    def _unless_better(self, fit: LaneFit, belief: float, points: RoadPoints, view: View) -> LaneFit | None:
        """The weak tracked ``fit``, or lines elsewhere if they are clearly better and either agree with what is
        remembered or contradict it for some looks. Edges elsewhere never are: a lane is a part of the road.

        To look everywhere is dear, so it is done at the first weak frame and then at every few.
        """
        track = self._settings.track
        if self._weak_frames % track.rival_every == 0:
            rival, rival_belief = self._lines_anywhere(points, view)
            if rival_belief > belief + track.rival_margin:
                self._rival_looks += 1
                if self._agrees(rival) or self._rival_looks >= track.confirm_looks:
                    self._looks = 0
                    return self._keep(rival)
            else:
                self._rival_looks = 0
        self._weak_frames += 1
        return fit if belief >= self._settings.min_confidence else None

    def _agrees(self, fit: LaneFit) -> bool:
        """Whether ``fit`` continues the remembered lane."""
        if self._track is None:
            return True
        change, track = fit.state.mean - self._track.mean, self._settings.track
        return bool(abs(change[E]) < track.gate_offset_m and abs(change[PSI]) < track.gate_heading_rad)

    def _lies_between(self, edges: LaneFit, other_lane: int) -> bool:
        """Whether both ``edges`` run beside the remembered lane, and beyond the lane on the side ``other_lane``.

        How wide that is, is only guessed. At the mouth of a side road edges turn away.
        """
        assert self._track is not None
        change, track = edges.state.mean - self._track.mean, self._settings.track
        if edges.boundaries_seen < 2 or abs(change[PSI]) >= track.edge_gate_heading_rad:
            return False
        beyond_m = {side: float(change[WIDTH] / 2 - side * change[E]) for side in (1, -1)}
        if other_lane and abs(beyond_m.pop(other_lane) - self._track.mean[WIDTH]) >= track.edge_gate_width_m:
            return False
        return all(-track.edge_gate_offset_m < far_m < track.edge_gate_width_m for far_m in beyond_m.values())

    def _prior_of(self, source: str) -> LaneState:
        prior = self._settings.prior
        if source == LINES:
            return prior_state(prior, width_m=prior.width_m, width_sigma_m=prior.width_sigma_m)
        return prior_state(prior, width_m=prior.road_width_m, width_sigma_m=prior.road_width_sigma_m)

    def _with_width_of(self, source: str) -> LaneState:
        """The remembered lane; the road between edges is wider than the lane between lines by the shoulders."""
        assert self._track is not None
        if source == self._source:
            return self._track
        prior = self._settings.prior
        sigma_m = prior.width_sigma_m if source == LINES else prior.shoulder_sigma_m
        covariance = with_own_sigma(self._track.covariance, WIDTH, sigma_m)
        mean = self._track.mean.copy()
        if source == LINES:
            # Which part of the road between the edges is the lane: that with the vehicle in it.
            spare_m = max(0.0, mean[WIDTH] - prior.width_m)
            covariance[E, E] += (spare_m / 2) ** 2
            covariance = at_most_sigma(covariance, E, prior.offset_sigma_m)
            limit_m = min(spare_m, prior.width_m) / 2
            mean[E] = math.copysign(max(0.0, abs(mean[E]) - limit_m), mean[E])
            mean[WIDTH] = min(mean[WIDTH], prior.width_m)
        else:
            mean[WIDTH] += 2 * prior.shoulder_m
            covariance[E, E] += (prior.shoulder_sigma_m / 2) ** 2
        return LaneState(mean=mean, covariance=covariance)

    def _find_lines(
        self,
        points: RoadPoints,
        prior: LaneState,
        stages: tuple[VoteSettings, ...],
        view: View,
        *,
        straight: LaneState | None = None,
    ) -> LaneFit:
        return find_lane(
            points,
            prior,
            stages,
            view.grid,
            fit=self._settings.fit,
            evidence=self._settings.evidence,
            prior_weight=self._settings.vote.prior_weight,
            min_support=self._settings.vote.min_support,
            straight=straight,
        )

    def _edges_near(self, prior: LaneState, sums: Floats, view: View) -> LaneFit:
        """The edges where ``prior`` foresees them."""
        settings = self._settings
        return follow_road(view.edges, sums, prior, fit=settings.edge_fit, evidence=settings.evidence)

    def _edges_anywhere(self, image: Image, view: View) -> LaneFit:
        """The best pair of edges, whatever is remembered."""
        settings, prior = self._settings, self._prior_of(EDGES)
        return find_road(
            view.edges,
            image,
            prior,
            straight=straightened(prior, settings.prior),
            fit=settings.edge_fit,
            evidence=settings.evidence,
        )

    def _belief(self, fit: LaneFit) -> float:
        """A score 0..1 to choose between lanes."""
        return self._grounds_of(fit).product

    def _grounds_of(self, fit: LaneFit) -> Belief:
        prior, evidence = self._settings.prior, self._settings.evidence
        return belief_of(
            fit,
            width_m=evidence.road_width_m if fit.by_edges else prior.width_m,
            width_sigma_m=evidence.road_width_sigma_m if fit.by_edges else prior.width_sigma_m,
            lookahead_m=self._settings.steering.lookahead_m,
            settings=evidence,
        )

    def _rests_on(self, belief: Belief, lane: LaneState) -> tuple[float, ...]:
        """What the confidence in ``lane`` rests on."""
        bend = Lane(*(float(value) for value in lane.mean[[E, PSI, KAPPA, KAPPA_RATE]]))
        return grounds(
            belief,
            looks=self._looks / self._settings.evidence.sure_looks,
            heading_rad=bend.heading_rad,
            curvature_1pm=bend.curvature_at(self._settings.steering.lookahead_m),
        )

    def _believed(self, rests_on: tuple[float, ...]) -> float:
        """The probability that a lane is right when it is seen."""
        return confidence(rests_on, self._settings.confidence)

    def _fade(self, t_s: float) -> float:
        """What is left of it unseen: memory is no sight, so it fades at once."""
        return math.exp(-(t_s - self._seen_t_s) / self._settings.track.coast_decay_s)

    def _estimate(self, t_s: float, lane: LaneState, seen: int, reason: str, view: View) -> SteeringEstimate:
        steering = self._settings.steering
        e, psi, kappa, rate, width = (float(value) for value in lane.mean[[E, PSI, KAPPA, KAPPA_RATE, WIDTH]])
        clothoid = Lane(e, psi, kappa, rate)
        commanded = clothoid.pursuit_curvature(steering.lookahead_m)
        reach_m = believed_reach_m(lane, self._settings.drawn_reach_m, self._settings.evidence.drawn_sigma_m)
        left, right = boundary_paths(lane, view.camera, reach_m=reach_m)
        self.rests_on = self._rests_on(self._grounds, lane)
        return SteeringEstimate(
            t_s=t_s,
            estimator=NAME,
            lateral_offset_m=e,
            heading_error_rad=psi,
            curvature_1pm=clothoid.curvature_at(steering.lookahead_m),
            curvature_rate_1pm2=rate,
            lookahead_m=steering.lookahead_m,
            road_wheel_angle_rad=road_wheel_angle(commanded, wheelbase_m=self._vehicle.wheelbase_m),
            confidence=self._fade(t_s) * self._believed(self.rests_on),
            lanes_detected=seen,
            lane_width_m=width,
            latency_ms=None,
            reason=reason,
            left_boundary_px=left,
            right_boundary_px=right,
            marked=not self._by_edges,
        )

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        self.rests_on = None
        return SteeringEstimate.nothing(
            t_s, estimator=NAME, lookahead_m=self._settings.steering.lookahead_m, reason=reason
        )


def _with_lane_beside(road: LaneState, lane: LaneState, side: int) -> LaneState:
    """The road ``road`` of one lane with another as wide as ``lane`` on its ``side``."""
    mean, width_m = road.mean.copy(), float(lane.mean[WIDTH])
    mean[E] -= side * width_m / 2
    mean[WIDTH] += abs(side) * width_m
    return LaneState(mean=mean, covariance=road.covariance)


def as_bgr(image: NDArray[np.uint8]) -> Image:
    """The image with three channels; grey and BGRA images are converted."""
    if image.ndim == 2 or image.shape[2] == 1:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    if image.shape[2] == 4:
        return cv2.cvtColor(image, cv2.COLOR_BGRA2BGR).astype(np.uint8, copy=False)
    return image


def _working_image(image: Image, view: View) -> Image:
    """The image at working size, without lens distortion."""
    working = view.grid.camera
    if image.shape[1] != working.width_px:
        size = (working.width_px, working.height_px)
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    if view.undistort is not None:
        image = cv2.remap(image, *view.undistort, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
    return image


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
