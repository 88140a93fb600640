"""The pinhole camera on the vehicle and the flat road below it.

Frames: *road* is the vehicle frame on the ground (origin below the rear axle, x forward, y left); *pixel* is
the undistorted image (u right, v down). A function named ``a_from_b`` takes b and returns a.

Hartley and Zisserman, Multiple View Geometry (2004), chapters 6 and 8.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from trepid.config import Settings
from trepid.types import Array, Positive

PITCH_BOUND_RAD = 1.2  # of a camera that looks along the road


class Camera(Settings):
    """Intrinsics of the working image and the mounting on the vehicle (``config/camera.yaml``)."""

    width_px: Annotated[int, Field(ge=16)]
    height_px: Annotated[int, Field(ge=16)]
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    distortion: Annotated[tuple[float, ...], Field(max_length=8)] = ()  # k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV
    x_m: float  # ahead of the rear axle
    y_m: float  # left of the centre line
    height_m: Positive
    pitch_down_rad: Annotated[float, Field(gt=-PITCH_BOUND_RAD, lt=PITCH_BOUND_RAD)]
    yaw_rad: float

    @model_validator(mode="before")
    @classmethod
    def _of_ros(cls, data: Any) -> Any:
        """Raises ValueError for the fields of a camera_info of ROS."""
        if isinstance(data, Mapping) and {"camera_matrix", "distortion_model"} & data.keys():
            raise ValueError("is a camera_info of ROS; `trepid camera import` makes a camera file of it")
        return data

    @property
    def intrinsics(self) -> Array:
        """K, shape (3, 3)."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])

    @property
    def lens(self) -> Array:
        """The distortion with zeros for terms that are left out, shape (5,) or (8,): OpenCV takes these."""
        count = 5 if len(self.distortion) <= 5 else 8
        return np.array((*self.distortion, *[0.0] * (count - len(self.distortion))), np.float64)

    @property
    def optical_from_vehicle(self) -> Array:
        """Rotation, shape (3, 3), from vehicle axes (forward, left, up) to optical (right, down, ahead)."""
        cp, sp = math.cos(self.pitch_down_rad), math.sin(self.pitch_down_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ahead = np.array([cp * cy, cp * sy, -sp])
        left = np.array([-sy, cy, 0.0])
        return np.stack([-left, np.cross(ahead, -left), ahead])

    @property
    def pixel_from_road_matrix(self) -> Array:
        """Homography from road points (x, y, 1) [m] to homogeneous pixels, shape (3, 3)."""
        rotation = self.optical_from_vehicle
        position = np.array([self.x_m, self.y_m, self.height_m])
        return self.intrinsics @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ position])

    @property
    def horizon_row_px(self) -> float:
        """Image row of the horizon of a flat road straight ahead."""
        return self.cy_px - self.fy_px * math.tan(self.pitch_down_rad)

    def pixel_from_road(self, road_m: ArrayLike) -> Array:
        """Pixels, shape (n, 2), of road points (x, y) [m], shape (n, 2); NaN for points behind the camera."""
        points = np.atleast_2d(np.asarray(road_m, float))
        u, v, depth = self.pixel_from_road_matrix @ np.column_stack([points, np.ones(len(points))]).T
        depth = np.where(depth > 1e-6, depth, np.nan)
        return np.column_stack([u / depth, v / depth])

    def road_from_pixel(self, pixel: ArrayLike) -> Array:
        """Road points (x, y) [m], shape (n, 2), of pixels, shape (n, 2); NaN at and above the horizon."""
        points = np.atleast_2d(np.asarray(pixel, float))
        ray = self.optical_from_vehicle.T @ np.linalg.solve(
            self.intrinsics, np.column_stack([points, np.ones(len(points))]).T
        )
        reach = self.height_m / np.where(ray[2] < -1e-9, -ray[2], np.nan)
        return np.column_stack([self.x_m + reach * ray[0], self.y_m + reach * ray[1]])

    def resize(self, width_px: int, height_px: int) -> "Camera":
        """The same camera with its image resized as ``cv2.resize`` does it.

        Whole numbers are the centres of pixels, and the corner of the image, at (−½, −½), stays where it is:
        u' + ½ = s·(u + ½), so f' = s·f and c' = s·(c + ½) − ½.
        """
        sx, sy = width_px / self.width_px, height_px / self.height_px
        lens = dict(
            fx_px=self.fx_px * sx,
            fy_px=self.fy_px * sy,
            cx_px=(self.cx_px + 0.5) * sx - 0.5,
            cy_px=(self.cy_px + 0.5) * sy - 0.5,
        )
        return self.model_copy(update=dict(width_px=width_px, height_px=height_px, **lens))
