"""The unrolled carriageway: painted straight, in blocks along the station, before it is warped into the world.

The rows of a block run along the station, its columns from right to left. It has colour, a mask of the carriageway
and its shade. Coarser levels are area averages, so that a line thinner than a pixel fades (anti-aliasing).
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.render.ground.markings import LinePainter
from sim_harness.world.render.ground.road_marks import MarkPainter
from sim_harness.world.render.ground.shadows import Shadows
from sim_harness.world.render.ground.strip_grid import LEVELS_M, ROWS, Textures, grid_of, stretches
from sim_harness.world.render.ground.surface import SurfacePainter
from sim_harness.world.roads.appearance import Surface
from sim_harness.world.roads.road import Road
from trepid.types import Array, Image

T = TypeVar("T")

NOMINAL_BLOCK_M = ROWS * LEVELS_M[0]
MAX_FINEST, MAX_COARSER = 32, 128  # cached blocks: 2 MB each at the finest level, 0.7 MB for all others


@dataclass(frozen=True, slots=True)
class Block:
    """One block at one level: ``colour`` (rows, columns, 4) BGR and mask, ``shade`` (rows, columns) or None."""

    colour: Image
    shade: Image | None

    def rows(self, part: slice) -> "Block":
        return Block(self.colour[part], None if self.shade is None else self.shade[part])


class RoadStrip:
    """Blocks of a road, painted on demand. Equal seeds paint equal blocks, in any order."""

    def __init__(self, road: Road, *, seed: int) -> None:
        self.road = road
        self.seed = seed
        self.grid = grid_of(road)
        self.count = max(1, round(road.length_m / NOMINAL_BLOCK_M))
        self.block_m = road.length_m / self.count if road.closed else NOMINAL_BLOCK_M
        rng = np.random.default_rng((seed, 1))
        textures = Textures(rng, self.grid.columns)
        self._shadows = Shadows(road, self.grid, rng, seed=seed)
        self.tint = rng.uniform(0.975, 1.025, 3)
        self._surface = SurfacePainter(road, self.grid, textures, tint=self.tint, seed=seed)
        self._lines = LinePainter(road, self.grid, textures, seed=seed)
        self._marks = MarkPainter(road, self.grid, textures)
        self._finest: OrderedDict[int, Block] = OrderedDict()
        self._coarser: OrderedDict[int, tuple[Block, ...]] = OrderedDict()

    def block_at(self, station_m: Array) -> NDArray[np.int64]:
        return np.floor(station_m / self.block_m).astype(np.int64)

    def run(self, first: int, level: int, rows: slice) -> Block:
        """``rows`` of a level, counted from the start of block ``first``; they may span several blocks."""
        height = ROWS >> level
        pieces = []
        for start in range(rows.start // height * height, rows.stop, height):
            block = self._block(first + start // height, level)
            pieces.append(block.rows(slice(max(rows.start - start, 0), min(rows.stop - start, height))))
        if len(pieces) == 1:
            return pieces[0]
        shade = None
        if any(piece.shade is not None for piece in pieces):
            lit = [np.full(piece.colour.shape[:2], 255, np.uint8) for piece in pieces]
            shade = np.concatenate(
                [a if p.shade is None else p.shade for p, a in zip(pieces, lit, strict=True)]
            )
        return Block(np.concatenate([piece.colour for piece in pieces]), shade)

    def _block(self, index: int, level: int) -> Block:
        index = index % self.count if self.road.closed else index
        known = index in self._finest if level == 0 else index in self._coarser
        if not known:
            finest = self._paint(index)
            _keep(self._finest, index, finest, MAX_FINEST)
            _keep(self._coarser, index, _coarser(finest), MAX_COARSER)
        return self._finest[index] if level == 0 else self._coarser[index][level - 1]

    def _paint(self, index: int) -> Block:
        """Block ``index`` at the finest level: bare surface, lines, marks, then kerbs, puddles and snow."""
        station = (index + (np.arange(ROWS) + 0.5) / ROWS) * self.block_m
        rng = np.random.default_rng((self.seed, 2, index % 2**32))
        colour = np.empty((ROWS, self.grid.columns, 4), np.uint8)
        colour[:, :, 3] = 0
        parts = stretches(self.road, index, station)
        for here in parts:
            self._surface.paint(colour[here.rows], here, rng)
            self._lines.paint(colour[here.rows], here)
        self._marks.paint(colour, index, station)
        for here in parts:
            self._surface.cover(colour[here.rows], here)
        mask = self._surface.mask(index, station)
        for here in parts:
            if here.section.surface != Surface.FLOOR:  # there the lines alone are no floor
                colour[here.rows, :, 3] = mask[here.rows]
        return Block(colour, self._shadows.shade(index, station))


def _keep(cache: OrderedDict[int, T], index: int, item: T, max_items: int) -> None:
    """Put ``item`` into the cache and drop the oldest beyond ``max_items``."""
    cache[index] = item
    if len(cache) > max_items:
        cache.popitem(last=False)


def _coarser(finest: Block) -> tuple[Block, ...]:
    """The block at every level but the finest."""
    blocks = [finest]
    while len(blocks) < len(LEVELS_M):
        above = blocks[-1]
        blocks.append(Block(_halve(above.colour), None if above.shade is None else _halve(above.shade)))
    return tuple(blocks[1:])


def _halve(image: Image) -> Image:
    size = (image.shape[1] // 2, image.shape[0] // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
