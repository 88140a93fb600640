"""The road by image rows: for a camera without roll, each row is one distance on a flat road.

Along a row the lateral place on the road is linear in the column, so a metric window ("a line 12 cm wide") is
an exact box in the row: the perspective needs no image warp, only a row-dependent scale.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trepid.car.camera import Camera
from trepid.types import Array


@dataclass(frozen=True)
class LateralGrid:
    """Bands of image rows below the horizon, and where they lie on the road.

    ``ahead_m`` and ``left_m`` are measured from the foot point of the camera along and across its optical
    axis.
    """

    camera: Camera
    top_px: NDArray[np.int64]  # first row of each band, far to near
    bottom_px: NDArray[np.int64]  # one past its last row
    ahead_m: Array  # distance of the middle of the band
    metre_px: Array  # columns per metre across, in that band

    @cached_property
    def area_m2(self) -> float:
        """Visible road, up to 16 m wide, with each band counted as a metre long; at least 1."""
        return max(1.0, float(np.sum(np.minimum(self.camera.width_px / self.metre_px, 16.0))))

    def vehicle_from_grid(self, ahead_m: Array, left_m: Array) -> tuple[Array, Array]:
        """Places (x, y) [m] in the vehicle frame: turned by the yaw, moved to the mounting of the camera."""
        cos, sin = math.cos(self.camera.yaw_rad), math.sin(self.camera.yaw_rad)
        return (
            self.camera.x_m + cos * ahead_m - sin * left_m,
            self.camera.y_m + sin * ahead_m + cos * left_m,
        )


def row_places(camera: Camera, rows_px: Array) -> tuple[Array, Array]:
    """Distance ahead of the foot point and depth along the optical axis [m] of the road in image rows.

    The ray through row v is inclined by α = pitch + atan((v − cy)/fy) below the horizon, so a flat road is
    hit h/tan α ahead, at the depth h·cos(α − pitch)/sin α. Rows at and above the horizon are at infinity.
    """
    below = np.arctan((rows_px - camera.cy_px) / camera.fy_px)
    alpha = np.where(camera.pitch_down_rad + below > 1e-6, camera.pitch_down_rad + below, np.nan)
    ahead, depth = camera.height_m / np.tan(alpha), camera.height_m * np.cos(below) / np.sin(alpha)
    return np.nan_to_num(ahead, nan=np.inf), np.nan_to_num(depth, nan=np.inf)


def lateral_grid(camera: Camera, *, reach_m: float, band_m: float, max_band_px: int) -> LateralGrid:
    """Bands from ``reach_m`` ahead down to the last row, each one row or ``band_m`` [m] of road high."""
    ahead = row_places(camera, np.arange(camera.height_px, dtype=float))[0].tolist()
    tops, bottoms = [], []
    row = next((row for row, ahead_m in enumerate(ahead) if ahead_m <= reach_m), camera.height_px)
    while row < camera.height_px:
        pixel_m = ahead[row] - ahead[row + 1] if row + 1 < camera.height_px else band_m
        height = min(max(int(band_m / max(pixel_m, 1e-6)), 1), max_band_px)
        tops.append(row)
        bottoms.append(min(row + height, camera.height_px))
        row += height
    top, bottom = np.array(tops, np.int64), np.array(bottoms, np.int64)
    ahead_m, depth = row_places(camera, (top + bottom - 1) / 2)
    return LateralGrid(
        camera=camera, top_px=top, bottom_px=bottom, ahead_m=ahead_m, metre_px=camera.fx_px / depth
    )
