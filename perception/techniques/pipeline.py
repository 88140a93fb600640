"""A pipeline of the review's techniques as an estimator (inventory P04, B01)."""

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.techniques.image.picture import (
    Boundaries,
    Boundary,
    Features,
    Kind,
    MeasuredLane,
    Motion,
    Region,
    View,
    camera_view,
    moved,
)
from perception.techniques.recipe import Recipe
from perception.techniques.steering.steer import pursuit
from trepid.camera import Camera
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.types import Array, Image, Mask
from trepid.vehicle import Vehicle

WORKING_WIDTH_PX = 320  # as the default estimator, so that times compare
MIN_SIZE_PX = 32  # below this there is no road to be seen
LOOKAHEAD_M = 8.0  # where the curvature of the estimate holds, as config/perception.yaml
ROW_STEP_PX = 10  # boundaries are reported every ten rows of the input image
MAX_GAP_S = 1.0  # after this the last boundaries say nothing about the next
RESIDUAL_M = 0.15  # scatter of the evidence that halves the belief: as wide as a line
ASIDE_M = 0.5  # how far out of its lane a vehicle's path may lead until that is hardly believed
ON_M, WIDE_M, CLEAR_TO_M = 0.3, 3.0, 20.0  # on a boundary; what may be the lane; how far that is looked at
MURKY, CLEAR = 0.45, 0.85  # even noise has 0.2 to 0.3 of the lane and its boundaries on these
ONE_SIDE = 0.6  # belief in a lane of which one side was seen


