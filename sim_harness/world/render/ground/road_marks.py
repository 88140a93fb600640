"""Paints arrows, letters, zebra crossings and stop lines."""

import cv2
import numpy as np

from sim_harness.world.render.ground.markings import paint_over
from sim_harness.world.render.ground.strip_grid import (
    PIXEL_M,
    ROWS,
    Grid,
    Textures,
    distance_along,
    paint_left,
)
from sim_harness.world.roads.features import MarkKind, RoadMark
from sim_harness.world.roads.lanes import RoadLane
from sim_harness.world.roads.road import Road
from trepid.types import Array, Image

ARROW_WIDTH_M = 1.7  # raster around the arrow; the straight head is 0.6 m wide (RMS-1)
LETTER_WIDTH_M = 0.62
MAX_TEXT_SHARE = 0.85  # of the lane's width
STRIPE_M = 0.5  # of a zebra crossing, and its gaps: StVO sign 293
FINER = 4  # factor of the resolution at which symbols are drawn

# Polygons: (share of the length, metres to the left).
SHAFT = ((0.0, 0.075), (0.62, 0.075), (0.62, -0.075), (0.0, -0.075))
HEAD = ((0.60, 0.30), (1.0, 0.0), (0.60, -0.30))
BEND = ((0.0, 0.075), (0.42, 0.075), (0.55, 0.42), (0.66, 0.42), (0.5, -0.075), (0.0, -0.075))
LEFT_HEAD = ((0.46, 0.38), (0.76, 0.38), (0.64, 0.82))
FORK_M = -0.22  # shift of a bend next to a straight head, as a share of the length
LOW_BEND, LOW_HEAD = (tuple((max(x + FORK_M, 0.0), y) for x, y in part) for part in (BEND, LEFT_HEAD))
ARROWS = {
    MarkKind.ARROW_STRAIGHT: (SHAFT, HEAD),
    MarkKind.ARROW_LEFT: (BEND, LEFT_HEAD),
    MarkKind.ARROW_STRAIGHT_LEFT: (SHAFT, HEAD, LOW_BEND, LOW_HEAD),
}
MIRRORED = {
    MarkKind.ARROW_RIGHT: MarkKind.ARROW_LEFT,
    MarkKind.ARROW_STRAIGHT_RIGHT: MarkKind.ARROW_STRAIGHT_LEFT,
}


class MarkPainter:
    """Paints the marks of a road; each is drawn once, on first use."""

    def __init__(self, road: Road, grid: Grid, textures: Textures) -> None:
        self._road, self._grid, self._textures = road, grid, textures
        self._drawn: dict[int, tuple[Image, float]] = {}

    def paint(self, colour: Image, index: int, station: Array) -> None:
        for number, mark in enumerate(self._road.settings.marks):
            run = distance_along(self._road, station, mark.at_m + mark.extent_m / 2) + mark.extent_m / 2
            rows = np.flatnonzero((run >= 0) & (run < mark.extent_m))
            if len(rows):
                if number not in self._drawn:
                    self._drawn[number] = self._draw(mark)
                mask, right_m = self._drawn[number]
                lines = np.minimum((run[rows] / mark.extent_m * len(mask)).astype(int), len(mask) - 1)
                self._lay(colour, index, rows, mask[lines], right_m, mark)

    def _lay(
        self, colour: Image, index: int, rows: np.ndarray, mask: Image, right_m: float, mark: RoadMark
    ) -> None:
        """Paint rows of a mask onto the block; its columns run from ``right_m`` to the left."""
        first = round((right_m - self._grid.right_m) / PIXEL_M)
        inside = slice(max(first, 0), min(first + mask.shape[1], self._grid.columns))
        cover = mask[:, inside.start - first : inside.stop - first].astype(np.float32) / 255
        noises = (self._textures.blotch, self._textures.wave)
        blotch, wave = (noise[(index * ROWS + rows) % len(noise), inside] for noise in noises)
        cover = (cover * paint_left(blotch, wave, mark.wear))[:, :, None]
        colour[rows, inside, :3] = paint_over(colour[rows, inside, :3], cover, mark.paint, blotch)

    def _draw(self, mark: RoadMark) -> tuple[Image, float]:
        """Mask with rows along the station and columns to the left, and the offset of its right edge."""
        right_m, left_m = self._reach(mark)
        width_m = left_m - right_m
        if mark.kind == MarkKind.STOP_LINE:
            return np.full((1, round(width_m / PIXEL_M)), 255, np.uint8), right_m
        if mark.kind == MarkKind.ZEBRA:
            run = (np.arange(round(width_m / PIXEL_M)) + 0.5) * PIXEL_M
            return ((run % (2 * STRIPE_M) < STRIPE_M) * np.uint8(255))[None], right_m
        symbol = _letters(mark.text) if mark.kind == MarkKind.TEXT else _arrow(mark.kind, mark.extent_m)
        size_m = ARROW_WIDTH_M
        if mark.kind == MarkKind.TEXT:
            size_m = min(LETTER_WIDTH_M * len(mark.text), MAX_TEXT_SHARE * width_m)
        size = (round(size_m / PIXEL_M), round(mark.extent_m / PIXEL_M))
        mask = cv2.resize(symbol, size, interpolation=cv2.INTER_AREA)
        mask = mask if mark.oncoming else mask[::-1, ::-1]  # drawn in the driver's view
        return np.ascontiguousarray(mask, np.uint8), (right_m + left_m - size_m) / 2

    def _reach(self, mark: RoadMark) -> tuple[float, float]:
        """Offsets of the right and left edge of the mark's lane, or of all lanes."""
        section = self._road.section_at(mark.at_m)
        lanes = (mark.lane, mark.lane)
        if mark.kind == MarkKind.ZEBRA:
            lanes = (-len(section.right_lanes), len(section.lanes_to_the_left))
        right, left = (RoadLane(self._road, index) for index in lanes)
        return (
            right.centre_at(mark.at_m) - right.width_at(mark.at_m) / 2,
            left.centre_at(mark.at_m) + left.width_at(mark.at_m) / 2,
        )


def _arrow(kind: MarkKind, length_m: float) -> Image:
    """An arrow in the driver's view: far end up, left to the left."""
    if kind in MIRRORED:
        return np.asarray(_arrow(MIRRORED[kind], length_m)[:, ::-1], np.uint8)
    pixel_m = PIXEL_M / FINER
    image = np.zeros((round(length_m / pixel_m), round(ARROW_WIDTH_M / pixel_m)), np.uint8)
    for polygon in ARROWS[kind]:
        points = [((ARROW_WIDTH_M / 2 - y) / pixel_m, (1 - x) * length_m / pixel_m) for x, y in polygon]
        cv2.fillPoly(image, [np.round(points).astype(np.int32)], 255)
    return image


def _letters(text: str) -> Image:
    """A line of text, cropped to its letters."""
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 4.0, 16)
    image = np.zeros((height + 2 * base, width + 40), np.uint8)
    cv2.putText(image, text, (20, height + base // 2), cv2.FONT_HERSHEY_DUPLEX, 4.0, 255, 16)
    rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
    return image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
