"""The height of a camera above the road from a known length on it.

An image gives lengths on the road in heights of the camera. The known width of the lane, or the known
distance driven between two frames, gives the height in metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.camera.ground_flow import GroundInImage, track_corners
from perception.camera.road_lines import SHARP_RAD, Segments, pitch_and_yaw, undistort
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.types import Array, Image

MIN_FRAMES = 5
SIDE_H, STEP_H, BLUR_H = 3.5, 0.01, 0.1  # across the road, in heights of the camera
SWAY_H = 0.25  # largest distance of a line from its mean place
MIN_ASIDE_H, MIN_PEAK = 0.15, 0.1  # of a line from the middle; of a peak over the highest one
MAX_OFF_CENTRE = 0.2  # of the camera from the middle of the lane, over its width
MAX_SPREAD = 0.1  # of the widths or distances: between quartiles, over the median
MIN_CORNERS = 10


@dataclass(frozen=True)
class Step:
    """A frame, the next one, and the distance driven between them; None where not known."""

    image: Image
    following: Image | None = None
    way_m: float | None = None


def height(
    steps: Sequence[Step], kept: Sequence[tuple[Segments, Array]], camera: Camera, lane_width_m: float | None
) -> tuple[float, str, float | None]:
    """The height [m], its source and its relative uncertainty."""
    if lane_width_m is not None:
        widths = _lane_widths_h([_Across.of(lines, point, camera) for lines, point in kept])
        width, doubt = _median_and_spread(widths, "the lane between two lines")
        return lane_width_m / width, "the width of the lane", doubt
    driven = [step for step in steps if step.way_m is not None and step.following is not None]
    if not driven:
        return camera.height_m, "the camera file", None
    heights = [found for step in driven if step.way_m and (found := _height_m(step, camera)) is not None]
    height_m, doubt = _median_and_spread(heights, "the ground moving between two frames")
    return height_m, "the speed", doubt


def _median_and_spread(values: list[float], what: str) -> tuple[float, float]:
    """The median, and half of the interquartile range over it. Raises InputError."""
    if len(values) < MIN_FRAMES:
        raise InputError(f"{what} is visible in {len(values)} frames, {MIN_FRAMES} expected")
    low, middle, high = np.percentile(values, (25, 50, 75)).tolist()
    if (high - low) / middle > MAX_SPREAD:
        raise InputError(
            f"{what} differs by {100 * (high - low) / middle:.0f} % from frame to frame,"
            f" {100 * MAX_SPREAD:.0f} % allowed"
        )
    return middle, (high - low) / 2 / middle


@dataclass(frozen=True)
class _Across:
    """Segments along the road in a frame: lateral places [heights of the camera] and lengths."""

    aside_h: Array
    length_px: Array

    @classmethod
    def of(cls, lines: Segments, vanishing_px: Array, camera: Camera) -> "_Across":
        """The segments that point to the vanishing point of their frame."""
        u_px, v_px = vanishing_px.tolist()
        level = {"height_m": 1.0, "x_m": 0.0, "y_m": 0.0}
        own = camera.model_copy(update=pitch_and_yaw(u_px, v_px, camera) | level)
        along = lines.part(np.abs(lines.angle_to_rad(vanishing_px)) < 2 * SHARP_RAD)
        aside = own.road_from_pixel(along.middle_px)[:, 1]
        known = np.isfinite(aside)
        return cls(aside[known], along.length_px[known])

    def near(self, place_h: float) -> float | None:
        """Mean place of the segments near a place; None without any."""
        close = np.abs(self.aside_h - place_h) < SWAY_H
        return float(np.average(self.aside_h[close], weights=self.length_px[close])) if close.any() else None


def _lane_widths_h(frames: Sequence[_Across]) -> list[float]:
    """Widths of the lane [heights of the camera] in the frames with both lines next to the middle.

    The places of these lines are those of all frames together, because a single frame may show no dash of a
    line. Raises InputError when a line seems to be missing.
    """
    aside = np.concatenate([frame.aside_h for frame in frames])
    length = np.concatenate([frame.length_px for frame in frames])
    grid = np.arange(-SIDE_H, SIDE_H + STEP_H, STEP_H)
    density = np.exp(-0.5 * ((grid[:, None] - aside) / BLUR_H) ** 2) @ length
    inner, floor = density[1:-1], MIN_PEAK * density.max()
    peaks = grid[1:-1][(inner >= density[:-2]) & (inner > density[2:]) & (inner > floor)]
    left, right = peaks[peaks > MIN_ASIDE_H], peaks[peaks < -MIN_ASIDE_H]
    if not len(left) or not len(right):
        return []
    if abs(left.min() + right.max()) / 2 > MAX_OFF_CENTRE * (left.min() - right.max()):
        raise InputError(
            "the camera is far from the middle between the two lines next to it: one line may be missing"
        )
    pairs = [(frame.near(float(left.min())), frame.near(float(right.max()))) for frame in frames]
    return [one - other for one, other in pairs if one is not None and other is not None]


def _height_m(step: Step, camera: Camera) -> float | None:
    """Height of ``camera`` by the median corner of the ground; None with too few of them.

    Relative to the horizon row v = f·h/x, so that h = Δ/(f·(1/v − 1/v′)) over the way Δ.
    """
    if step.way_m is None or step.following is None:
        return None
    before, after = (undistort(image, camera) for image in (step.image, step.following))
    ground = GroundInImage(camera, camera.fx_px, camera.fx_px * camera.height_m)
    moved = track_corners(before, after, ground, step.way_m, None, 0.0)
    ways_h = camera.fx_px * moved.nearer
    ways_h = ways_h[ways_h > 0]
    return step.way_m / float(np.median(ways_h)) if len(ways_h) >= MIN_CORNERS else None
