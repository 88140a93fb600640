"""Images of the flat ground from above: square tiles of several pixel sizes, painted on demand, and their crops."""

import math
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from sim_harness.world.render.ground.ground_painter import GroundPainter
from sim_harness.world.render.ground.strip_grid import LEVELS_M, TILE_PX
from sim_harness.world.roads.road import Road
from trepid.types import Array, Image

MAX_TILES = (64, 64, 192, 128, 128)  # cached at each level, 256 kB each
MOSAICS = 3  # cached: one for each band of the image that uses the same level

Cell = tuple[int, int]  # column, row


class Ground:
    """Tiles around a road. Equal seeds paint equal tiles, in any order."""

    def __init__(self, road: Road, *, seed: int) -> None:
        self.road = road
        painter = GroundPainter(road, seed=seed)
        self._tiles = [
            Tiles(partial(painter.paint, level), pixel_m=pixel_m, max_tiles=max_tiles)
            for level, (pixel_m, max_tiles) in enumerate(zip(LEVELS_M, MAX_TILES, strict=True))
        ]

    def crop(self, level: int, low: Array, high: Array) -> tuple[Image, float, float]:
        """Image of the rectangle from ``low`` to ``high`` (x, y), and the x and y of its first pixel's centre.

        Columns run along x, rows along y, LEVELS_M[level] apart; BGR and an unused fourth channel.
        """
        return self._tiles[level].crop(low, high)

    def prepaint(self) -> None:
        """Paint the whole carriageway and its surroundings."""
        for station_m in np.arange(0, self.road.length_m, 20.0):
            centre = np.array(self.road.position(station_m, 0.0))
            for level, reach_m in ((2, 25), (3, 45), (4, 220)):
                self._tiles[level].paint_all(centre - reach_m, centre + reach_m)

    def paint_one(self, level: int, low: Array, high: Array) -> bool:
        """Paint the first missing tile between ``low`` and ``high`` (x, y). Returns whether there was one."""
        return self._tiles[level].paint_one(low, high)


@dataclass(frozen=True, slots=True)
class Mosaic:
    """Neighbouring tiles side by side: columns ``c0`` to below ``c1``, rows ``r0`` to below ``r1``."""

    c0: int
    r0: int
    c1: int
    r1: int
    image: Image

    def covers(self, c0: int, r0: int, c1: int, r1: int) -> bool:
        return self.c0 <= c0 and self.r0 <= r0 and c1 <= self.c1 and r1 <= self.r1


class Tiles:
    """The tiles of one level. Tile (column, row) begins at ``TILE_PX * pixel_m`` times (column, row)."""

    def __init__(self, paint: Callable[[int, int], Image], *, pixel_m: float, max_tiles: int) -> None:
        """``paint`` returns a tile (TILE_PX, TILE_PX, 4); ``max_tiles`` are cached."""
        self._paint, self._pixel_m, self._max_tiles = paint, pixel_m, max_tiles
        self._tiles: OrderedDict[Cell, Image] = OrderedDict()
        self._mosaics: deque[Mosaic] = deque(maxlen=MOSAICS)

    def crop(self, low: Array, high: Array) -> tuple[Image, float, float]:
        """Image of the rectangle from ``low`` to ``high`` (x, y), and the x and y of its first pixel's centre.

        The image is a view of a mosaic of tiles, which is built once for many frames: building it for each frame
        would cost more than drawing the frame.
        """
        c0, r0, c1, r1 = self._pixels(low, high)
        mosaic = self._mosaic(*_cells(c0, r0, c1, r1))
        left, top = mosaic.c0 * TILE_PX, mosaic.r0 * TILE_PX
        image = mosaic.image[r0 - top : r1 - top, c0 - left : c1 - left]
        return image, (c0 + 0.5) * self._pixel_m, (r0 + 0.5) * self._pixel_m

    def paint_one(self, low: Array, high: Array) -> bool:
        """Paint the first missing tile of the rectangle. Returns whether there was one."""
        missing = next((cell for cell in self._between(low, high) if cell not in self._tiles), None)
        if missing is not None:
            self._tile(missing)
        return missing is not None

    def paint_all(self, low: Array, high: Array) -> None:
        for cell in self._between(low, high):
            self._tile(cell)

    def _pixels(self, low: Array, high: Array) -> tuple[int, int, int, int]:
        """First column and row, and those after the last, of the rectangle."""
        (x0, y0), (x1, y1), size = low.tolist(), high.tolist(), self._pixel_m
        return math.floor(x0 / size), math.floor(y0 / size), math.ceil(x1 / size), math.ceil(y1 / size)

    def _between(self, low: Array, high: Array) -> Iterator[Cell]:
        c0, r0, c1, r1 = _cells(*self._pixels(low, high))
        return ((column, row) for row in range(r0, r1) for column in range(c0, c1))

    def _mosaic(self, c0: int, r0: int, c1: int, r1: int) -> Mosaic:
        for mosaic in self._mosaics:
            if mosaic.covers(c0, r0, c1, r1):
                return mosaic
        rows = [[self._tile((column, row)) for column in range(c0, c1)] for row in range(r0, r1)]
        mosaic = Mosaic(c0, r0, c1, r1, np.concatenate([np.concatenate(row, axis=1) for row in rows]))
        self._mosaics.appendleft(mosaic)
        return mosaic

    def _tile(self, cell: Cell) -> Image:
        if cell in self._tiles:
            self._tiles.move_to_end(cell)
        else:
            self._tiles[cell] = self._paint(*cell)
            if len(self._tiles) > self._max_tiles:
                self._tiles.popitem(last=False)
        return self._tiles[cell]


def _cells(c0: int, r0: int, c1: int, r1: int) -> tuple[int, int, int, int]:
    """The range of tiles that contains a range of pixels."""
    return c0 // TILE_PX, r0 // TILE_PX, -(-c1 // TILE_PX), -(-r1 // TILE_PX)