class Pipeline:
    """The estimator that a recipe describes. Its only state is the last boundaries and that of its stages."""

    def __init__(self, recipe: Recipe, camera: Camera, vehicle: Vehicle) -> None:
        self._recipe, self._camera, self._vehicle = recipe, camera, vehicle
        self._before = [(stage.kind, stage.bound()) for stage in recipe.of("prepare", "warp", "region")]
        self._features = [stage.bound() for stage in recipe.of("features")]
        self._outliers = [stage.bound() for stage in recipe.of("outliers")]
        (self._model,) = (stage.bound() for stage in recipe.of("model"))
        self._track: list[Callable[..., Boundaries]] = []  # made anew when time jumps
        (self._state,) = (stage.bound() for stage in recipe.of("state"))
        self._steer = next((stage.bound() for stage in recipe.of("steer")), pursuit)
        self._rule = next((stage.bound() for stage in recipe.of("rule")), None)
        self._rng = np.random.default_rng(0)  # one seed: the same frames give the same answer
        self._last: Boundaries | None = None
        self._last_t_s = math.nan

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` says how far the vehicle has moved since the last one."""
        problem = _unusable(frame.image)
        if problem:
            return self._nothing(frame.t_s, problem)
        picture, view = self._working(frame.image)
        if not (view.ahead_m > 0).any():
            return self._nothing(frame.t_s, "the camera sees no road")
        motion = self._motion(frame.t_s, state)
        predicted = moved(self._last, motion) if self._last is not None else None
        boundaries, evidence = self._boundaries(picture, view, predicted, motion.speed_mps)
        for track in self._track:
            boundaries = track(boundaries, motion)
        self._last, self._last_t_s = (boundaries if boundaries.seen else None), frame.t_s
        measured = self._state(boundaries, view)
        if self._rule is not None:
            angle = self._rule(boundaries, view, motion.dt_s)
            return self._angle_estimate(frame.t_s, boundaries, evidence, measured, angle)
        return self._lane_estimate(frame.t_s, boundaries, evidence, measured)

    def _working(self, image: NDArray[np.uint8]) -> tuple[Image, View]:
        """The BGR image at working size, without lens distortion, and its view."""
        height_px, width_px = image.shape[:2]
        if (self._camera.width_px, self._camera.height_px) != (width_px, height_px):
            self._camera = self._camera.resized(width_px, height_px)
        picture, view, camera = as_bgr(image), camera_view(self._camera), self._camera
        if any(camera.distortion):
            picture = np.asarray(
                cv2.undistort(picture, camera.intrinsics, np.array(camera.distortion)), np.uint8
            )
        if width_px > WORKING_WIDTH_PX:
            size = (WORKING_WIDTH_PX, max(1, round(height_px * WORKING_WIDTH_PX / width_px)))
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
            view = view.resized(*size)
        return picture, view

    def _motion(self, t_s: float, state: VehicleState | None) -> Motion:
        """How the vehicle moved since the last frame; what is remembered goes when time jumps."""
        dt_s = t_s - self._last_t_s
        if not 0 <= dt_s <= MAX_GAP_S:  # NaN: the first frame
            self._last, dt_s = None, 0.0
            self._track = [stage.bound() for stage in self._recipe.of("track")]
        speed, rate = (state.speed_mps, state.yaw_rate_radps) if state else (None, None)
        return Motion(dt_s, _finite(speed), _finite(rate))

    def _boundaries(
        self, picture: Image, view: View, predicted: Boundaries | None, speed_mps: float | None
    ) -> tuple[Boundaries, float]:
        """Prepared picture → features → without outliers → boundaries on the road, and how clear they are."""
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
            response = np.where(mask, features.response, features.response.dtype.type(0))
            features = replace(features, response=response)
        for call in self._outliers:
            features = call(features, view, predicted)
        boundaries: Boundaries = self._model(features, view, predicted, self._rng)
        return boundaries, clarity(features, view, boundaries)

    def _angle_estimate(
        self,
        t_s: float,
        boundaries: Boundaries,
        evidence: float,
        measured: MeasuredLane | None,
        angle_rad: float | None,
    ) -> SteeringEstimate:
        """The angle of the steering rule; the lane state, which the rule does not measure, only rates it."""
        if measured is None or angle_rad is None:
            return self._nothing(t_s, boundaries.reason or "the boundaries make no lane")
        return replace(
            self._nothing(t_s, boundaries.reason),
            road_wheel_angle_rad=angle_rad,
            confidence=self._recipe.trust * evidence * belief(boundaries, measured, self._recipe),
            lanes_detected=boundaries.seen,
            left_boundary_px=boundary_path(boundaries.left, self._camera),
            right_boundary_px=boundary_path(boundaries.right, self._camera),
        )

    def _lane_estimate(
        self, t_s: float, boundaries: Boundaries, evidence: float, measured: MeasuredLane | None
    ) -> SteeringEstimate:
        if measured is None:
            return self._nothing(t_s, boundaries.reason or "the boundaries make no lane")
        lane = measured.lane
        return SteeringEstimate(
            t_s=t_s,
            estimator=self._recipe.name,
            lateral_offset_m=lane.offset_m,
            heading_error_rad=lane.heading_rad,
            curvature_1pm=lane.curvature_at(LOOKAHEAD_M),
            curvature_rate_1pm2=lane.curvature_rate_1pm2,
            lookahead_m=LOOKAHEAD_M,
            road_wheel_angle_rad=self._steer(lane, self._vehicle.wheelbase_m),
            confidence=self._recipe.trust * evidence * belief(boundaries, measured, self._recipe),
            lanes_detected=boundaries.seen,
            lane_width_m=measured.width_m,
            latency_ms=None,
            reason=boundaries.reason,
            left_boundary_px=boundary_path(boundaries.left, self._camera),
            right_boundary_px=boundary_path(boundaries.right, self._camera),
        )

    def _nothing(self, t_s: float, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            t_s,
            estimator=self._recipe.name,
            lookahead_m=LOOKAHEAD_M,
            reason=reason,
            kind=self._recipe.kind,
        )


def belief(boundaries: Boundaries, measured: MeasuredLane, recipe: Recipe) -> float:
    """0..1: support × small residual × plausible width × a lane that holds the vehicle, now and ahead."""
    sides = [side for side in (boundaries.left, boundaries.right) if side is not None]
    support = math.prod(side.support for side in sides) ** (1 / len(sides))
    residual = max(side.residual_m for side in sides)
    fits = 1 / (1 + (residual / RESIDUAL_M) ** 2)
    if measured.width_m is None:
        plausible = ONE_SIDE
    else:
        plausible = math.exp(-0.5 * ((measured.width_m - recipe.width_m) / recipe.width_sigma_m) ** 2)
    farther_m = max(abs(measured.lane.offset_m), abs(measured.lane.y_m(LOOKAHEAD_M)))
    inside = math.exp(-0.5 * (max(0.0, farther_m - recipe.width_m / 2) / ASIDE_M) ** 2)
    return min(1.0, support) * fits * plausible * inside


def clarity(features: Features, view: View, boundaries: Boundaries) -> float:
    """0..1: how empty the lane is of what made its boundaries; noise and texture fill it, paint does not.

    With the shares of line features up to ``CLEAR_TO_M`` ahead that lie on the boundaries, a, and between them or
    on the lane side of a single one, b: a/(a + b), from ``MURKY`` (0) to ``CLEAR`` (1). Regions are clear.
    """
    if features.kind is not Kind.LINE or not boundaries.seen:
        return 1.0
    rows, columns = np.nonzero(features.response)
    x_m, y_m = view.ground(np.column_stack([columns, rows])).T
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


def boundary_path(boundary: Boundary | None, camera: Camera) -> PixelPath:
    """The boundary as pixels of the input image, with its lens, one every ten rows from the bottom up."""
    if boundary is None:
        return ()
    pixels = _seen_through(np.column_stack([boundary.x_m, boundary.y_m]), camera)
    if len(pixels) < 2:
        return ()
    rows = np.arange(camera.height_px // ROW_STEP_PX * ROW_STEP_PX, -1.0, -ROW_STEP_PX)
    order = np.argsort(pixels[:, 1])
    columns = np.interp(rows, pixels[order, 1], pixels[order, 0], left=np.nan, right=np.nan)
    seen = (columns >= -camera.width_px) & (columns < 2 * camera.width_px)  # NaN is not seen
    return tuple(zip(columns[seen].tolist(), rows[seen].tolist(), strict=True))


def _seen_through(ground_m: Array, camera: Camera) -> Array:
    """Pixels of road points that lie ahead of the camera, with lens distortion."""
    points = np.column_stack([ground_m - [camera.x_m, camera.y_m], np.full(len(ground_m), -camera.height_m)])
    rays = points @ camera.optical_from_vehicle.T
    rays = rays[rays[:, 2] > 0.1]
    if not len(rays):
        return np.empty((0, 2))
    zero = np.zeros(3)
    distortion = np.array(camera.distortion or [0.0] * 4)
    pixels, _ = cv2.projectPoints(rays, zero, zero, camera.intrinsics, distortion)
    return np.asarray(pixels, float).reshape(-1, 2)


def as_bgr(image: NDArray[np.uint8]) -> Image:
    """The image with three channels; grey and BGRA images are converted."""
    if image.ndim == 2 or image.shape[2] == 1:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    return image if image.shape[2] == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGRA2BGR), np.uint8)


def _unusable(image: NDArray[np.uint8]) -> str:
    """Why this is no camera image; "" when it is one."""
    if (
        image.dtype != np.uint8
        or image.ndim not in (2, 3)
        or (image.ndim == 3 and image.shape[2] not in (1, 3, 4))
    ):
        return f"not an 8-bit image: {image.dtype} {image.shape}"
    return "image too small" if min(image.shape[:2]) < MIN_SIZE_PX else ""


def _within(region: Region, picture: Image, view: View, mask: Mask | None) -> tuple[Image, View, Mask | None]:
    """Picture, view and mask cut to the region; masks of several regions are joined by "and"."""
    rows, columns = region.box.rows, region.box.columns
    inner = region.mask[rows, columns] if region.mask is not None else None
    outer = mask[rows, columns] if mask is not None else None
    both = inner if outer is None else outer if inner is None else inner & outer
    return np.ascontiguousarray(picture[rows, columns]), view.cropped(region.box), both


def _all_of(seen: list[Features]) -> Features:
    """What all features see: the least of their responses, as shares of the greatest where they are several."""
    if len(seen) == 1:
        return seen[0]
    shares = [one.response / max(float(one.response.max()), 1e-6) for one in seen]
    return Features(np.minimum.reduce(shares).astype(np.float32), seen[0].kind)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
