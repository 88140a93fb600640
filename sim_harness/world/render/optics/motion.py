"""Motion blur and rolling shutter.

Over τ the vehicle drives the arc of its speed and yaw rate. A point of the ground at pixel p at time τ was at
G(τ)·p at time 0, with the homography G(τ) = H·T(τ)·H⁻¹ of the ground (H: pixel from road). Such arcs form a group,
G(a + b) = G(a)·G(b), so n warps average over 2ⁿ moments. The sky only rotates. The time of a frame is the start of
the exposure of its first row.
"""

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike

from sim_harness.world.render.scene.view import ShutterMotion
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image

FINEST_PX = 1.5  # motion of the fastest pixel between two averaged moments
MAX_WARPS = 5


def road_after(motion: ShutterMotion, tau_s: ArrayLike) -> Array:
    """Homogeneous road points of the vehicle at time 0 from those at times τ: (..., 3, 3), an arc."""
    tau = np.asarray(tau_s, float)
    half = motion.yaw_rate_radps * tau / 2
    chord = motion.speed_mps * tau * np.sinc(half / math.pi)
    matrix = np.zeros((*tau.shape, 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = np.cos(2 * half)
    matrix[..., 1, 0] = np.sin(2 * half)
    matrix[..., 0, 1] = -matrix[..., 1, 0]
    matrix[..., 0, 2], matrix[..., 1, 2] = chord * np.cos(half), chord * np.sin(half)
    matrix[..., 2, 2] = 1
    return matrix


class Shake:
    """The image motion of one camera."""

    def __init__(self, camera: Camera, horizon_row: int) -> None:
        """Rows from ``horizon_row`` on show the ground."""
        self._camera = camera
        self._horizon = horizon_row
        self._pixel_from_road = camera.pixel_from_road_matrix
        self._road_from_pixel = np.linalg.inv(self._pixel_from_road)
        self._pixel_from_vehicle = camera.intrinsics @ camera.optical_from_vehicle
        self._vehicle_from_pixel = np.linalg.inv(self._pixel_from_vehicle)

    def ground(self, motion: ShutterMotion, tau_s: ArrayLike) -> Array:
        """G(τ): pixels of the ground at time 0 from those at times τ, (..., 3, 3)."""
        return np.asarray(self._pixel_from_road @ road_after(motion, tau_s) @ self._road_from_pixel)

    def sky(self, motion: ShutterMotion, tau_s: ArrayLike) -> Array:
        """G(τ) for infinitely distant points: K·R(τ)·K⁻¹."""
        turn = road_after(ShutterMotion(0.0, motion.yaw_rate_radps), tau_s)
        return np.asarray(self._pixel_from_vehicle @ turn @ self._vehicle_from_pixel)

    def roll(self, image: Image, motion: ShutterMotion, readout_s: float) -> Image:
        """``image`` with a rolling shutter: each row is warped to its own time within ``readout_s``."""
        rows, columns = image.shape[:2]
        u = np.arange(columns, dtype=np.float32)
        tau_s = readout_s * np.arange(rows) / rows
        warps = np.concatenate(
            [self.sky(motion, tau_s[: self._horizon]), self.ground(motion, tau_s[self._horizon :])]
        )
        lines = np.stack([warps[:, :, 0], warps[:, :, 1] * np.arange(rows)[:, None] + warps[:, :, 2]], axis=2)
        slope, start = lines.transpose(2, 1, 0)[..., None].astype(np.float32)  # (3, rows, 1)
        x, y, w = slope * u + start
        from_column, from_row = x / w, y / w
        border = cv2.BORDER_REPLICATE
        rolled = cv2.remap(image, from_column, from_row, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(rolled, np.uint8)

    def blur(self, image: Image, motion: ShutterMotion, exposure_s: float) -> Image:
        """The mean of ``image`` over the exposure."""
        total = image.astype(np.float32)
        for k in range(1, self._warps(motion, exposure_s) + 1):
            tau_s = exposure_s / 2**k
            late = np.empty_like(total)
            for matrix, first, last in (
                (self.sky(motion, tau_s), 0, self._horizon),
                (self.ground(motion, tau_s), self._horizon, len(image)),
            ):
                late[first:last] = _warp_rows(total, matrix, first, last)
            total = np.asarray(cv2.addWeighted(total, 0.5, late, 0.5, 0), np.float32)
        return np.asarray(cv2.convertScaleAbs(total), np.uint8)

    def _warps(self, motion: ShutterMotion, exposure_s: float) -> int:
        """Number of warps that keeps the steps of the fastest pixel below FINEST_PX."""
        height, width = self._camera.height_px, self._camera.width_px
        corners = np.array([(0, height - 1, 1), (width - 1, height - 1, 1), (0, self._horizon, 1)], float).T
        moved = self.ground(motion, exposure_s) @ corners
        path_px = float(np.abs(moved[:2] / moved[2] - corners[:2]).max())
        return min(max(math.ceil(math.log2(max(path_px / FINEST_PX, 1))), 1), MAX_WARPS)


def _warp_rows(image: Floats, source_from_pixel: Array, first: int, last: int) -> Floats:
    if first >= last:
        return image[first:last]
    matrix = source_from_pixel @ np.array([[1, 0, 0], [0, 1, first], [0, 0, 1]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (image.shape[1], last - first)
    return np.asarray(
        cv2.warpPerspective(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32
    )
