"""The mounting of a camera from driving straight along a lane: pitch, yaw and, with one known length, height.

On a straight road all lines along it meet at one vanishing point. With pitch θ down and yaw ψ to the left of
the direction of driving it lies at

    u = c_x + f_x·tan ψ / cos θ,    v = c_y − f_y·tan θ

(Hartley and Zisserman, Multiple View Geometry, 2004, section 8.6). The mean heading of a vehicle that keeps
its lane is that of the lane, so the median over the frames is a property of the camera. The height follows
from the known width of the lane or the known distance between two frames (:mod:`cockpit.calibration.height`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cockpit.calibration.height import MIN_FRAMES, Step, height
from perception.camera.road_lines import (
    MIN_RISE,
    MIN_SEGMENTS,
    NEAR_RAD,
    ROUNDS,
    Segments,
    common_point,
    join_segments,
    meeting_point,
    pitch_and_yaw,
    road_segments,
)
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.types import Array

MAX_SWAY_RAD = 0.02  # standard deviation of the heading; twice that of lane keeping
WIDE_RAD = 0.35  # from straight ahead; further aside no segment belongs to the road
BEND_OVER_H, MAX_BEND_RAD = 6.0, 0.02  # R = 420 m below a camera at 1.4 m


@dataclass(frozen=True)
class Mounting:
    """The mounting of a camera, and its accuracy."""

    pitch_down_rad: float
    yaw_rad: float
    height_m: float
    frames: int  # with lines of the road
    sway_rad: float  # standard deviation of the heading over them
    height_from: str  # "the width of the lane", "the speed", "the camera file"
    height_doubt: float | None  # half of the interquartile range of the height over the height


def mounting(steps: Sequence[Step], camera: Camera, *, lane_width_m: float | None = None) -> Mounting:
    """Pitch, yaw and height of ``camera`` with known intrinsics.

    The height follows from ``lane_width_m``, between the middles of the lines; without it from the distances
    between frames; without those it stays that of ``camera``. Raises InputError with the reason.
    """
    found = [road_segments(step.image, camera) for step in steps]
    frames = [lines for lines in found if len(lines.length_px) >= MIN_SEGMENTS]
    if len(frames) < MIN_FRAMES:
        raise InputError(
            f"lines along the road in {len(frames)} of {len(steps)} frames, {MIN_FRAMES} expected"
        )
    start = common_point(join_segments(frames), camera)
    points = [meeting_point(lines, start, camera) for lines in frames]
    kept = [(lines, point) for lines, point in zip(frames, points, strict=True) if point is not None]
    if len(kept) < MIN_FRAMES:
        raise InputError(
            f"lines that meet in one point in {len(kept)} of {len(steps)} frames, {MIN_FRAMES} expected"
        )
    vanishing = np.array([point for _, point in kept])
    sway_rad = float(np.std(np.arctan((vanishing[:, 0] - camera.cx_px) / camera.fx_px)))
    if sway_rad > MAX_SWAY_RAD:
        raise InputError(
            f"the vehicle does not drive straight: the heading sways by {math.degrees(sway_rad):.1f}°,"
            f" {math.degrees(MAX_SWAY_RAD):.1f}° allowed"
        )
    _check_straight([lines for lines, _ in kept], vanishing, camera)
    u_px, v_px = np.median(vanishing, axis=0).tolist()
    turned = camera.model_copy(update=pitch_and_yaw(u_px, v_px, camera))
    height_m, source, doubt = height(steps, kept, turned, lane_width_m)
    return Mounting(
        pitch_down_rad=turned.pitch_down_rad,
        yaw_rad=turned.yaw_rad,
        height_m=height_m,
        frames=len(kept),
        sway_rad=sway_rad,
        height_from=source,
        height_doubt=doubt,
    )


def _check_straight(frames: Sequence[Segments], vanishing: Array, camera: Camera) -> None:
    """Raises InputError for a bend.

    On a bend the heading of the road at the distance d is κ·d. Fits a line, by least squares with Cauchy
    weights, to the crossing of each extended segment with the horizon over the distance of its middle.
    """
    aside: list[Array] = []
    ahead: list[Array] = []
    length: list[Array] = []
    for lines, (u_px, v_px) in zip(frames, vanishing, strict=True):
        below_px = lines.middle_px[:, 1] - v_px
        rise = np.maximum(-lines.direction[:, 1], MIN_RISE)
        meets_px = lines.middle_px[:, 0] + lines.direction[:, 0] / rise * below_px
        known = (below_px > 0.03 * camera.height_px) & (np.abs(meets_px - u_px) < WIDE_RAD * camera.fx_px)
        aside.append((meets_px[known] - u_px) / camera.fx_px)
        ahead.append(camera.fy_px / below_px[known])
        length.append(lines.length_px[known] / ahead[-1])
    y, x, weight = np.concatenate(aside), np.concatenate(ahead), np.concatenate(length)
    matrix = np.column_stack([np.ones_like(x), x])
    line: Array = np.zeros(2)
    for _ in range(ROUNDS):
        root = weight / np.hypot(1.0, (y - matrix @ line) / NEAR_RAD)
        line = np.asarray(np.linalg.lstsq(matrix * root[:, None], y * root, rcond=None)[0])
    bend_rad = abs(float(line[1])) * BEND_OVER_H
    if bend_rad > MAX_BEND_RAD:
        raise InputError(
            f"the road is not straight: it turns by {math.degrees(bend_rad):.1f}° in view,"
            f" {math.degrees(MAX_BEND_RAD):.1f}° allowed"
        )
