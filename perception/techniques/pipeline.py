"""A pipeline of the review's techniques as an estimator (inventory P04, B01).

The confidence of its estimate follows from the evidence of its boundaries.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.model.prediction import VehicleMotion
from perception.lane.settings import steering_settings
from perception.lane.view import as_bgr, unusable
from perception.techniques.image.picture import (
    Boundaries,
    Boundary,
    Evidence,
    FeatureKind,
    Features,
    FrameMotion,
    GroundView,
    MeasuredLane,
    Region,
    camera_view,
    move_boundaries,
    sight_share,
)
from perception.techniques.recipe import PipelineRecipe, Stage
from perception.techniques.steering.lane import pursuit
from perception.techniques.steering.rule import RuleAngle
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.types import Array, Image, Mask

RESIDUAL_M = 0.15  # scatter of the evidence that halves the score: the width of a line
INSIDE_M = 8.0  # of a camera at its usual height
ASIDE_M = 0.5  # σ of the distance by which the path leads out of the lane
ONE_SIDE = 0.6  # score of a lane with one boundary
ON_M, WIDE_M, CLEAR_TO_M = 0.3, 3.0, 20.0  # half width of a boundary; of the search area; its reach
MURKY, CLEAR = 0.45, 0.85  # shares of the features on the boundaries; white noise reaches 0.2 to 0.3


def lane_score(
    boundaries: Boundaries, measured: MeasuredLane, recipe: PipelineRecipe, inside_m: float
) -> float:
    """0..1: support × small residual × plausible width × a lane with the vehicle inside, up to ``inside_m``."""
    sides = [side for side, _ in boundaries.signed_sides]
    support = math.prod(side.support for side in sides) ** (1 / len(sides))
    residual = max(side.residual_m for side in sides)
    fits = 1 / (1 + (residual / RESIDUAL_M) ** 2)
    if measured.width_m is None:
        plausible = ONE_SIDE
    else:
        plausible = math.exp(-0.5 * ((measured.width_m - recipe.width_m) / recipe.width_sigma_m) ** 2)
    farther_m = max(abs(measured.lane.offset_m), abs(measured.lane.y_m(inside_m)))
    inside = math.exp(-0.5 * (max(0.0, farther_m - recipe.width_m / 2) / ASIDE_M) ** 2)
    return min(1.0, support) * fits * plausible * inside


def clarity(evidence: Evidence, boundaries: Boundaries) -> float:
    """0..1: how empty the lane is of the features of its boundaries; noise and texture fill it, paint does not.

    With the shares of line features up to ``CLEAR_TO_M`` ahead that lie on the boundaries, a, and between them or
    on the lane side of a single one, b: a/(a + b), scaled from ``MURKY`` (0) to ``CLEAR`` (1). 1 for regions.
    """
    if evidence.features.kind is not FeatureKind.LINE or not boundaries.side_count:
        return 1.0
    rows, columns = np.nonzero(evidence.features.response)
    x_m, y_m = evidence.view.ground(np.column_stack([columns, rows])).T
    ahead = (x_m > 0) & (x_m < CLEAR_TO_M)
    to_right, to_left = np.full(len(x_m), WIDE_M / 2), np.full(len(x_m), WIDE_M / 2)
    if boundaries.left is not None:
        to_left = boundaries.left.at(x_m) - y_m
    if boundaries.right is not None:
        to_right = y_m - boundaries.right.at(x_m)
    with np.errstate(invalid="ignore"):  # NaN beyond the ends of a boundary: neither
        on = ahead & ((np.abs(to_left) < ON_M) | (np.abs(to_right) < ON_M))
        between = ahead & (to_left >= ON_M) & (to_right >= ON_M) & (np.abs(y_m) < WIDE_M)
    total = np.count_nonzero(on) + np.count_nonzero(between)
    share = np.count_nonzero(on) / total if total else 1.0
    return float(np.clip((share - MURKY) / (CLEAR - MURKY), 0, 1))


WORKING_WIDTH_PX = 320  # as the default estimator, so that times compare
ROW_STEP_PX = 10  # between the points of a boundary in the input image
MAX_GAP_S = 1.0  # longest time between frames over which boundaries are predicted


class Pipeline:
    """The estimator that a recipe describes. Its state is the last boundaries and the memory of its stages."""

    def __init__(self, recipe: PipelineRecipe, camera: Camera, vehicle: Vehicle) -> None:
        self._recipe, self._camera, self._vehicle = recipe, camera, vehicle
        self._view = _working_view(camera)
        inside_m = recipe.inside_m
        self._inside_m = INSIDE_M * sight_share(camera) if inside_m is None else inside_m
        self._before = [(stage.kind, stage.bind()) for stage in recipe.of("prepare", "warp", "region")]
        self._features = _bind_stages(recipe.of("features"))
        self._outliers = _bind_stages(recipe.of("outliers"))
        (self._model,) = _bind_stages(recipe.of("model"))
        (self._state,) = _bind_stages(recipe.of("state"))
        (self._steer,) = _bind_stages(recipe.of("steer")) or [pursuit]
        self._track: list[Callable[..., Boundaries]] = []  # stages with memory: new ones after a jump in time
        self._rule: Callable[..., RuleAngle | None] | None = None
        self._lookahead_m = steering_settings().lookahead_m
        self._rng = np.random.default_rng(0)  # one seed: the same frames give the same estimate
        self._last: Boundaries | None = None
        self._last_t_s = math.nan
        self._score = 0.0  # of the last frame with a lane

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` gives the motion of the vehicle since the last one."""
        problem = unusable(frame.image)
        if problem:
            return self._nothing(frame.t_s, problem)
        picture, view = self._working(frame.image)
        if not (view.ahead_m > 0).any():
            return self._nothing(frame.t_s, "no pixel of the image shows the road")
        motion = self._motion(frame.t_s, state)
        predicted = move_boundaries(self._last, motion) if self._last is not None else None
        evidence = self._evidence(picture, view, predicted, motion.speed_mps)
        boundaries: Boundaries = self._model(evidence)
        clear = clarity(evidence, boundaries)
        for track in self._track:
            boundaries = track(boundaries, motion)
        self._last, self._last_t_s = (boundaries if boundaries.side_count else None), frame.t_s
        measured: MeasuredLane | None = self._state(boundaries, view)
        if measured is not None:
            self._score = (
                self._recipe.trust * clear * lane_score(boundaries, measured, self._recipe, self._inside_m)
            )
        if self._rule is not None:
            return self._angle_estimate(frame.t_s, boundaries, self._rule(boundaries, view, motion.dt_s))
        return self._lane_estimate(frame.t_s, boundaries, measured)

    def _working(self, image: NDArray[np.uint8]) -> tuple[Image, GroundView]:
        """The BGR image at working size, without lens distortion, and its view."""
        height_px, width_px = image.shape[:2]
        if (self._camera.width_px, self._camera.height_px) != (width_px, height_px):
            self._camera = self._camera.resize(width_px, height_px)
            self._view = _working_view(self._camera)
        picture, camera = as_bgr(image), self._camera
        if any(camera.distortion):
            picture = np.asarray(cv2.undistort(picture, camera.intrinsics, camera.lens), np.uint8)
        size = (self._view.width_px, self._view.height_px)
        if size != (width_px, height_px):
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        return picture, self._view

    def _motion(self, t_s: float, state: VehicleState | None) -> FrameMotion:
        """The motion since the last frame. A jump in time clears all memory."""
        dt_s = t_s - self._last_t_s
        if not 0 <= dt_s <= MAX_GAP_S:  # NaN: the first frame
            self._last, self._score, dt_s = None, 0.0, 0.0
            self._track = _bind_stages(self._recipe.of("track"))
            self._rule = next(iter(_bind_stages(self._recipe.of("rule"))), None)
        return FrameMotion(dt_s, *VehicleMotion.of(state))

    def _evidence(
        self, picture: Image, view: GroundView, predicted: Boundaries | None, speed_mps: float | None
    ) -> Evidence:
        """The features of the prepared picture without outliers."""
        mask: Mask | None = None
        for kind, call in self._before:
            if kind == "prepare":
                picture = call(picture, view)
            elif kind == "warp":
                picture, view = call(picture, view)
                mask = view.seen
            else:
                picture, view, mask = _within(call(view, predicted, speed_mps), picture, view, mask)
        features = _all_of([call(picture, view) for call in self._features])
        if mask is not None:
            features = features.where(mask)
        evidence = Evidence(features, view, predicted, self._rng)
        for call in self._outliers:
            evidence = replace(evidence, features=call(evidence))
        return evidence

    def _lane_estimate(
        self, t_s: float, boundaries: Boundaries, measured: MeasuredLane | None
    ) -> SteeringEstimate:
        if measured is None:
            return self._nothing(t_s, boundaries.reason or "the boundaries make no lane")
        lane = measured.lane
        return replace(
            self._of(t_s, boundaries),
            lateral_offset_m=lane.offset_m,
            heading_error_rad=lane.heading_rad,
            curvature_1pm=lane.curvature_at(self._lookahead_m),
            curvature_rate_1pm2=lane.curvature_rate_1pm2,
            road_wheel_angle_rad=self._steer(lane, self._vehicle.wheelbase_m, self._lookahead_m),
            confidence=self._score,
            lane_width_m=measured.width_m,
        )

    def _angle_estimate(
        self, t_s: float, boundaries: Boundaries, angle: RuleAngle | None
    ) -> SteeringEstimate:
        """The angle of the steering rule, rated by the lane state, which the rule does not measure.

        While the rule bridges a lost line, the score of the last lane falls with the certainty of the angle.
        """
        if angle is None:
            return self._nothing(t_s, boundaries.reason or "the steering rule gives no angle")
        return replace(
            self._of(t_s, boundaries),
            road_wheel_angle_rad=angle.angle_rad,
            confidence=self._score * angle.certainty,
            reason="; ".join(filter(None, (boundaries.reason, angle.note))),
        )

    def _of(self, t_s: float, boundaries: Boundaries) -> SteeringEstimate:
        """The estimate with the boundaries alone."""
        return replace(
            self._nothing(t_s, boundaries.reason),
            lanes_detected=boundaries.side_count,
            left_boundary_px=boundary_path(boundaries.left, self._camera),
            right_boundary_px=boundary_path(boundaries.right, self._camera),
        )

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        name, kind = self._recipe.name, self._recipe.kind
        return SteeringEstimate.nothing(
            t_s, estimator=name, lookahead_m=self._lookahead_m, reason=reason, kind=kind
        )


