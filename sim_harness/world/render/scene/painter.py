"""Projects polygons of upright things into an image."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.car.camera import Camera
from trepid.types import Array, Image

Pose = tuple[float, float, float]
"""x, y and yaw of the origin of a thing: of a vehicle its rear-axle centre."""
Colour = tuple[int, int, int]  # BGR
Pixels = NDArray[np.int32]  # fixed-point corners, (n, 2)

NEAR_M = 0.3  # faces are clamped to this depth
MAX_PX = 8000.0
SHADOW = 80  # light left below a thing, of 255
SHIFT = 4  # sub-pixel bits of OpenCV's drawing


class Painter:
    """Projects polygons in the axes of a thing at ``pose`` into the image; ``pose`` is in vehicle axes."""

    def __init__(self, image: Image, camera: Camera, pose: Pose, *, mirrored: bool = False) -> None:
        self._image, self._camera = image, camera
        self._upside = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        self._turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        self._shift = np.array([x, y, 0.0]) - (camera.x_m, camera.y_m, camera.height_m)
        self._eye = self._turn.T @ -self._shift  # the camera in the thing's axes

    @property
    def focal_px(self) -> float:
        """Pixels of a length at the same depth."""
        return self._camera.fx_px

    def optical(self, points: Array) -> Array:
        """Points of the thing (right, down, ahead) of the lens, (n, 3)."""
        from_lens = (self._turn @ (points * self._upside).T).T + self._shift
        return np.asarray(from_lens @ self._camera.optical_from_vehicle.T)

    def pixels(self, optical: Array) -> Array:
        """Pixels of points before the lens, (n, 2)."""
        return np.asarray((self._camera.intrinsics[:2] @ (optical / optical[:, 2:]).T).T)

    def faces_rear(self, x_m: float) -> bool:
        """Whether the camera is behind the plane ``x_m`` ahead of the origin."""
        return bool(self._eye[0] < x_m)

    def faces_front(self, x_m: float) -> bool:
        """Whether the camera is in front of the plane ``x_m`` ahead of the origin."""
        return bool(self._eye[0] > x_m)

    def faces_side(self, y_m: float) -> bool:
        """Whether the camera is outside the side ``y_m`` to the left of the origin."""
        return bool(self._eye[1] * y_m > y_m**2)

    def face(self, corners: list[tuple[float, float, float]], bgr: tuple[float, ...]) -> None:
        polygon = self.project(np.array(corners))
        if len(polygon) > 2:
            cv2.fillConvexPoly(self._image, polygon, bgr, cv2.LINE_AA, SHIFT)

    def disc(self, centre: tuple[float, float, float], radius_m: float, bgr: tuple[float, ...]) -> None:
        """Draw a ball of one colour."""
        optical = self._camera.optical_from_vehicle @ (
            self._turn @ (np.array(centre) * self._upside) + self._shift
        )
        if optical[2] > radius_m + NEAR_M:
            pixel = self._camera.intrinsics[:2] @ (optical / optical[2])
            radius_px = self._camera.fx_px * radius_m / optical[2]
            u, v, radius = (round(float(value) * 2**SHIFT) for value in (*pixel, radius_px))
            if max(abs(u), abs(v)) < MAX_PX * 2**SHIFT:
                cv2.circle(self._image, (u, v), radius, bgr, -1, cv2.LINE_AA, SHIFT)

    def shadow(self, rear_m: float, front_m: float, half_m: float) -> None:
        """Draw a soft shadow on the road below the thing."""
        corners = [(rear_m, -half_m, 0), (rear_m, half_m, 0), (front_m, half_m, 0), (front_m, -half_m, 0)]
        polygon = self.project(np.array(corners, float))
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
            if self.faces_side(side * lower):
                corners = [
                    (x0, side * lower, z0),
                    (x1, side * lower, z0),
                    (x1, side * upper, z1),
                    (x0, side * upper, z1),
                ]
                self.face(corners, shade_colour(bgr, 0.75))
        if self._eye[2] > z1:
            self.face(
                [(x0, -upper, z1), (x1, -upper, z1), (x1, upper, z1), (x0, upper, z1)],
                shade_colour(bgr, 1.25),
            )
        if not (self.faces_rear(x0) or self.faces_front(x1)):
            return
        end = x0 if self.faces_rear(x0) else x1
        corners = [(end, -lower, z0), (end, lower, z0), (end, upper, z1), (end, -upper, z1)]
        self.face(corners, shade_colour(bgr, 0.95))

    def project(self, corners: Array) -> Pixels:
        """Fixed-point pixels of a polygon in the thing's axes, (n, 3), clipped to the part in front of the lens."""
        pixel = self.pixels(_before(self.optical(corners), NEAR_M))
        return np.round(np.clip(pixel, -MAX_PX, MAX_PX) * 2**SHIFT).astype(np.int32)


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


def shade_colour(bgr: Colour, share: float) -> tuple[float, ...]:
    return tuple(min(share * channel, 255) for channel in bgr)
