"""Yaw rate of a car from its images, without the depth of the scene.

In coordinates x = (u - c_x)/f_x, y = (v - c_y)/f_y a point moves between two frames away from the focus of
expansion (x₀, y₀) by its distance from it over its depth; and all points move by Δψ·p(x, y) + Δθ·q(x, y) as the
camera turns about the vertical and about its right-hand axis. Without the unknown depth

    (Δx - Δψ·p_x - Δθ·q_x)·(y - y₀) = (Δy - Δψ·p_y - Δθ·q_y)·(x - x₀)

which is linear in the two rotations. (x₀, y₀) follows from the camera file; its error appears as a slow turn.
Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, Proc. R. Soc. B 208 (1980). Corners by
Shi and Tomasi, tracked by the method of Lucas and Kanade; robust weights suppress outliers (shadows, other cars,
insects).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from trepid.car.camera import Camera
from trepid.types import Array, Image

CORNERS = 300
LEAST_CORNERS = 8
QUALITY, APART_PX = 0.01, 7
LOST_PX = 0.5  # largest error of a corner tracked forth and back
BONNET_SHARE = 0.9  # rows below this share of the height may show the bonnet
ROUNDS = 5
BEND_ROUNDS = 3
NEAR = 2e-3  # scale of the Cauchy weight: a third of a pixel of a small image
LEAST_STEP_M = 0.1  # below, the distance between frames is noise


def yaw_changes_rad(frames: Sequence[Image], camera: Camera, step_m: Array) -> Array:
    """Change of yaw [rad] from each frame to the next, shape (n - 1,); + = to the left, NaN with too few corners.

    ``step_m`` is the distance driven between them, shape (n - 1,). In a bend the camera, x_m ahead of the rear
    axle, moves inwards by the angle κ·x_m + Δψ/2, and x₀ with it.
    """
    tracks = [_track(a, b, camera) for a, b in pairwise(frames)]
    right, down, ahead = camera.optical_from_vehicle[:, 0]  # direction of travel
    x0, y0 = right / ahead, down / ahead
    inwards = camera.x_m / np.maximum(step_m, LEAST_STEP_M) + 0.5
    turns = [
        _turn_in_bend(track, x0, y0, share) for track, share in zip(tracks, inwards.tolist(), strict=True)
    ]
    return np.array(turns)


def _turn_in_bend(track: "_Track", x0: float, y0: float, inwards: float) -> float:
    """Δψ for a focus of expansion at x₀ - ``inwards``·Δψ."""
    yaw = 0.0
    for _ in range(BEND_ROUNDS):
        yaw = _turn(track, x0 - inwards * yaw, y0)
    return yaw


@dataclass(frozen=True, slots=True)
class _Track:
    """n corners of a frame and their motion to the next, each (n, 2), and the motion per radian of turn."""

    place: Array
    motion: Array
    per_yaw: Array
    per_pitch: Array


def _track(before: Image, after: Image, camera: Camera) -> _Track:
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (before, after)]
    mask = np.full(grey[0].shape, 255, np.uint8)
    mask[int(BONNET_SHARE * len(mask)) :] = 0
    found = cv2.goodFeaturesToTrack(grey[0], CORNERS, QUALITY, APART_PX, mask=mask)
    if found is None:
        return _Track(*np.empty((4, 0, 2)))
    there, good, _ = cv2.calcOpticalFlowPyrLK(grey[0], grey[1], found, found.copy())
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(grey[1], grey[0], there, there.copy())
    kept = (np.asarray(good) & np.asarray(good_back)).ravel().astype(bool)
    kept &= np.abs(back - found).max(axis=(1, 2)) < LOST_PX
    focal_px = np.array([camera.fx_px, camera.fy_px])
    place = (found[kept, 0].astype(float) - [camera.cx_px, camera.cy_px]) / focal_px
    motion = (there - found)[kept, 0].astype(float) / focal_px
    up = camera.optical_from_vehicle[:, 2]
    return _Track(place, motion, _rotating(place, up), _rotating(place, np.array([1.0, 0.0, 0.0])))


def _rotating(place: Array, axis: Array) -> Array:
    """Motion per radian of points at ``place`` as the camera turns about ``axis``: X' = -axis × X, x = X₁/X₃."""
    rays = np.column_stack([place, np.ones(len(place))])
    motion = -np.cross(axis, rays)
    return np.asarray(motion[:, :2] - place * motion[:, 2:])


def _turn(track: _Track, x0: float, y0: float) -> float:
    """Δψ by least squares with Cauchy weights; NaN with too few corners."""
    if len(track.place) < LEAST_CORNERS or not math.isfinite(x0):
        return math.nan
    x, y = (track.place - [x0, y0]).T
    distance = np.hypot(x, y) + NEAR  # so that the residual is one across the ray
    across = np.column_stack([y, -x]) / distance[:, None]
    matrix = np.column_stack([(across * track.per_yaw).sum(axis=1), (across * track.per_pitch).sum(axis=1)])
    wanted = (across * track.motion).sum(axis=1)
    off, yaw = wanted, 0.0
    for _ in range(ROUNDS):
        root = 1.0 / np.hypot(1.0, off / NEAR)
        turn = np.linalg.lstsq(matrix * root[:, None], wanted * root, rcond=None)[0]
        off, yaw = wanted - matrix @ turn, float(turn[0])
    return yaw