def _working_view(camera: Camera) -> GroundView:
    """The view of the image of ``camera`` at working size; one for all frames keeps its geometry."""
    view = camera_view(camera)
    if camera.width_px <= WORKING_WIDTH_PX:
        return view
    height_px = max(1, round(camera.height_px * WORKING_WIDTH_PX / camera.width_px))
    return view.resize(WORKING_WIDTH_PX, height_px)


def _bind_stages(stages: tuple[Stage, ...]) -> list[Callable[..., Any]]:
    """The callables of ``stages``; those with memory start without any."""
    return [stage.bind() for stage in stages]


def _within(
    region: Region, picture: Image, view: GroundView, mask: Mask | None
) -> tuple[Image, GroundView, Mask | None]:
    """Picture, view and mask cut to the region; masks of several regions are joined by "and"."""
    rows, columns = region.box.rows, region.box.columns
    inner = region.mask[rows, columns] if region.mask is not None else None
    outer = mask[rows, columns] if mask is not None else None
    both = inner if outer is None else outer if inner is None else inner & outer
    return np.ascontiguousarray(picture[rows, columns]), view.crop(region.box), both


def _all_of(features: list[Features]) -> Features:
    """The least of several responses, each as a share of its greatest; a single one unchanged."""
    if len(features) == 1:
        return features[0]
    shares = [one.response / max(float(one.response.max()), 1e-6) for one in features]
    return Features(np.minimum.reduce(shares).astype(np.float32), features[0].kind)


