"""Draws the ground of a road with heights: pixel by pixel, from the tiles of the flat ground.

Every pixel reads the ground at the place that it shows (:mod:`sim_harness.world.render.scene.relief`), from the
level of tiles for its optical depth. Where one row of the image spans many pixels of the ground, beyond the reach
of the finest level, SUB_ROWS lines are drawn and averaged (anti-aliasing); lines above the ground show what is
there already, so that the rim of a crest is smooth.
"""

import itertools
import math

import cv2
import numpy as np

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.ground.strip_grid import LEVELS_M
from sim_harness.world.render.scene.relief import Relief, between_columns, depth_per_ahead
from sim_harness.world.render.scene.view import SKY_M, View
from trepid.types import Array, Floats, Image

HAZE_REACH_M = 220.0
SUB_ROWS = 3
MARGIN = 1.1  # by which the part that is read of a level goes beyond its reach
REACH_PX = 1.2  # pixels of a level, at most, to a pixel of the image across the view


def draw_relief(
    image: Image, ground: Ground, view: View, relief: Relief, haze: Image, *, hazy_from_m: float
) -> None:
    """Draw the ground into ``image`` (BGRA), beyond ``hazy_from_m`` faded into ``haze``, an image of its size."""
    count, width_px = image.shape[:2]
    first = min(max(math.floor(float(relief.tops.min()) + 0.5), 0), count)
    rows = np.arange(first, count, dtype=float)
    near = relief.nearness_1pm(rows)
    depth_m = depth_per_ahead(view.camera, rows) / near.min(axis=1)
    fine = int(np.count_nonzero(depth_m > _reaches_m(view)[0]))
    lines = (np.arange(first * SUB_ROWS, (first + fine) * SUB_ROWS) + 0.5) / SUB_ROWS - 0.5
    far, below = image[first : first + fine], image[first + fine :]
    drawn = np.concatenate([np.repeat(far, SUB_ROWS, axis=0), below])
    near_lines = np.concatenate([relief.nearness_1pm(lines), near[fine:]])
    _draw_lines(drawn, ground, view, relief, np.concatenate([lines, rows[fine:]]), near_lines)
    below[:] = drawn[len(lines) :]
    if fine:
        far[:] = average_rows(drawn[: len(lines)], SUB_ROWS)
        columns = np.clip(relief.columns, 0, width_px - 1).astype(int)
        distance_m = 1 / (near[:fine] * view.along[first : first + fine, columns])
        share = np.where(distance_m > hazy_from_m, 1 - np.exp(-distance_m / HAZE_REACH_M), 0.0)
        shares = between_columns(share, width_px)
        _clear(shares, relief, rows[:fine], 0.0)
        far[:] = cv2.blendLinear(far, haze[:fine], 1 - shares, shares)


def relief_distance(view: View, relief: Relief) -> Floats:
    """Distance from the lens to the ground along each ray, SKY_M above it, (rows, columns) [m]."""
    rows = np.arange(view.camera.height_px, dtype=float)
    near = between_columns(relief.nearness_1pm(rows), view.camera.width_px)
    distance_m = np.minimum(1 / (near * view.along), np.float32(SKY_M))
    _clear(distance_m, relief, rows, SKY_M)
    return distance_m


def average_rows(image: Image, count: int) -> Image:
    """Means of every ``count`` rows of an image (count·rows, columns, channels)."""
    if count == 1:
        return image
    total = image.reshape(len(image) // count, count, *image.shape[1:]).sum(axis=1, dtype=np.uint16)
    return np.asarray((total + count // 2) // count, np.uint8)


def _reaches_m(view: View) -> Array:
    """Optical depth to which each level but the last is drawn."""
    return np.asarray(np.array(LEVELS_M[:-1]) * REACH_PX * view.camera.fx_px)


def _clear(values: Floats, relief: Relief, rows: Array, value: float) -> int:
    """Set ``values`` (rows, columns) above the ground; the number of rows, from the first, that may show such."""
    rim = int(np.count_nonzero(rows < relief.tops.max()))
    if rim:
        tops = between_columns(relief.tops[None], values.shape[1])
        values[:rim][rows[:rim, None].astype(np.float32) < tops] = value
    return rim


def _draw_lines(drawn: Image, ground: Ground, view: View, relief: Relief, rows: Array, near: Array) -> None:
    """Draw the ground of every row into ``drawn``, (rows, columns, 4), from 1/X along the computed columns."""
    ahead_m = 1 / near
    depth_m = ahead_m * depth_per_ahead(view.camera, rows)[:, None]
    left_m = depth_m * relief.aside
    cos, sin = math.cos(relief.heading_rad), math.sin(relief.heading_rad)
    places_m = np.stack([cos * ahead_m - sin * left_m, sin * ahead_m + cos * left_m])  # x, y from the lens
    depths_m = between_columns(depth_m, drawn.shape[1])
    rim = _clear(depths_m, relief, rows, -1.0)
    least_m, most_m = depth_m.min(axis=1), depth_m.max(axis=1)
    for level, (from_m, to_m) in enumerate(itertools.pairwise([0.0, *_reaches_m(view).tolist(), math.inf])):
        shown = np.flatnonzero((most_m > from_m) & (least_m <= to_m))
        if not len(shown):
            continue
        part = slice(int(shown[0]), int(shown[-1]) + 1)
        reach = np.clip(depth_m[part], from_m / MARGIN, to_m * MARGIN) / depth_m[part]
        if part.start >= rim and least_m[part].min() > from_m and most_m[part].max() <= to_m:
            drawn[part] = _read(ground, relief, level, places_m[:, part], reach)
        else:
            wanted = (depths_m[part] > from_m) & (depths_m[part] <= to_m)
            read = _read(ground, relief, level, places_m[:, part], reach)
            cv2.copyTo(read, wanted.view(np.uint8), drawn[part])


def _read(ground: Ground, relief: Relief, level: int, places_m: Array, reach: Array) -> Image:
    """The ground at places from the lens, (2, rows, computed columns), from one level.

    ``reach``: factor by which a place is moved towards the lens, or away, into the part that is read.
    """
    pixel_m, lens_m = LEVELS_M[level], np.array(relief.lens_m)
    inside_m = places_m * reach
    low_m, high_m = lens_m + inside_m.min(axis=(1, 2)), lens_m + inside_m.max(axis=(1, 2))
    crop, *start_m = ground.crop(level, low_m - 2 * pixel_m, high_m + 2 * pixel_m)
    pixels = (places_m + (lens_m - start_m)[:, None, None]) / pixel_m
    maps = [between_columns(of, relief.width_px) for of in pixels]
    for of, line, length in zip(maps, pixels, (crop.shape[1], crop.shape[0]), strict=True):
        if line.min() < 0 or line.max() > length - 1:  # OpenCV reads places outside of an image slowly
            np.clip(of, 0, length - 1, out=of)
    drawn = cv2.remap(crop, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(drawn, np.uint8)
