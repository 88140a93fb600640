"""Draws the ground of a road with an elevation profile: row by row, from the tiles of the flat ground.

Across the direction of view the ground is level, so a row of the image shows a line of it at one distance ahead
(:mod:`sim_harness.world.render.scene.relief`); on a banked road a row is bent, and drawn in strips
(:mod:`sim_harness.world.render.scene.lean`). Each row is the mean of SUB_ROWS lines (anti-aliasing).
"""

import math

import cv2
import numpy as np

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.ground.strip_grid import LEVELS_M
from sim_harness.world.render.scene.relief import Relief
from sim_harness.world.render.scene.view import SKY_M, View
from trepid.types import Array, Floats, Image

HAZE_REACH_M = 220.0
SUB_ROWS = 4
REACH_PX = 1.2  # pixels of a level, at most, to a pixel of the image across the view


def draw_relief(image: Image, ground: Ground, view: View, relief: Relief) -> None:
    """Draw the ground into the rows of ``image`` (BGRA) that show it."""
    first = max(math.floor(relief.top_row + 0.5), 0)
    rows = (np.arange(first * SUB_ROWS, len(image) * SUB_ROWS) + 0.5) / SUB_ROWS - 0.5
    for strip in relief.strips(image.shape[1]):
        _draw_strip(image[:, strip], ground, view, relief, rows, strip)


def _draw_strip(image: Image, ground: Ground, view: View, relief: Relief, rows: Array, strip: slice) -> None:
    """Draw the columns ``strip`` of the ground into ``image``, which is these columns."""
    columns = image.shape[1]
    ahead_m, depth_m = (of.reshape(-1, SUB_ROWS, of.shape[1]) for of in relief.ground(rows, strip))
    valid = np.isfinite(ahead_m)
    beyond = ~valid.any(axis=(1, 2))  # no line of the row shows ground
    first, valid = len(image) - len(rows) // SUB_ROWS + int(beyond.sum()), valid[~beyond]
    if not len(valid):
        return
    ahead_m, depth_m = (_fill_lines(of[~beyond]) for of in (ahead_m, depth_m))
    reaches_m = np.array(LEVELS_M[:-1]) * REACH_PX * view.camera.fx_px
    levels = np.searchsorted(reaches_m, depth_m[:, 0].max(axis=1))
    aside = (view.camera.cx_px - np.arange(strip.start, strip.stop)) / view.camera.fx_px
    for level in np.unique(levels):
        chosen = levels == level
        places = (of[chosen].reshape(-1, of.shape[2]) for of in (ahead_m, depth_m))
        lines = _lines(ground, relief, int(level), aside, *places)
        lines = lines.reshape(-1, SUB_ROWS, columns, 4).astype(np.float32)
        weight = valid[chosen].astype(np.float32)
        if weight.shape[2] == 1:
            mean = np.einsum(
                "rscb,rs->rcb", lines, weight[:, :, 0] / weight[:, :, 0].sum(axis=1, keepdims=True)
            )
        else:
            mean = np.einsum(
                "rscb,rsc->rcb", lines, weight / np.maximum(weight.sum(axis=1, keepdims=True), 1)
            )
        share = weight.mean(axis=1)[:, :, None]
        here = first + np.flatnonzero(chosen)
        image[here] = np.rint(mean * share + image[here] * (1 - share))


def _fill_lines(values: Array) -> Array:
    """Lines above the ground take the values of the first line below."""
    nearest = np.nanmax(values, axis=(1, 2), keepdims=True)
    return np.where(np.isfinite(values), values, nearest)


def _lines(ground: Ground, relief: Relief, level: int, aside: Array, ahead_m: Array, depth_m: Array) -> Image:
    """The ground along lines across the view, (lines, columns, 4); ``aside``: left of the axis, by depth."""
    pixel_m = LEVELS_M[level]
    cos, sin = math.cos(relief.heading_rad), math.sin(relief.heading_rad)
    x_m = relief.lens_m[0] + cos * ahead_m - sin * depth_m * aside
    y_m = relief.lens_m[1] + sin * ahead_m + cos * depth_m * aside
    low = np.array([x_m.min(), y_m.min()]) - 2 * pixel_m
    high = np.array([x_m.max(), y_m.max()]) + 2 * pixel_m
    crop, left_m, top_m = ground.crop(level, low, high)
    maps = [((of - start) / pixel_m).astype(np.float32) for of, start in ((x_m, left_m), (y_m, top_m))]
    drawn = cv2.remap(crop, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(drawn, np.uint8)


def fade(image: Image, distance_m: Floats, haze_bgr: Array, *, from_m: float) -> None:
    """Blend the ground of ``image`` (BGRA) beyond ``from_m`` into haze."""
    share = 1 - np.exp(-distance_m / np.float32(HAZE_REACH_M))
    share = np.where((distance_m < SKY_M) & (distance_m > from_m), share, 0).astype(np.float32)
    haze = np.empty_like(image)
    haze[:] = (*np.rint(haze_bgr), 255)
    image[:] = cv2.blendLinear(image, haze, 1 - share, share)


def relief_distance(view: View, relief: Relief) -> Floats:
    """Distance from the lens to the ground along each ray, SKY_M above it, (rows, columns) [m]."""
    every = slice(0, view.camera.width_px)
    ahead_m, _ = relief.ground(np.arange(view.camera.height_px, dtype=float), every)
    cos, sin = math.cos(view.camera.yaw_rad), math.sin(view.camera.yaw_rad)
    along = np.maximum(view.rays[0] * np.float32(cos) + view.rays[1] * np.float32(sin), 1e-3)
    far = np.where(np.isfinite(ahead_m), ahead_m, np.inf)
    return np.asarray(np.minimum(far / along, SKY_M), np.float32)
