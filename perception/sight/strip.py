"""The ground along the lane: its middle as points, and its light in bands of distance and cells across.

The points lead from the rear axle to the farthest distance that counts. A cell is as wide on the road at every
distance, so that a line or the edge of the road takes the same share of it near and far: its contrast falls with
the air alone, not with the resolution of the image.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from perception.sight.settings import StripSettings
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.messages import SteeringEstimate
from trepid.types import Array, Floats, Image, Mask

STEP_M = 2.0  # between two points
LEAST_DEPTH_M = 0.1
SATURATED_GREY = 250  # lighter pixels say nothing about the light (perception.camera.image_statistics)
NEAR_M = 15.0  # ground up to here shows its own light, with little air before it
SEEN_SHARE = 0.6  # of a cell within the image, from which it counts
SIDE_SHARE = 0.35  # of the width of the image, which the middle of the strip keeps from its middle
LIGHT_OF_GREY = ((np.arange(256) / 255) ** 2).astype(np.float32)  # gamma 2 is within 4 % of sRGB


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


def light_of(grey: Image) -> Floats:
    """The linear light, 0..1, of ``grey``: (grey/255)²."""
    return np.asarray(cv2.LUT(grey, LIGHT_OF_GREY), np.float32)


class Ground(NamedTuple):
    """Mean light of the cells of the ground."""

    distance_m: Array  # of the bands from the lens, far to near, (bands,)
    light: Array  # (bands, cells)
    seen: Mask  # within the image and not saturated, (bands, cells)

    @property
    def near(self) -> Array:
        """The light of the cells up to NEAR_M, (n,)."""
        return self.light[self.seen & (self.distance_m < NEAR_M)[:, None]]


class GroundStrip:
    """The rows of the image of one camera that show the ground, and their bands."""

    def __init__(self, camera: Camera, settings: StripSettings) -> None:
        """``camera``: of the image that is looked at, without distortion."""
        self._camera, self._matrix = camera, camera.pixel_from_road_matrix
        first = max(math.ceil(camera.horizon_row_px + settings.horizon_margin_px), 0)
        rows = np.arange(first, camera.height_px, dtype=float)
        middle = np.full(len(rows), camera.cx_px)
        ahead_m = camera.road_from_pixel(np.column_stack([middle, rows]))[:, 0] - camera.x_m
        used = (ahead_m >= settings.near_m) & (ahead_m <= settings.far_m)
        self.first_row = first
        self._ahead_m = ahead_m[used]
        self._rows = slice(int(rows[used][0]), int(rows[used][-1]) + 1) if used.any() else slice(0, 0)
        starts = [0]
        for i in range(1, len(self._ahead_m)):
            if self._ahead_m[starts[-1]] > settings.band_ratio * self._ahead_m[i]:
                starts.append(i)
        self._starts = np.array(starts)
        self._heights = np.diff(np.append(starts, len(self._ahead_m))).astype(float)
        cells = round(settings.half_width_m / settings.cell_m)
        self._edges_m = settings.cell_m * np.arange(cells, -cells - 1, -1.0)  # from left to right
        self.is_usable = len(self._ahead_m) > 0 and len(starts) >= 6
        if self.is_usable:
            self.distance_m = np.add.reduceat(self._ahead_m, self._starts) / self._heights
            self.middle_m = (self._edges_m[:-1] + self._edges_m[1:]) / 2

    def look(self, grey: Image, path: Path) -> Ground:
        """The ground along ``path`` in ``grey``, an image of the camera."""
        camera, matrix = self._camera, self._matrix
        x_m = self._ahead_m + camera.x_m
        most_m = SIDE_SHARE * camera.width_px / camera.fx_px * self._ahead_m
        left_m = np.clip(path.left_m(x_m), -most_m, most_m)[:, None] + self._edges_m
        ahead_m = x_m[:, None]
        depth = matrix[2, 0] * ahead_m + matrix[2, 1] * left_m + matrix[2, 2]
        u = (matrix[0, 0] * ahead_m + matrix[0, 1] * left_m + matrix[0, 2]) / depth
        v = (matrix[1, 0] * ahead_m + matrix[1, 1] * left_m + matrix[1, 2]) / depth
        return self._cells(grey[self._rows], u, v - self._rows.start)

    def _cells(self, grey: Image, u: Array, v: Array) -> Ground:
        """Means between the pixels (u, v) of neighbouring edges, (rows, cells + 1), over the rows of each band."""
        sums = _row_sums(light_of(grey))
        bright = _row_sums((grey >= SATURATED_GREY).astype(np.float32))
        within = (u >= -0.5) & (u <= grey.shape[1] - 0.5)
        places = (u + 0.5).astype(np.float32), v.astype(np.float32)
        width_px = np.diff(u, axis=1)
        light = _between(sums, *places) / width_px
        lost = _between(bright, *places) / width_px
        whole = (within[:, :-1] & within[:, 1:]).astype(float)
        share = np.add.reduceat(whole, self._starts) / self._heights[:, None]
        count = np.maximum(share * self._heights[:, None], 1.0)
        mean = np.add.reduceat(light * whole, self._starts) / count
        clipped = np.add.reduceat(lost * whole, self._starts) / count
        return Ground(self.distance_m, mean, (share >= SEEN_SHARE) & (clipped < 1 - SEEN_SHARE))


def _row_sums(values: Floats) -> Floats:
    """Sums of each row up to every pixel, (rows, columns + 1)."""
    sums = cv2.integral(values, sdepth=cv2.CV_64F)
    return np.diff(sums, axis=0).astype(np.float32)


def _between(sums: Floats, u: Floats, v: Floats) -> Floats:
    """Differences of ``sums`` between neighbouring places."""
    found = cv2.remap(sums, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.diff(np.asarray(found, np.float32), axis=1)
