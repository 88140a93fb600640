"""The middle of the lane as points on the ground, from the rear axle to the farthest distance that counts."""

import math
from typing import NamedTuple

import numpy as np

from trepid.clothoid import Lane
from trepid.messages import SteeringEstimate
from trepid.types import Array

STEP_M = 2.0  # between two points
LEAST_DEPTH_M = 0.1


class Path(NamedTuple):
    """Points along the lane: way from the rear axle and place [m], column in the image, (n,) each."""

    way_m: Array
    x_m: Array
    y_m: Array
    column_px: Array  # NaN behind the camera

    def column_at(self, x_m: Array) -> Array:
        """Column of the lane at ``x_m`` ahead [px]."""
        end = int(np.argmax(self.x_m))
        return np.interp(x_m, self.x_m[: end + 1], self.column_px[: end + 1])

    def left_m(self, x_m: Array) -> Array:
        """Lateral place of the lane at ``x_m`` ahead [m]; at places that it does not reach, that of its end."""
        end = int(np.argmax(self.x_m))  # a lane that turns back has two places at one x: the first one counts
        return np.interp(x_m, self.x_m[: end + 1], self.y_m[: end + 1])


def path_of(
    estimate: SteeringEstimate | None, pixel_from_road: Array, *, reach_m: float, known_m: float
) -> Path:
    """The lane of ``estimate`` up to ``reach_m``; straight ahead without a lane.

    ``pixel_from_road``: the homography of the camera (:class:`trepid.car.camera.Camera`).

    The clothoid is followed up to ``known_m``, where its rate of curvature still says something, and beyond it the
    arc with the curvature there: θ' = κ(s), x' = cos θ, y' = sin θ, by the midpoint rule.
    """
    way_m = np.arange(0.0, reach_m + STEP_M, STEP_M)
    lane = None if estimate is None else Lane.of_message(estimate, known_m=known_m)
    if lane is None or not all(map(math.isfinite, lane[:4])):
        x_m, y_m = way_m, np.zeros_like(way_m)
        return Path(way_m, x_m, y_m, _columns(pixel_from_road, x_m, y_m))
    middle_m = np.minimum(way_m[:-1] + STEP_M / 2, known_m)
    bend_1pm = lane.curvature_1pm + lane.curvature_rate_1pm2 * middle_m
    turned_rad = np.cumsum(bend_1pm * STEP_M)
    heading_rad = -lane.heading_rad + turned_rad - bend_1pm * STEP_M / 2
    x_m = np.concatenate([[0.0], np.cumsum(np.cos(heading_rad)) * STEP_M])
    y_m = -lane.offset_m + np.concatenate([[0.0], np.cumsum(np.sin(heading_rad)) * STEP_M])
    return Path(way_m, x_m, y_m, _columns(pixel_from_road, x_m, y_m))


def _columns(pixel_from_road: Array, x_m: Array, y_m: Array) -> Array:
    u, _, depth = pixel_from_road @ np.stack([x_m, y_m, np.ones_like(x_m)])
    return np.where(depth > LEAST_DEPTH_M, u / np.maximum(depth, LEAST_DEPTH_M), np.nan)
