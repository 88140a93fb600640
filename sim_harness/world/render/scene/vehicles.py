"""Draws vehicles as plain cars."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.car.camera import Camera
from trepid.types import Array, Image

Pose = tuple[float, float, float]
"""x, y, yaw of the rear-axle centre."""
Colour = tuple[int, int, int]  # BGR
Pixels = NDArray[np.int32]  # fixed-point corners, (n, 2)

NEAR_M = 0.3  # faces are clamped to this depth
MAX_PX = 8000.0
SHADOW = 80  # light left below a car, of 255
SHIFT = 4  # sub-pixel bits of OpenCV's drawing
FRONT_OVERHANG_M, WHEEL_M = 0.80, 0.32


@dataclass(frozen=True, slots=True)
class Body:
    """A passenger car; x is counted from the rear axle."""

    rear_m: float = -0.85
    front_m: float = 3.40
    width_m: float = 1.78
    height_m: float = 1.48
    waist_m: float = 0.92  # lower edge of the windows
    clearance_m: float = 0.22
    bgr: Colour = (120, 60, 40)


def draw_lead(image: Image, camera: Camera, body: Body, pose: Pose, *, mirrored: bool = False) -> None:
    """Draw ``body`` at ``pose`` in the camera's vehicle frame into ``image``; nothing when it is behind.

    ``mirrored``: as the reflection on a wet road, upside down and without a shadow.
    """
    if pose[0] + math.hypot(body.front_m, body.width_m) < camera.x_m + NEAR_M:
        return
    half = body.width_m / 2
    painter = _Painter(image, camera, pose, mirrored=mirrored)
    if not mirrored:
        painter.shadow(body.rear_m - 0.15, body.front_m, half + 0.12)
    axle_m = body.front_m - FRONT_OVERHANG_M
    for x0, x1 in ((-WHEEL_M, WHEEL_M), (axle_m - WHEEL_M, axle_m + WHEEL_M)):
        for y in (-half, half):
            painter.face([(x0, y, 0.0), (x1, y, 0.0), (x1, y, 0.6), (x0, y, 0.6)], (28, 28, 28))
    for y0, y1 in ((-half, -half + 0.2), (half - 0.2, half)):
        painter.face([(-0.3, y, z) for y, z in ((y0, 0), (y1, 0), (y1, 0.4), (y0, 0.4))], (22, 22, 22))
    painter.box((body.rear_m, body.front_m), half, half, (body.clearance_m, body.waist_m), body.bgr)
    painter.cabin(body, half)
    for x, seen in ((body.rear_m, painter.faces_rear), (body.front_m, painter.faces_front)):
        if seen(x):
            for y0, y1, z0, z1, bgr in _end_faces(body, half, rear=x == body.rear_m):
                painter.face([(x, y0, z0), (x, y1, z0), (x, y1, z1), (x, y0, z1)], bgr)


def _end_faces(body: Body, half: float, *, rear: bool) -> list[tuple[float, float, float, float, Colour]]:
    """Bumper, lamps and number plate of the rear, or bumper, grille and headlamps of the front: y, z, colour."""
    lamp, bumper, low = (0.32 if rear else 0.36), (38, 38, 40), body.clearance_m
    if rear:
        return [
            (-half, half, low, 0.42, bumper),
            *((y, y + lamp, 0.68, 0.86, (40, 30, 190)) for y in (-half, half - lamp)),
            (-0.26, 0.26, 0.52, 0.63, (225, 225, 225)),
        ]
    return [
        (-half, half, low, 0.40, bumper),
        (-0.5, 0.5, 0.48, 0.66, (30, 30, 32)),
        *((y, y + lamp, 0.58, 0.76, (235, 235, 230)) for y in (-half, half - lamp)),
    ]


class _Painter:
    """Projects polygons in the car's axes into the image."""

    def __init__(self, image: Image, camera: Camera, pose: Pose, *, mirrored: bool = False) -> None:
        self._image, self._camera = image, camera
        self._upside = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        self._turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        self._shift = np.array([x, y, 0.0]) - (camera.x_m, camera.y_m, camera.height_m)
        self._eye = self._turn.T @ -self._shift  # the camera in the car's axes

    def faces_rear(self, x_m: float) -> bool:
        """Whether the camera is behind the plane ``x_m`` ahead of the rear axle."""
        return bool(self._eye[0] < x_m)

    def faces_front(self, x_m: float) -> bool:
        """Whether the camera is in front of the plane ``x_m`` ahead of the rear axle."""
        return bool(self._eye[0] > x_m)

    def face(self, corners: list[tuple[float, float, float]], bgr: tuple[float, ...]) -> None:
        polygon = self._project(np.array(corners))
        if len(polygon) > 2:
            cv2.fillConvexPoly(self._image, polygon, bgr, cv2.LINE_AA, SHIFT)

    def shadow(self, rear_m: float, front_m: float, half_m: float) -> None:
        """Draw a soft shadow on the road below the car."""
        corners = [(rear_m, -half_m, 0), (rear_m, half_m, 0), (front_m, half_m, 0), (front_m, -half_m, 0)]
        polygon = self._project(np.array(corners, float))
        if len(polygon) < 3:
            return
        spread_px = min(max(0.06 * float(np.ptp(polygon[:, 1])) / 2**SHIFT, 0.5), 6.0)
        margin = 6 * spread_px
        low, high = polygon.min(axis=0) / 2**SHIFT - margin, polygon.max(axis=0) / 2**SHIFT + margin
        first = np.maximum(low, 0).astype(int)
        part = self._image[first[1] : max(int(high[1]) + 2, 0), first[0] : max(int(high[0]) + 2, 0)]
        if part.size:
            light = np.full(part.shape[:2], 255, np.uint8)
            cv2.fillConvexPoly(light, polygon - first.astype(np.int32) * 2**SHIFT, SHADOW, cv2.LINE_AA, SHIFT)
            soft = cv2.GaussianBlur(light, (0, 0), spread_px)
            part[:] = cv2.multiply(part, cv2.merge([soft] * 3), scale=1 / 255)

    def box(
        self, x: tuple[float, float], lower: float, upper: float, z: tuple[float, float], bgr: Colour
    ) -> None:
        """Draw the visible faces of an upright box; half widths ``lower`` and ``upper``."""
        (x0, x1), (z0, z1) = x, z
        for side in (-1, 1):
            if side * self._eye[1] > lower:
                corners = [
                    (x0, side * lower, z0),
                    (x1, side * lower, z0),
                    (x1, side * upper, z1),
                    (x0, side * upper, z1),
                ]
                self.face(corners, _shaded(bgr, 0.75))
        if self._eye[2] > z1:
            self.face(
                [(x0, -upper, z1), (x1, -upper, z1), (x1, upper, z1), (x0, upper, z1)], _shaded(bgr, 1.25)
            )
        if not (self.faces_rear(x0) or self.faces_front(x1)):
            return
        end = x0 if self.faces_rear(x0) else x1
        corners = [(end, -lower, z0), (end, lower, z0), (end, upper, z1), (end, -upper, z1)]
        self.face(corners, _shaded(bgr, 0.95))

    def cabin(self, body: Body, half_m: float) -> None:
        x = (body.rear_m + 0.25, body.front_m - 1.5)
        roof_half, glass = half_m - 0.16, (58, 52, 48)
        self.box(x, half_m - 0.05, roof_half, (body.waist_m, body.height_m - 0.08), glass)
        self.box(x, roof_half + 0.02, roof_half, (body.height_m - 0.08, body.height_m), body.bgr)

    def _project(self, corners: Array) -> Pixels:
        """Fixed-point pixels of a polygon in the car's axes, (n, 3), clipped to the part in front of the lens."""
        points = (self._turn @ (corners * self._upside).T).T + self._shift
        clipped = _before(points @ self._camera.optical_from_vehicle.T, NEAR_M)
        pixel = self._camera.intrinsics[:2] @ (clipped / clipped[:, 2:]).T
        return np.round(np.clip(pixel.T, -MAX_PX, MAX_PX) * 2**SHIFT).astype(np.int32)


