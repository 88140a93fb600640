"""Images of the flat ground from above: square tiles of several pixel sizes, painted on demand."""

from functools import partial

import numpy as np

from sim_harness.world.render.ground.ground_painter import GroundPainter
from sim_harness.world.render.ground.strip_grid import LEVELS_M
from sim_harness.world.render.ground.tiles import Tiles
from sim_harness.world.roads.road import Road
from trepid.types import Array, Image

MAX_TILES = (64, 64, 192, 128, 128)  # cached at each level, 256 kB each


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
