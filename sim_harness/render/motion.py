"""What the vehicle's motion does while rows are read out and the shutter is open.

Over τ the vehicle drives the arc of its speed and yaw rate. A point of the ground that is seen at pixel p at time τ
was at G(τ)·p at time 0, with the homography G(τ) = H·T(τ)·H⁻¹ of the ground (H: pixel from road). Such arcs form a
group, G(a + b) = G(a)·G(b), so n warps blur over 2ⁿ moments. The sky only turns. The frame's time is the start of
the exposure of its first row.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.render.view import Bytes, Motion
from trepid.camera import Camera

Matrix = NDArray[np.float64]
FINEST_PX = 1.5  # between the moments that a blur is averaged from, at the fastest pixel
MAX_WARPS = 5


def road_after(motion: Motion, tau_s: float) -> Matrix:
    """Homogeneous road points of the vehicle at time 0 from those at time τ: (3, 3), an arc."""
    turn = motion.yaw_rate_radps * tau_s
    run = motion.speed_mps * tau_s
    half = turn / 2
    chord = run * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    cos, sin = math.cos(turn), math.sin(turn)
    return np.array([[cos, -sin, chord * math.cos(half)], [sin, cos, chord * math.sin(half)], [0, 0, 1]])


class Shake:
    """The motion of one camera's picture."""

    def __init__(self, camera: Camera, horizon_row: int) -> None:
        """Rows from ``horizon_row`` on show the ground."""
        self._camera = camera
        self._horizon = horizon_row
        self._pixel_from_road = camera.pixel_from_road_matrix
        self._road_from_pixel = np.linalg.inv(self._pixel_from_road)

    def ground(self, motion: Motion, tau_s: float) -> Matrix:
        """G(τ): pixels of the ground at time 0 from those at time τ."""
        return np.asarray(self._pixel_from_road @ road_after(motion, tau_s) @ self._road_from_pixel)

    def sky(self, motion: Motion, tau_s: float) -> Matrix:
        """The same for what is infinitely far."""
        camera = self._camera
        cos, sin = (f(motion.yaw_rate_radps * tau_s) for f in (math.cos, math.sin))
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        rotation = camera.optical_from_vehicle @ turn @ camera.optical_from_vehicle.T
        return np.asarray(camera.intrinsics @ rotation @ np.linalg.inv(camera.intrinsics))

    def roll(self, image: Bytes, motion: Motion, readout_s: float) -> Bytes:
        """``image`` read out row by row over ``readout_s``: each row is warped to its own time."""
        rows, columns = image.shape[:2]
        u = np.arange(columns, dtype=np.float32)
        of = [self.ground if v >= self._horizon else self.sky for v in range(rows)]
        warps = np.array([of[v](motion, readout_s * v / rows) for v in range(rows)])
        lines = np.stack([warps[:, :, 0], warps[:, :, 1] * np.arange(rows)[:, None] + warps[:, :, 2]], axis=2)
        slope, start = lines.transpose(2, 1, 0)[..., None].astype(np.float32)  # (3, rows, 1)
        x, y, w = slope * u + start
        from_column, from_row = x / w, y / w
        flags = cv2.INTER_LINEAR
        return np.asarray(
            cv2.remap(image, from_column, from_row, flags, borderMode=cv2.BORDER_REPLICATE), np.uint8
        )

    def blur(self, image: Bytes, motion: Motion, exposure_s: float) -> Bytes:
        """The mean of ``image`` over the exposure."""
        warps = self._warps(motion, exposure_s)
        size = image.shape[1::-1]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        total = image.astype(np.float32)
        for k in range(1, warps + 1):
            tau_s = exposure_s / 2**k
            later = [
                cv2.warpPerspective(part, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
                for part, matrix in ((total, self.sky(motion, tau_s)), (total, self.ground(motion, tau_s)))
            ]
            late = np.concatenate([later[0][: self._horizon], later[1][self._horizon :]])
            total = np.asarray(cv2.addWeighted(total, 0.5, late, 0.5, 0), np.float32)
        return np.asarray(cv2.convertScaleAbs(total), np.uint8)

    def _warps(self, motion: Motion, exposure_s: float) -> int:
        """Enough that the fastest pixel does not jump."""
        height, width = self._camera.height_px, self._camera.width_px
        corners = np.array([(0, height - 1, 1), (width - 1, height - 1, 1), (0, self._horizon, 1)], float).T
        moved = self.ground(motion, exposure_s) @ corners
        path_px = float(np.abs(moved[:2] / moved[2] - corners[:2]).max())
        return min(max(math.ceil(math.log2(max(path_px / FINEST_PX, 1))), 1), MAX_WARPS)
