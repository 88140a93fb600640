"""Corners of the ground, tracked from frame to frame of a drive."""

import math
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from trepid.car.camera import Camera
from trepid.types import Array, Image

CORNERS, QUALITY, APART_PX, LOST_PX = 120, 0.01, 5, 0.3
TOP, ASIDE = 0.06, 0.9  # of the corners: rows below the horizon, columns from the middle [f]
BOTTOM = 0.92  # share of the image height; below, the bonnet may be visible
NEAREST = 0.6  # Δ over the distance of the nearest corners
WINDOW_PX, LEVELS = 15, 2  # of the tracking by Lucas and Kanade


@dataclass(frozen=True)
class GroundInImage:
    """Where the ground is in the image, as far as it is known."""

    camera: Camera  # whose levelled images count; its yaw, height and distortion are not used
    focal_px: float
    focal_height_pxm: float

    @property
    def level(self) -> Array:
        """Homography, shape (3, 3), from pixels to columns right of the middle and rows below the horizon.

        They are those of the same camera without its pitch θ: diag(f, f, 1)·R(θ)·K⁻¹.
        """
        camera = self.camera
        c, s, f = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad), camera.fx_px
        turned = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
        return np.asarray(np.diag([f, f, 1.0]) @ turned @ np.linalg.inv(camera.intrinsics))

    def homography_after(self, way_m: float, turn_rad: float) -> Array:
        """The homography of the ground in the image, from before to after a way and a turn to the left."""
        c, s, f = math.cos(turn_rad), math.sin(turn_rad), self.focal_px
        driven = np.array([[1, 0, 0], [0, 1, 0], [0, -way_m / self.focal_height_pxm, 1.0]])
        turned = np.array([[c, 0, f * s], [0, 1, 0], [-s / f, 0, c]])
        return np.asarray(np.linalg.inv(self.level) @ turned @ driven @ self.level)


@dataclass(frozen=True)
class GroundFlow:
    """Corners of the ground in two frames, in ``Ground.level`` coordinates, and the odometry in between."""

    before_px: Array  # (n, 2)
    after_px: Array  # (n, 2)
    way_m: float
    turn_rad: float | None  # to the left; None where not known
    dt_s: float

    @property
    def nearer(self) -> Array:
        """1/v − 1/v′ [1/px] of every corner; times f·h it is the way that brings the corner there."""
        return np.asarray(1 / self.before_px[:, 1] - 1 / self.after_px[:, 1])


def track_corners(
    before: Image, after: Image, ground: GroundInImage, way_m: float, turn_rad: float | None, dt_s: float
) -> GroundFlow:
    """Corners of the ground in two grey images.

    The second image is warped back by the expected motion, so that the corners keep place and size; without this,
    their growth shifts them by several per cent of their motion. Corners of Shi and Tomasi, tracked forwards and
    backwards by Lucas and Kanade.
    """
    nothing = GroundFlow(np.empty((0, 2)), np.empty((0, 2)), way_m, turn_rad, dt_s)
    found = cv2.goodFeaturesToTrack(
        before, CORNERS, QUALITY, APART_PX, mask=_mask(before.shape, ground, way_m)
    )
    if found is None:
        return nothing
    homography = ground.homography_after(way_m, turn_rad or 0.0)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(
        after, homography, after.shape[1::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    follow = partial(cv2.calcOpticalFlowPyrLK, winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS)
    there, good, _ = follow(before, seen, found, found.copy())
    back, good_back, _ = follow(seen, before, there, found.copy())
    kept = (np.asarray(good) & np.asarray(good_back)).ravel().astype(bool)
    kept &= np.abs(back - found).max(axis=(1, 2)) < LOST_PX
    if not kept.any():
        return nothing
    starts = cv2.perspectiveTransform(found[kept], ground.level)[:, 0]
    ends = cv2.perspectiveTransform(there[kept], ground.level @ homography)[:, 0]
    return GroundFlow(starts.astype(float), ends.astype(float), way_m, turn_rad, dt_s)


def _mask(shape: tuple[int, ...], ground: GroundInImage, way_m: float) -> Image:
    """The part of the image in which corners are tracked."""
    camera, horizon_px = ground.camera, ground.camera.horizon_row_px
    mask = np.zeros(shape, np.uint8)
    bottom = min(BOTTOM * shape[0], horizon_px + NEAREST * ground.focal_height_pxm / way_m)
    left, right = (int(np.clip(camera.cx_px + side * ASIDE * camera.fx_px, 0, shape[1])) for side in (-1, 1))
    mask[max(int(horizon_px + TOP * camera.fy_px), 0) : max(int(bottom), 0), left:right] = 255
    return mask
