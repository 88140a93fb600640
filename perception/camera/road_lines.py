"""Line segments of an image, those along a road, and the vanishing point at which they meet."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.grey import grey
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.types import Array, Image, Mask

MIN_SEGMENT = 0.03  # length over the width of the image
MIN_RISE = 0.12  # rise over length; flatter segments are shadows, kerbs across the road, the horizon
GUESSES = 400  # pairs of segments whose crossing is tested
NEAR_RAD, SHARP_RAD = 0.05, 0.006  # limit of the angle of a segment of the road; accuracy of LSD
ROUNDS = 12  # of iteratively reweighted least squares
MIN_SEGMENTS = 4  # in a frame
MIN_SHARE = 0.3  # of the length of all segments that points to one place
BONNET_SHARE = 0.92  # below this share of the image height the vehicle itself may be visible


class Segments(NamedTuple):
    """Line segments of an image."""

    middle_px: Array  # (n, 2)
    direction: Array  # (n, 2), unit vectors pointing up
    length_px: Array  # (n,)

    def part(self, chosen: Mask) -> "Segments":
        """The segments where ``chosen``, shape (n,), is true."""
        return Segments(*(values[chosen] for values in self))

    def angle_to_rad(self, point_px: Array) -> Array:
        """Angle between each segment and the ray from its middle to a point; π for a segment above the point."""
        to = point_px - self.middle_px
        distance = np.hypot(*to.T) + 1e-9
        sine = (to[:, 0] * self.direction[:, 1] - to[:, 1] * self.direction[:, 0]) / distance
        below = (to * self.direction).sum(axis=1) > 0
        return np.where(below, np.arcsin(np.clip(sine, -1, 1)), np.pi)


def segments(grey: Image) -> Segments:
    """All segments of a grey image: Grompone von Gioi et al., LSD: a Line Segment Detector, IPOL 2012."""
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    ends = np.empty((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)
    start, end = ends[:, :2], ends[:, 2:]
    span = end - start
    span *= np.where(span[:, 1] > 0, -1.0, 1.0)[:, None]
    length_px = np.hypot(span[:, 0], span[:, 1])
    return Segments((start + end) / 2, span / np.maximum(length_px, 1e-9)[:, None], length_px)


def join_segments(images: Sequence[Segments]) -> Segments:
    """The segments of several images."""
    return Segments(*(np.concatenate(values) for values in zip(*images, strict=True)))


def road_segments(image: Image, camera: Camera) -> Segments:
    """Segments that may run along the road: long, and not level."""
    found = segments(undistort(image, camera))
    chosen = (found.length_px > MIN_SEGMENT * camera.width_px) & (np.abs(found.direction[:, 1]) > MIN_RISE)
    chosen &= found.middle_px[:, 1] < BONNET_SHARE * camera.height_px
    return found.part(chosen)


def undistort(image: Image, camera: Camera) -> Image:
    """``image`` in grey without lens distortion."""
    if not any(camera.distortion):
        return grey(image)
    return np.asarray(cv2.undistort(grey(image), camera.intrinsics, camera.lens), np.uint8)


def common_point(lines: Segments, camera: Camera) -> Array:
    """The crossing of a pair of segments to which the most segment length points [px]. Raises InputError."""
    rng = np.random.default_rng(0)
    first, second = rng.integers(len(lines.length_px), size=(2, GUESSES))
    crossings = _crossings(lines, first, second)
    inside = (np.abs(crossings / [camera.width_px, camera.height_px] - 0.5) < 0.5).all(axis=1)
    crossings = crossings[inside]
    if not len(crossings):
        raise InputError("no lines meet inside the image; a straight road must be visible")
    votes = [
        float((lines.length_px * np.exp(-0.5 * (lines.angle_to_rad(point) / (NEAR_RAD / 2)) ** 2)).sum())
        for point in crossings
    ]
    best = np.asarray(crossings[int(np.argmax(votes))])
    share = lines.length_px[np.abs(lines.angle_to_rad(best)) < NEAR_RAD].sum() / lines.length_px.sum()
    if share < MIN_SHARE:
        raise InputError(
            f"only {100 * share:.0f} % of the lines in the image meet in one point, {100 * MIN_SHARE:.0f} %"
            " expected; a straight road with lines or sharp edges is needed"
        )
    return best


def _crossings(lines: Segments, first: NDArray[np.int64], second: NDArray[np.int64]) -> Array:
    """Crossings of pairs of segments, shape (m, 2); far away for nearly parallel ones."""
    p, q = lines.middle_px[first], lines.middle_px[second]
    d, e = lines.direction[first], lines.direction[second]
    turn = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    turn = np.where(np.abs(turn) < 0.05, np.nan, turn)
    along = ((q - p)[:, 0] * e[:, 1] - (q - p)[:, 1] * e[:, 0]) / turn
    return np.asarray(np.nan_to_num(p + along[:, None] * d, nan=1e9))


def meeting_point(lines: Segments, start_px: Array, camera: Camera) -> Array | None:
    """The point at which the segments of a frame meet: near ``start_px``, else elsewhere on the same horizon.

    A frame in which the vehicle heads elsewhere has its point aside of that of the other frames. It must not be
    left out, because the frames that remain would sway less than the drive.
    """
    point = refine_point(lines, start_px, camera)
    if point is not None:
        return point
    try:
        own_px = common_point(lines, camera)
    except InputError:
        return None
    level = abs(own_px[1] - start_px[1]) < NEAR_RAD * camera.fy_px
    return refine_point(lines, own_px, camera) if level else None


def refine_point(lines: Segments, start_px: Array, camera: Camera) -> Array | None:
    """The point near ``start_px`` at which the segments of a frame meet: least squares of angles, Cauchy weights.

    The angle of a segment is weighted by its length. None with too few segments, or with all on one side.
    """
    near = lines.part(np.abs(lines.angle_to_rad(start_px)) < NEAR_RAD)
    sides = near.direction[:, 0] > 0
    if len(sides) < MIN_SEGMENTS or sides.all() or not sides.any():
        return None
    normal = np.column_stack([near.direction[:, 1], -near.direction[:, 0]])
    target = (normal * near.middle_px).sum(axis=1)
    point = start_px
    for _ in range(ROUNDS):
        distance = np.hypot(*(point - near.middle_px).T) + 1.0
        weight = near.length_px / distance / np.hypot(1.0, near.angle_to_rad(point) / SHARP_RAD)
        point = np.linalg.lstsq(normal * weight[:, None], target * weight, rcond=None)[0]
    far = np.hypot(*(point - start_px)) > 0.2 * camera.width_px
    return None if far else np.asarray(point)


def pitch_and_yaw(u_px: float, v_px: float, camera: Camera) -> dict[str, float]:
    """Pitch and yaw of a camera with the vanishing point of straight ahead at a pixel."""
    pitch_rad = math.atan((camera.cy_px - v_px) / camera.fy_px)
    yaw_rad = math.atan((u_px - camera.cx_px) / camera.fx_px * math.cos(pitch_rad))
    return {"pitch_down_rad": pitch_rad, "yaw_rad": yaw_rad}
