"""Reprojection of images of a flat road to a camera at another pose.

Below the horizon every pixel is a point of the ground plane, and two views of a plane are related by a homography.
Points above the horizon are assumed to be infinitely far away, where two views are related by the rotation alone.
Both agree on the horizon. Bojarski et al., End to End Learning for Self-Driving Cars (2016), sections 4 and 5;
Hartley and Zisserman, Multiple View Geometry (2004), section 13.1. Upright objects are distorted away from the
camera, as in the paper. Pixels outside the recorded image take the value of the nearest recorded pixel; their share
is reported.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from trepid.car.camera import Camera
from trepid.types import Array, Image

NO_SHIFT_M, NO_SHIFT_RAD = 1e-9, 1e-12


@dataclass(frozen=True, slots=True)
class PoseChange:
    """The pose of the new vehicle in the frame of the recorded one (ISO 8855, at the rear axle)."""

    ahead_m: float = 0.0
    left_m: float = 0.0
    yaw_rad: float = 0.0

    @property
    def road_from_road(self) -> Array:
        """Ground points (x, y, 1) of the recorded vehicle from those of the new one, shape (3, 3)."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[cos, -sin, self.ahead_m], [sin, cos, self.left_m], [0.0, 0.0, 1.0]])


class Reprojection:
    """Views of frames of one camera without lens distortion."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._first_ground_row = int(np.clip(math.floor(camera.horizon_row_px) + 1, 0, camera.height_px))

    def ground_matrix(self, shift: PoseChange) -> Array:
        """Homography from pixels of the new view to pixels of the recorded one, for points of the road."""
        pixel_from_road = self.camera.pixel_from_road_matrix
        return np.asarray(pixel_from_road @ shift.road_from_road @ np.linalg.inv(pixel_from_road))

    def sky_matrix(self, shift: PoseChange) -> Array:
        """The same for points that are infinitely far away: K·R·K⁻¹."""
        optical, intrinsics = self.camera.optical_from_vehicle, self.camera.intrinsics
        turn = PoseChange(yaw_rad=shift.yaw_rad).road_from_road
        return np.asarray(intrinsics @ optical @ turn @ optical.T @ np.linalg.inv(intrinsics))

    def view(self, image: Image, shift: PoseChange) -> tuple[Image, float]:
        """The new view of the recorded ``image``, and the share of its pixels outside the recorded image."""
        if max(abs(shift.ahead_m), abs(shift.left_m)) < NO_SHIFT_M and abs(shift.yaw_rad) < NO_SHIFT_RAD:
            return image, 0.0
        seen = self._warp(image, shift, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
        mask = np.full(image.shape[:2], 255, np.uint8)
        covered = self._warp(mask, shift, cv2.INTER_NEAREST, cv2.BORDER_CONSTANT)
        return seen, float(np.mean(covered == 0))

    def _warp(self, image: Image, shift: PoseChange, flags: int, border: int) -> Image:
        """Sky above the horizon, which is level because the camera has no roll, and ground below it."""
        height, width = image.shape[:2]
        split = self._first_ground_row
        down = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, split], [0.0, 0.0, 1.0]])
        parts = [
            cv2.warpPerspective(
                image, matrix, (width, rows), flags=flags | cv2.WARP_INVERSE_MAP, borderMode=border
            )
            for matrix, rows in (
                (self.sky_matrix(shift), split),
                (self.ground_matrix(shift) @ down, height - split),
            )
            if rows > 0
        ]
        return np.concatenate(parts).astype(np.uint8, copy=False)
