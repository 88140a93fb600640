"""Boundaries of a lane as pixels of the input image."""

import math
from functools import lru_cache

import cv2
import numpy as np

from perception.lane.model.geometry import PITCH, LaneState, lane_curve
from trepid.car.camera import Camera
from trepid.messages import PixelPath
from trepid.types import Array

ROW_STEP_PX = 10  # between the places of a boundary that is reported
MAX_ASIDE = 4  # image widths from the middle: edges of a wide road end outside the image
MIN_REACH_M = 5.0
STATIONS_M = np.concatenate([np.arange(-1.0, 20.0, 0.5), np.arange(20.0, 81.0, 2.0)])


def boundary_paths(
    lane: LaneState, camera: Camera, *, reach_m: float, step_px: int = ROW_STEP_PX
) -> tuple[PixelPath, PixelPath]:
    """Both boundaries as pixels of the input image, one every ``step_px`` rows from the bottom up."""
    last = camera.height_px // step_px * step_px  # the lower border of the image
    rows = np.arange(last, -1, -step_px, dtype=float)
    distorted = any(camera.distortion)
    seen_in = np.arange(1.2 * camera.height_px, -1.0, -2.0) if distorted else rows
    left, right = boundary_columns(lane.mean, camera, seen_in, reach_m=reach_m)
    if distorted:
        left, right = (_distorted_columns(columns, seen_in, rows, camera) for columns in (left, right))
    return _path(left, rows, camera.width_px), _path(right, rows, camera.width_px)


def known_reach_m(state: LaneState, reach_m: float, sigma_m: float) -> float:
    """Distance [m] up to which the lane centre is known to ``sigma_m``: at most ``reach_m``, at least 5 m."""
    ahead_m, gradient = _centre_gradient(reach_m)
    variance = (gradient * (state.covariance[:4, :4] @ gradient)).sum(axis=0)
    known = variance <= sigma_m**2
    first = int(known.argmax())
    return float(ahead_m[first]) if known[first] else min(reach_m, MIN_REACH_M)


@lru_cache(maxsize=8)
def _centre_gradient(reach_m: float) -> tuple[Array, Array]:
    """Distances from ``reach_m`` down to 5 m, shape (n,), and d(centre)/d(e, ψ, κ0, κ') there, shape (4, n)."""
    ahead_m = np.arange(reach_m, MIN_REACH_M, -2.0)
    gradient = np.stack([-np.ones_like(ahead_m), -ahead_m, ahead_m**2 / 2, ahead_m**3 / 6])
    return ahead_m, gradient


def _distorted_columns(columns: Array, at_rows: Array, rows: Array, camera: Camera) -> Array:
    """Columns at image rows ``rows`` of a line given in the undistorted image."""
    seen = np.abs(columns - camera.cx_px) < camera.width_px  # False for NaN
    if np.count_nonzero(seen) < 2:
        return np.full(len(rows), np.nan)
    rays = np.column_stack(
        [
            (columns[seen] - camera.cx_px) / camera.fx_px,
            (at_rows[seen] - camera.cy_px) / camera.fy_px,
            np.ones(np.count_nonzero(seen)),
        ]
    )
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.intrinsics, camera.lens)
    u, v = pixels[:, 0, 0], pixels[:, 0, 1]
    return np.interp(-rows, -v, u, left=np.nan, right=np.nan)


def _path(columns: Array, rows: Array, width_px: int) -> PixelPath:
    near = np.abs(columns - width_px / 2) < MAX_ASIDE * width_px  # False for NaN
    return tuple(zip(columns[near].tolist(), rows[near].tolist(), strict=True))


def boundary_columns(mean: Array, camera: Camera, rows_px: Array, *, reach_m: float) -> tuple[Array, Array]:
    """Columns of the left and the right boundary at image rows ``rows_px``; NaN where not visible."""
    curve = lane_curve(mean, STATIONS_M[reach_m + 1e-9 >= STATIONS_M])
    matrix = _pitched_homography(camera, float(mean[PITCH]))
    road = np.stack([curve.real, curve.imag, np.ones_like(curve.real)])
    u, v, depth = (matrix @ road.reshape(3, -1)).reshape(road.shape)
    depth = np.where(depth > 0.3, depth, np.nan)
    u, v = u / depth, v / depth
    return _columns(u[0], v[0], rows_px), _columns(u[1], v[1], rows_px)


def _pitched_homography(camera: Camera, pitch_rad: float) -> Array:
    """Homography to pixels from the road, shape (3, 3), of a camera pitched ``pitch_rad`` further down.

    H = K·[r1 r2 t], and the rotation about the right axis of the camera multiplies [r1 r2 t] by
    ((1, 0, 0), (0, cos, −sin), (0, sin, cos)) from the left: ahead' = cos·ahead + sin·down.
    """
    cos, sin = math.cos(pitch_rad), math.sin(pitch_rad)
    intrinsics, rays = _rays_from_road(camera)
    right, down, ahead = rays
    return intrinsics @ np.array([right, cos * down - sin * ahead, sin * down + cos * ahead])


@lru_cache(maxsize=8)
def _rays_from_road(camera: Camera) -> tuple[Array, Array]:
    """K and [r1 r2 t] of a camera, shapes (3, 3)."""
    rays = np.linalg.solve(camera.intrinsics, camera.pixel_from_road_matrix)
    return camera.intrinsics, np.asarray(rays, np.float64)


def _columns(u: Array, v: Array, rows_px: Array) -> Array:
    """Columns at ``rows_px`` of a line of pixels, near to far, NaN behind the camera; its rising part only."""
    highest = np.fmin.accumulate(v)
    rising = ~np.isnan(v)
    rising[1:] &= ~(v[1:] >= highest[:-1])  # before the first visible one there is only NaN
    if np.count_nonzero(rising) < 2:
        return np.full(len(rows_px), np.nan)
    return np.interp(-rows_px, -v[rising], u[rising], left=np.nan, right=np.nan)
