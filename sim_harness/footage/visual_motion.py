"""Motion of a car from its images: yaw rate without the depth of the scene, speed by the ground ahead.

Yaw rate: in coordinates x = (u - c_x)/f_x, y = (v - c_y)/f_y a point moves between two frames away from the focus
of expansion (x₀, y₀) by its distance from it over its depth; and all points move by Δψ·p(x, y) + Δθ·q(x, y) as the
camera turns about the vertical and about its right-hand axis. Without the unknown depth

    (Δx - Δψ·p_x - Δθ·q_x)·(y - y₀) = (Δy - Δψ·p_y - Δθ·q_y)·(x - x₀)

which is linear in the two rotations. (x₀, y₀) follows from the camera file; its error appears as a slow turn.
Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, Proc. R. Soc. B 208 (1980). Corners by
Shi and Tomasi, tracked by the method of Lucas and Kanade; robust weights suppress outliers (shadows, other cars,
insects, the own bonnet). Their scale begins wide and narrows from round to round (graduated non-convexity; Blake
and Zisserman, Visual Reconstruction, 1987): with a narrow one from the start, ten corners that stand still on the
bonnet outweigh eighty that turn.

Speed: relative to the horizon row a point of the ground at the distance x lies at v = f·h/x, so that the way
between two frames is Δ = f·h·(1/v − 1/v′) (:mod:`perception.camera.ground_flow`). It has the scale of the camera's
height h: with an assumed camera these are the metres of its world.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from perception.camera.grey import grey
from perception.camera.ground_flow import GroundInImage, track_corners
from trepid.car.camera import Camera
from trepid.types import Array, Image

CORNERS = 300
LEAST_CORNERS = 8
QUALITY, APART_PX = 0.01, 7
LOST_PX = 0.5  # largest error of a corner tracked forth and back
BONNET_SHARE = 0.9  # rows below this share of the height may show the bonnet
BEND_ROUNDS = 3
NEAR = 2e-3  # last scale of the Cauchy weight: a third of a pixel of a small image
SCALES = 0.1, 0.03, 0.01, 0.004, NEAR, NEAR  # of the rounds; few cars turn more than the first
LEAST_STEP_M = 0.1  # below, the distance between frames is noise
SPEEDS_HPS = np.geomspace(0.5, 30.0, 24)  # [heights of the camera per second] that are tried
LOOKS = 24  # pairs of frames, spread over the drive
NEAR_SHARE = 0.2  # share of the tried way by which a corner may differ


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
    both = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (before, after)]
    mask = np.full(both[0].shape, 255, np.uint8)
    mask[int(BONNET_SHARE * len(mask)) :] = 0
    found = cv2.goodFeaturesToTrack(both[0], CORNERS, QUALITY, APART_PX, mask=mask)
    if found is None:
        return _Track(*np.empty((4, 0, 2)))
    there, good, _ = cv2.calcOpticalFlowPyrLK(both[0], both[1], found, found.copy())
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(both[1], both[0], there, there.copy())
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
    for scale in SCALES:
        root = 1.0 / np.hypot(1.0, off / scale)
        turn = np.linalg.lstsq(matrix * root[:, None], wanted * root, rcond=None)[0]
        off, yaw = wanted - matrix @ turn, float(turn[0])
    return yaw


def speed_mps(frames: Sequence[Image], t_s: Array, camera: Camera) -> float | None:
    """The speed [m/s] at which most corners of the ground move; None where none do.

    The median of the corners that are tracked from that speed.
    """
    pairs = np.unique(np.linspace(0, len(frames) - 2, LOOKS).astype(int)).tolist()
    found = [
        _speeds_mps(frames, t_s, camera, pairs, share * camera.height_m) for share in SPEEDS_HPS.tolist()
    ]
    best = max(found, key=len)
    return float(np.median(best)) if len(best) else None


def _speeds_mps(
    frames: Sequence[Image], t_s: Array, camera: Camera, pairs: Sequence[int], tried_mps: float
) -> Array:
    """Speeds of the corners that agree with the tried one."""
    fh, speeds = camera.fx_px * camera.height_m, []
    for first in pairs:
        dt_s = float(t_s[first + 1] - t_s[first])
        before, after = grey(frames[first]), grey(frames[first + 1])
        moved = track_corners(
            before, after, GroundInImage(camera, camera.fx_px, fh), tried_mps * dt_s, None, dt_s
        )
        speeds.append(fh * moved.nearer[moved.after_px[:, 1] > 0] / dt_s)
    every = np.concatenate(speeds) if speeds else np.empty(0)
    return every[np.abs(every / tried_mps - 1) < NEAR_SHARE]