def _before(polygon: Array, depth_m: float) -> Array:
    """The part of a polygon (n, 3) with z >= ``depth_m``: Sutherland and Hodgman (1974) with one plane."""
    if (polygon[:, 2] >= depth_m).all():
        return polygon
    kept = []
    for here, there in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if here[2] >= depth_m:
            kept.append(here)
        if (here[2] >= depth_m) != (there[2] >= depth_m):
            kept.append(here + (depth_m - here[2]) / (there[2] - here[2]) * (there - here))
    return np.array(kept).reshape(-1, 3)


def outline(camera: Camera, body: Body, pose: Pose) -> Pixels | None:
    """Fixed-point convex outline of the box around a vehicle; None when it is behind the lens."""
    painter = _Painter(np.empty((0, 0, 3), np.uint8), camera, pose)
    half = body.width_m / 2
    ends = [
        [(x, y, z) for y in (-half, half) for z in (0.0, body.height_m)] for x in (body.rear_m, body.front_m)
    ]
    corners = [painter._project(np.array([a, b])) for a, b in zip(*ends, strict=True)]
    return np.asarray(cv2.convexHull(np.concatenate(corners)), np.int32) if any(map(len, corners)) else None


def _shaded(bgr: Colour, share: float) -> tuple[float, ...]:
    return tuple(min(share * channel, 255) for channel in bgr)