def boundary_path(boundary: Boundary | None, camera: Camera) -> PixelPath:
    """Pixels (x, y) of the boundary in the distorted input image, one every ten rows from the bottom up."""
    if boundary is None:
        return ()
    pixels = _distort_points(np.column_stack([boundary.x_m, boundary.y_m]), camera)
    if len(pixels) < 2:
        return ()
    rows = np.arange(camera.height_px // ROW_STEP_PX * ROW_STEP_PX, -1.0, -ROW_STEP_PX)
    order = np.argsort(pixels[:, 1])
    columns = np.interp(rows, pixels[order, 1], pixels[order, 0], left=np.nan, right=np.nan)
    near = (columns >= -camera.width_px) & (columns < 2 * camera.width_px)  # NaN is not near
    return tuple(zip(columns[near].tolist(), rows[near].tolist(), strict=True))


def _distort_points(ground_m: Array, camera: Camera) -> Array:
    """Pixels, shape (n, 2), of the road points that lie ahead of the camera, with lens distortion."""
    points = np.column_stack([ground_m - [camera.x_m, camera.y_m], np.full(len(ground_m), -camera.height_m)])
    rays = points @ camera.optical_from_vehicle.T
    rays = rays[rays[:, 2] > 0.1]
    if not len(rays):
        return np.empty((0, 2))
    zero = np.zeros(3)
    distortion = camera.lens
    pixels, _ = cv2.projectPoints(rays, zero, zero, camera.intrinsics, distortion)
    return np.asarray(pixels, float).reshape(-1, 2)
