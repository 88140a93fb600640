"""Segments that run along a road, and the one point that they all point at."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.camera import Camera
from trepid.config import InputError
from trepid.types import Array, Image

LEAST_SEGMENT = 0.03  # of the width of the picture
UPRIGHT = 0.12  # rise over length: level segments are shadows, kerbs across, the horizon
GUESSES = 400  # pairs of segments whose crossing is tried
NEAR_RAD, SHARP_RAD = 0.05, 0.006  # segments farther off are none of the road's; how straight LSD's are
ROUNDS = 12
LEAST_SEGMENTS = 4  # in a frame
LEAST_SHARE = 0.3  # of all segments' length points to one place; grass and gravel have 0.10 to 0.25
BONNET_SHARE = 0.92  # below this share of the height the car may see itself


@dataclass(frozen=True)
class Lines:
    """Segments of a picture."""

    middle_px: Array  # (n, 2)
    direction: Array  # (n, 2), unit, pointing up
    length_px: Array  # (n,)

    def part(self, chosen: NDArray[np.bool_]) -> "Lines":
        """Those where ``chosen``, shape (n,), is true."""
        return Lines(self.middle_px[chosen], self.direction[chosen], self.length_px[chosen])

    def off_rad(self, point_px: Array) -> Array:
        """Angle between each and the way from its middle to a point; π where it lies above the point."""
        to = point_px - self.middle_px
        distance = np.hypot(*to.T) + 1e-9
        sine = (to[:, 0] * self.direction[:, 1] - to[:, 1] * self.direction[:, 0]) / distance
        below = (to * self.direction).sum(axis=1) > 0
        return np.where(below, np.arcsin(np.clip(sine, -1, 1)), np.pi)


def joined(frames: Sequence[Lines]) -> Lines:
    return Lines(
        np.concatenate([lines.middle_px for lines in frames]),
        np.concatenate([lines.direction for lines in frames]),
        np.concatenate([lines.length_px for lines in frames]),
    )


def upright(image: Image, camera: Camera) -> Lines:
    """Segments that may run along the road: LSD (Grompone von Gioi et al., IPOL 2012), long and not level."""
    found = cv2.createLineSegmentDetector().detect(grey_of(image, camera))[0]
    ends = np.empty((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)
    start, end = ends[:, :2], ends[:, 2:]
    span = end - start
    span *= np.where(span[:, 1] > 0, -1.0, 1.0)[:, None]
    length_px = np.hypot(*span.T)
    direction = span / np.maximum(length_px, 1e-9)[:, None]
    middle_px = (start + end) / 2
    chosen = (length_px > LEAST_SEGMENT * camera.width_px) & (np.abs(direction[:, 1]) > UPRIGHT)
    chosen &= middle_px[:, 1] < BONNET_SHARE * camera.height_px
    return Lines(middle_px, direction, length_px).part(chosen)


def grey_of(image: Image, camera: Camera) -> Image:
    """The picture in grey without lens distortion."""
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    if not any(camera.distortion):
        return grey
    return np.asarray(cv2.undistort(grey, camera.intrinsics, np.array(camera.distortion)), np.uint8)


def most_pointed_at(lines: Lines, camera: Camera) -> Array:
    """Of the crossings of pairs of segments the one that most length points at. Raises InputError."""
    rng = np.random.default_rng(0)
    first, second = rng.integers(len(lines.length_px), size=(2, GUESSES))
    crossings = _crossings(lines, first, second)
    inside = (np.abs(crossings / [camera.width_px, camera.height_px] - 0.5) < 0.5).all(axis=1)
    crossings = crossings[inside]
    if not len(crossings):
        raise InputError("no lines that meet within the picture: is a straight road to be seen?")
    votes = [
        float((lines.length_px * np.exp(-0.5 * (lines.off_rad(point) / (NEAR_RAD / 2)) ** 2)).sum())
        for point in crossings
    ]
    best = np.asarray(crossings[int(np.argmax(votes))])
    share = lines.length_px[np.abs(lines.off_rad(best)) < NEAR_RAD].sum() / lines.length_px.sum()
    if share < LEAST_SHARE:
        raise InputError(
            f"only {100 * share:.0f} % of the lines in sight meet in one place, {100 * LEAST_SHARE:.0f} % expected:"
            " a straight road with lines or sharp edges is needed"
        )
    return best


def _crossings(lines: Lines, first: NDArray[np.int64], second: NDArray[np.int64]) -> Array:
    """Where pairs of segments meet, shape (m, 2); far away where they hardly do."""
    p, q, d, e = (
        lines.middle_px[first],
        lines.middle_px[second],
        lines.direction[first],
        lines.direction[second],
    )
    turn = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    turn = np.where(np.abs(turn) < 0.05, np.nan, turn)
    along = ((q - p)[:, 0] * e[:, 1] - (q - p)[:, 1] * e[:, 0]) / turn
    return np.asarray(np.nan_to_num(p + along[:, None] * d, nan=1e9))


def refined(lines: Lines, start_px: Array, camera: Camera) -> Array | None:
    """Where the lines of a frame meet, near ``start_px``: least squares of angles with Cauchy weights.

    A segment's angle is as good as it is long. None with too few of them, or all on one side.
    """
    near = lines.part(np.abs(lines.off_rad(start_px)) < NEAR_RAD)
    sides = near.direction[:, 0] > 0
    if len(sides) < LEAST_SEGMENTS or sides.all() or not sides.any():
        return None
    normal = np.column_stack([near.direction[:, 1], -near.direction[:, 0]])
    wanted = (normal * near.middle_px).sum(axis=1)
    point = start_px
    for _ in range(ROUNDS):
        distance = np.hypot(*(point - near.middle_px).T) + 1.0
        weight = near.length_px / distance / np.hypot(1.0, near.off_rad(point) / SHARP_RAD)
        point = np.linalg.lstsq(normal * weight[:, None], wanted * weight, rcond=None)[0]
    far = np.hypot(*(point - start_px)) > 0.2 * camera.width_px
    return None if far else np.asarray(point)


def turn(u_px: float, v_px: float, camera: Camera) -> dict[str, float]:
    """Pitch and yaw with which straight ahead lies at a pixel."""
    pitch_rad = math.atan((camera.cy_px - v_px) / camera.fy_px)
    yaw_rad = math.atan((u_px - camera.cx_px) / camera.fx_px * math.cos(pitch_rad))
    return {"pitch_down_rad": pitch_rad, "yaw_rad": yaw_rad}
