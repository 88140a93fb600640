"""The classical lane finder: marking filter or road surface, vote, fit and track (inventory P04)."""

import math
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane_evidence import EvidenceSettings, LaneFit, confidence
from perception.lane_fit import KAPPA, KAPPA_RATE, PSI, WIDTH, E, FitSettings, LaneState
from perception.lane_points import MarkingFilter, MarkingSettings, RoadPoints, marking_channel
from perception.lane_search import boundary_columns, find_lane
from perception.lane_tracker import PriorSettings, TrackSettings, predict, prior_state
from perception.lane_vote import VoteSettings
from perception.lateral_grid import LateralGrid, lateral_grid
from perception.self_calibration import SelfCalibrationSettings
from perception.steering import SteeringSettings, pursuit_curvature, road_wheel_angle
from trepid.camera import Camera
from trepid.config import Settings
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.vehicle import Vehicle

Positive = Annotated[float, Field(gt=0)]
Bgr = NDArray[np.uint8]

NAME = "cv"
MIN_SIZE_PX = 32  # below this there is no road to be seen
ROW_STEP_PX = 10  # boundaries are reported every ten rows of the input image
NOTHING_SEEN = "no lane line or road edge found"


class VoteStages(Settings):
    """Section ``vote``: what is tried with and without a prediction."""

    cold: VoteSettings
    refine: VoteSettings
    tracked: VoteSettings
    prior_weight: Positive


class LaneCvSettings(Settings):
    """``config/perception.yaml``."""

    working_width_px: Annotated[int, Field(ge=64, le=1280)]
    reach_m: Positive
    band_m: Positive
    max_band_px: Annotated[int, Field(ge=1)]
    min_confidence: Annotated[float, Field(ge=0, le=1)]
    good_confidence: Annotated[float, Field(ge=0, le=1)]
    markings: MarkingSettings
    fit: FitSettings
    vote: VoteStages
    prior: PriorSettings
    track: TrackSettings
    evidence: EvidenceSettings
    steering: SteeringSettings
    self_calibration: SelfCalibrationSettings


@dataclass(frozen=True)
class View:
    """Everything that depends only on the camera and on the size of its images."""

    camera: Camera  # of the input image
    grid: LateralGrid  # of the working image
    markings: MarkingFilter


def make_view(settings: LaneCvSettings, camera: Camera) -> View:
    """The view of ``camera``, worked on at most ``working_width_px`` wide."""
    width_px = min(camera.width_px, settings.working_width_px)
    height_px = max(1, round(camera.height_px * width_px / camera.width_px))
    grid = lateral_grid(
        camera.resized(width_px, height_px),
        reach_m=settings.reach_m,
        band_m=settings.band_m,
        max_band_px=settings.max_band_px,
    )
    return View(camera=camera, grid=grid, markings=MarkingFilter(settings.markings, grid))


