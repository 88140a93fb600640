"""The data that stages pass on, and the geometry of a plane picture.

Every picture (the camera image, a part of it, the road from above) is a plane image of a flat road, so one
homography holds all of its geometry. Boundaries are points on the road in the vehicle frame (x forward, y left),
independent of the picture in which they were found.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from trepid.car.camera import Camera
from trepid.clothoid import Lane, chord
from trepid.types import Array, Mask

AT_HORIZON = 1e-9
MOST_PARTS = 8  # of a view, kept with their geometry


@dataclass(frozen=True)
class GroundView:
    """A picture as the plane projection of the flat road."""

    camera: Camera  # its mounting; its size and focal length may differ from those of the picture
    width_px: int
    height_px: int
    pixel_from_ground: Array  # homography from road points (x, y, 1) [m], shape (3, 3)
    from_above: bool = False  # a bird's-eye view: rows go forward, columns to the left
    seen: Mask | None = None  # pixels inside of the camera image; None: all

    @cached_property
    def ground_from_pixel(self) -> Array:
        """The inverse homography, shape (3, 3)."""
        return np.asarray(np.linalg.inv(self.pixel_from_ground), np.float64)

    @cached_property
    def horizon_px(self) -> float:
        """Row of the horizon of the flat road straight ahead of the picture's middle; −inf from above."""
        a, b, c = self.ground_from_pixel[2]
        return -np.inf if self.from_above else float(-(a * (self.width_px - 1) / 2 + c) / b)

    def ground(self, pixel: ArrayLike) -> Array:
        """Road points (x, y) [m], shape (n, 2), of pixels, shape (n, 2); NaN at and above the horizon."""
        points = np.atleast_2d(np.asarray(pixel, float))
        x, y, depth = self.ground_from_pixel @ np.column_stack([points, np.ones(len(points))]).T
        sign = self.ground_from_pixel[2] @ [(self.width_px - 1) / 2, 1e6, 1.0]  # far below: always road
        depth = np.where(depth * np.sign(sign) > AT_HORIZON, depth, np.nan)
        return np.column_stack([x / depth, y / depth])

    def pixels(self, ground_m: ArrayLike) -> Array:
        """Pixels, shape (n, 2), of road points (x, y) [m], shape (n, 2); NaN for points behind the camera."""
        points = np.atleast_2d(np.asarray(ground_m, float))
        u, v, depth = self.pixel_from_ground @ np.column_stack([points, np.ones(len(points))]).T
        depth = np.where(depth > 1e-6, depth, np.nan)
        return np.column_stack([u / depth, v / depth])

    @cached_property
    def pixel_m(self) -> Array:
        """Width on the road [m] of the middle pixel of every row; NaN above the horizon."""
        rows, middle = np.arange(self.height_px, dtype=float), (self.width_px - 1) / 2
        left = self.ground(np.column_stack([np.full_like(rows, middle - 0.5), rows]))
        right = self.ground(np.column_stack([np.full_like(rows, middle + 0.5), rows]))
        return np.hypot(*(left - right).T)

    @cached_property
    def ahead_m(self) -> Array:
        """Distance x [m] ahead of the rear axle of the middle of every row; NaN above the horizon."""
        rows = np.arange(self.height_px, dtype=float)
        return self.ground(np.column_stack([np.full_like(rows, (self.width_px - 1) / 2), rows]))[:, 0]

    @cached_property
    def nearest_m(self) -> float:
        """Distance x [m] ahead of the rear axle of the nearest road in the middle of the picture."""
        return float(np.nanmin(np.where(self.ahead_m > 0, self.ahead_m, np.nan)))

    def crop(self, box: "PixelBox") -> "GroundView":
        """The view of the part of the picture inside ``box``, one for every frame that has this box."""
        if box not in self._parts:
            if len(self._parts) == MOST_PARTS:
                self._parts.clear()
            self._parts[box] = self._part(box)
        return self._parts[box]

    @cached_property
    def _parts(self) -> "dict[PixelBox, GroundView]":
        return {}

    def _part(self, box: "PixelBox") -> "GroundView":
        shift = np.array([[1.0, 0, -box.left_px], [0, 1, -box.top_px], [0, 0, 1]])
        return replace(
            self,
            width_px=box.right_px - box.left_px,
            height_px=box.bottom_px - box.top_px,
            pixel_from_ground=shift @ self.pixel_from_ground,
            seen=None if self.seen is None else self.seen[box.rows, box.columns],
        )

    def resize(self, width_px: int, height_px: int) -> "GroundView":
        """The view of the area-averaged picture: pixel u of it is centred on s·(u + ½) − ½."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        scale = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        seen, size = self.seen, (width_px, height_px)
        if seen is not None:
            seen = cv2.resize(seen.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        matrix = scale @ self.pixel_from_ground
        return replace(self, width_px=width_px, height_px=height_px, pixel_from_ground=matrix, seen=seen)


USUAL_HEIGHT_M = 1.45  # of the camera for which the lengths ahead are chosen: config/camera.yaml


def sight_share(camera: Camera) -> float:
    """How far ``camera`` sees the road as well as one at USUAL_HEIGHT_M does, as a share of that; at most 1.

    At an angle α below the horizon it sees the road at the distance h/tan α.
    """
    return min(1.0, camera.height_m / USUAL_HEIGHT_M)


def camera_view(camera: Camera) -> GroundView:
    """The view of a whole, undistorted camera image."""
    return GroundView(camera, camera.width_px, camera.height_px, camera.pixel_from_road_matrix)


@dataclass(frozen=True)
class PixelBox:
    """Rows ``top_px`` to ``bottom_px`` and columns ``left_px`` to ``right_px``, the last ones not included."""

    top_px: int
    bottom_px: int
    left_px: int
    right_px: int

    @property
    def rows(self) -> slice:
        return slice(self.top_px, self.bottom_px)

    @property
    def columns(self) -> slice:
        return slice(self.left_px, self.right_px)


@dataclass(frozen=True)
class Region:
    """The part of a picture that is processed."""

    box: PixelBox
    mask: Mask | None = None  # pixels that count; None: all


class FeatureKind(StrEnum):
    """The places of a high response."""

    LINE = "line"  # edges or stripes along the boundaries
    REGION = "region"  # the surface of the road between them
    TEXTURE = "texture"  # pixels with a direction


@dataclass(frozen=True)
class Features:
    """The response of each pixel of a picture: boundary, or road."""

    response: NDArray[np.uint8] | NDArray[np.float32]  # (height, width); 0 = none
    kind: FeatureKind
    direction_rad: NDArray[np.float32] | None = None  # of texture, from columns to rows

    def where(self, kept: Mask) -> "Features":
        """The features with no response outside of ``kept``."""
        return replace(self, response=np.where(kept, self.response, self.response.dtype.type(0)))


@dataclass(frozen=True)
class Boundary:
    """One side of the lane: points in the vehicle frame from near to far, and their evidence."""

    x_m: Array
    y_m: Array
    residual_m: float  # root mean square distance of its evidence across it
    support: float  # 0..1, share of its length where there is evidence

    def at(self, x_m: ArrayLike) -> Array:
        """y [m] at ``x_m``; NaN beyond the ends."""
        return np.interp(np.asarray(x_m, float), self.x_m, self.y_m, left=np.nan, right=np.nan)

    def polynomial(self, degree: int) -> Array:
        """Least-squares coefficients c with y = c₀ + c₁x + …, shape (degree + 1,)."""
        degree = min(degree, len(self.x_m) - 1)
        return np.asarray(np.polynomial.polynomial.polyfit(self.x_m, self.y_m, degree), np.float64)


@dataclass(frozen=True)
class Boundaries:
    """The two sides of the lane; None: not found."""

    left: Boundary | None
    right: Boundary | None
    reason: str = ""  # for a missing side

    @property
    def signed_sides(self) -> list[tuple[Boundary, float]]:
        """The sides that were found, with their signs: +1 left, −1 right."""
        return [(side, sign) for side, sign in ((self.left, 1.0), (self.right, -1.0)) if side is not None]

    @property
    def side_count(self) -> int:
        """The number of sides: 0, 1 or 2."""
        return len(self.signed_sides)

    def each(self, change: Callable[[Boundary], Boundary | None]) -> "Boundaries":
        """The boundaries with ``change`` applied to the sides that were found."""
        left, right = (None if side is None else change(side) for side in (self.left, self.right))
        return replace(self, left=left, right=right)


def _seeded_generator() -> np.random.Generator:
    return np.random.default_rng(0)


@dataclass(frozen=True)
class Evidence:
    """The features of a frame, and what else the stages need that select features and fit boundaries."""

    features: Features
    view: GroundView
    predicted: Boundaries | None = None  # those of the last frame in the present vehicle frame
    rng: np.random.Generator = field(default_factory=_seeded_generator)


@dataclass(frozen=True)
class MeasuredLane:
    """The lane and its width [m]; the width is None when only one boundary was found."""

    lane: Lane
    width_m: float | None


@dataclass(frozen=True)
class FrameMotion:
    """The motion of the vehicle since the last frame; None: not reported."""

    dt_s: float
    speed_mps: float | None
    yaw_rate_radps: float | None

    @property
    def distance_m(self) -> float:
        """Distance travelled; 0 for an unknown speed."""
        return (self.speed_mps or 0.0) * self.dt_s

    @property
    def turn_rad(self) -> float:
        """Angle turned to the left; 0 for an unknown yaw rate."""
        return (self.yaw_rate_radps or 0.0) * self.dt_s


def move_boundaries(boundaries: Boundaries, motion: FrameMotion) -> Boundaries:
    """The same boundaries on the road, in the frame of the vehicle after ``motion``.

    Points p become R(−φ)·(p − t), with the chord t of an arc of length s that turns by φ.
    """
    along_m, aside_m = chord(motion.distance_m, motion.turn_rad)
    cos, sin = np.cos(motion.turn_rad), np.sin(motion.turn_rad)

    def turn_side(side: Boundary) -> Boundary:
        x, y = side.x_m - along_m, side.y_m - aside_m
        return replace(side, x_m=cos * x + sin * y, y_m=cos * y - sin * x)

    return boundaries.each(turn_side)