class LaneCv:
    """Estimator "cv". Its only state is the tracked lane."""

    def __init__(self, settings: LaneCvSettings, camera: Camera, vehicle: Vehicle) -> None:
        self._settings, self._camera, self._vehicle = settings, camera, vehicle
        self._view: View | None = None
        self._track: LaneState | None = None
        self._track_t_s = 0.0  # time that the tracked lane holds at
        self._seen_t_s = 0.0  # when it was last seen
        self._seen_confidence = 0.0
        self._rival_frames = 0  # how often in a row a better lane contradicted the track

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` moves the remembered lane to the capture time of the frame."""
        if frame.image.ndim not in (2, 3) or min(frame.image.shape[:2]) < MIN_SIZE_PX:
            return self._nothing(frame.t_s, "image too small")
        image = as_bgr(frame.image)
        view = self._view_of(image.shape[1], image.shape[0])
        self._predict(frame.t_s, state)
        fit, belief = self._measure(_working_image(image, view.grid.camera), view)
        if fit is not None:
            self._track, self._track_t_s = fit.state, frame.t_s
            self._seen_t_s, self._seen_confidence = frame.t_s, belief
            return self._estimate(frame.t_s, fit.state, belief, fit.boundaries_seen, "", view)
        return self._coast(frame.t_s, view)

    def _view_of(self, width_px: int, height_px: int) -> View:
        if self._view is None or (self._view.camera.width_px, self._view.camera.height_px) != (
            width_px,
            height_px,
        ):
            self._view = make_view(self._settings, self._camera.resized(width_px, height_px))
        return self._view

    def _predict(self, t_s: float, state: VehicleState | None) -> None:
        """Move the remembered lane to ``t_s``; forget it when time jumps or it has not been seen for long."""
        if self._track is None:
            return
        dt_s = t_s - self._track_t_s
        if dt_s < 0 or t_s - self._seen_t_s > self._settings.track.max_coast_s:
            self._track = None
            return
        self._track = predict(
            self._track,
            dt_s,
            speed_mps=_finite(state.speed_mps if state else None),
            yaw_rate_radps=_finite(state.yaw_rate_radps if state else None),
            track=self._settings.track,
            prior=self._settings.prior,
        )
        self._track_t_s = t_s

    def _measure(self, image: Bgr, view: View) -> tuple[LaneFit | None, float]:
        """The best lane of this frame and its confidence; None when there is none to be believed."""
        points = view.markings.points(marking_channel(image, self._settings.markings.yellow_gain))
        tracked, belief = None, 0.0
        if self._track is not None:
            tracked = self._find(points, self._track, (self._settings.vote.tracked,), view)
            belief = self._belief(tracked)
            if belief >= self._settings.good_confidence:
                self._rival_frames = 0
                return tracked, belief
        cold = self._find(
            points, self._cold_prior(), (self._settings.vote.cold, self._settings.vote.refine), view
        )
        cold_belief = self._belief(cold)
        if self._prefer_cold(cold, cold_belief, belief):
            return cold, cold_belief
        return (tracked, belief) if belief >= self._settings.min_confidence else (None, 0.0)

    def _cold_prior(self) -> LaneState:
        prior = self._settings.prior
        return prior_state(prior, width_m=prior.width_m, width_sigma_m=prior.width_sigma_m)

    def _prefer_cold(self, cold: LaneFit, cold_belief: float, tracked_belief: float) -> bool:
        """Whether a lane found without memory replaces the tracked one: at once if it agrees, else in a while."""
        if cold_belief < max(self._settings.min_confidence, tracked_belief):
            self._rival_frames = 0
            return False
        if self._track is None:
            return True
        gap = np.abs(cold.state.mean - self._track.mean)
        track = self._settings.track
        agrees = gap[E] < track.gate_offset_m and gap[PSI] < track.gate_heading_rad
        self._rival_frames += 1
        return bool(agrees or self._rival_frames >= track.confirm_frames)

    def _find(
        self, points: RoadPoints, prior: LaneState, stages: tuple[VoteSettings, ...], view: View
    ) -> LaneFit:
        return find_lane(
            points,
            prior,
            stages,
            view.grid,
            fit=self._settings.fit,
            evidence=self._settings.evidence,
            prior_weight=self._settings.vote.prior_weight,
        )

    def _belief(self, fit: LaneFit) -> float:
        return confidence(
            fit,
            width_m=self._settings.prior.width_m,
            lookahead_m=self._settings.steering.lookahead_m,
            settings=self._settings.evidence,
        )

    def _coast(self, t_s: float, view: View) -> SteeringEstimate:
        """The remembered lane with falling confidence, or nothing."""
        if self._track is None:
            return self._nothing(t_s, NOTHING_SEEN)
        unseen_s = t_s - self._seen_t_s
        belief = self._seen_confidence * math.exp(-unseen_s / self._settings.track.coast_decay_s)
        return self._estimate(t_s, self._track, belief, 0, f"lane not seen for {unseen_s:.2f} s", view)

    def _estimate(
        self, t_s: float, lane: LaneState, belief: float, seen: int, reason: str, view: View
    ) -> SteeringEstimate:
        steering = self._settings.steering
        e, psi, kappa, rate, width = (float(value) for value in lane.mean[[E, PSI, KAPPA, KAPPA_RATE, WIDTH]])
        commanded = pursuit_curvature(
            steering.lookahead_m, offset_m=e, heading_rad=psi, curvature_1pm=kappa, curvature_rate_1pm2=rate
        )
        left, right = boundary_paths(lane, view.camera, reach_m=self._settings.reach_m)
        return SteeringEstimate(
            t_s=t_s,
            estimator=NAME,
            lateral_offset_m=e,
            heading_error_rad=psi,
            curvature_1pm=kappa + rate * steering.lookahead_m,
            curvature_rate_1pm2=rate,
            lookahead_m=steering.lookahead_m,
            road_wheel_angle_rad=road_wheel_angle(commanded, wheelbase_m=self._vehicle.wheelbase_m),
            confidence=belief,
            lanes_detected=seen,
            lane_width_m=width,
            latency_ms=None,
            reason=reason,
            left_boundary_px=left,
            right_boundary_px=right,
        )

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        return SteeringEstimate(
            t_s=t_s,
            estimator=NAME,
            lateral_offset_m=None,
            heading_error_rad=None,
            curvature_1pm=None,
            curvature_rate_1pm2=None,
            lookahead_m=self._settings.steering.lookahead_m,
            road_wheel_angle_rad=None,
            confidence=0.0,
            lanes_detected=0,
            lane_width_m=None,
            latency_ms=None,
            reason=reason,
            left_boundary_px=(),
            right_boundary_px=(),
        )


def as_bgr(image: NDArray[np.uint8]) -> Bgr:
    """The image with three channels; grey and BGRA images are converted."""
    if image.ndim == 2 or image.shape[2] == 1:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    if image.shape[2] == 4:
        return cv2.cvtColor(image, cv2.COLOR_BGRA2BGR).astype(np.uint8, copy=False)
    return image


def boundary_paths(lane: LaneState, camera: Camera, *, reach_m: float) -> tuple[PixelPath, PixelPath]:
    """Both boundaries as pixels of the input image, one every ten rows from the bottom up."""
    last = (camera.height_px - 1) // ROW_STEP_PX * ROW_STEP_PX
    rows = np.arange(last, -1, -ROW_STEP_PX, dtype=float)
    left, right = boundary_columns(lane.mean, camera, rows, reach_m=reach_m)
    return _path(left, rows, camera.width_px), _path(right, rows, camera.width_px)


def _path(columns: NDArray[np.float64], rows: NDArray[np.float64], width_px: int) -> PixelPath:
    near = np.abs(columns - width_px / 2) < width_px  # NaN is not near; far outside says nothing
    return tuple((float(x), float(y)) for x, y in zip(columns[near], rows[near], strict=True))


def _working_image(image: Bgr, working: Camera) -> Bgr:
    if image.shape[1] != working.width_px:
        size = (working.width_px, working.height_px)
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    return image


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
