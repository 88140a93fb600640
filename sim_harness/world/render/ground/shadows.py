"""Shadows of trees, buildings and bridges on the carriageway. 255 = full sun.

They fade out towards the sides of the painted strip: the land beside the road is never in shadow.
"""

from operator import attrgetter

import numpy as np

from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.render.ground.strip_grid import ROWS, Grid, blend_fields, edges_m
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats, Image

KINDS = ("shadows", "building_shadows", "bridge_shadows")  # of trees, houses, bridges: fields of a section
DEPTH = 0.62  # share of the light lost in a shadow
FADE_M = 1.5
HOUSE_M, HOUSE_SKEW = 14.0, 0.4  # length of a house; stations by which a metre to the left shifts its shadow
BRIDGE_EVERY_M, BRIDGE_SKEW = 50.0, 0.15
BRIDGE_HALF_M = (2.0, 6.0)  # half the width of a band at shares 0 and 1
PENUMBRA_M = 0.15  # the sun is 0.53 degrees wide: 9 mm per metre of height
HOUSES = 256


class Shadows:
    """Shade of every block. Uses ``rng`` only for roads with tree shadows."""

    def __init__(self, road: Road, grid: Grid, rng: np.random.Generator, *, seed: int) -> None:
        self._road, self._grid = road, grid
        self._leaves = _leaves(rng, grid.columns) if any(s.shadows for s in road.sections) else None
        self._present = [kind for kind in KINDS if any(getattr(s, kind) for s in road.sections)]
        table = np.random.default_rng((seed, 7)).uniform(0, 1, (HOUSES, 2))
        self._jitter = 0.3 + 0.4 * table[:, 0]
        self._heights = (0.5 + 0.6 * table[:, 0]).astype(np.float32)
        self._alleys = (0.3 * table[:, 1]).astype(np.float32)

    def shade(self, index: int, station: Array) -> Image | None:
        """Shade of a block, (rows, columns), or None without any shadow."""
        layers = dict(zip(KINDS, (self._trees, self._buildings, self._bridges), strict=True))
        amounts = {kind: blend_fields(self._road, station, attrgetter(kind)) for kind in self._present}
        dark = [layers[kind](index, station, amount) for kind, amount in amounts.items() if amount.any()]
        if not dark:
            return None
        offset = self._grid.offsets
        side = np.clip(np.minimum(offset - self._grid.right_m, self._grid.left_m - offset) / FADE_M, 0, 1)
        return np.asarray(255 * (1 - np.maximum.reduce(dark) * side.astype(np.float32)), np.uint8)

    def _trees(self, index: int, _station: Array, shadows: Array) -> Floats:
        assert self._leaves is not None
        amount = shadows.astype(np.float32)[:, None]
        start = index * ROWS % len(self._leaves)
        foliage = self._leaves[start : start + ROWS] - (1.3 - 1.6 * amount)
        dark = np.clip(foliage / 0.5, 0, 1) * np.clip(5 * amount, 0, 1)
        return np.asarray(dark * np.float32(DEPTH), np.float32)

    def _buildings(self, _index: int, station: Array, amount: Array) -> Floats:
        """Straight-edged shadows of houses on the right, as long as each house is high."""
        right, left = (edge.astype(np.float32)[:, None] for edge in edges_m(self._road, station))
        offset, share = self._grid.offsets.astype(np.float32), amount.astype(np.float32)[:, None]
        place = (station[:, None] / HOUSE_M).astype(np.float32) + offset * np.float32(HOUSE_SKEW / HOUSE_M)
        house = np.floor(place)
        number = house.astype(np.int64) % HOUSES
        reach = (right + left) * share * self._heights[number] - right
        alley = place - house - (1 - share) * self._alleys[number]
        inside = np.minimum(reach - offset, alley * np.float32(HOUSE_M)) * np.float32(1 / PENUMBRA_M)
        dark = np.clip(inside + 0.5, 0, 1) * np.clip(5 * share, 0, 1)
        return np.asarray(dark * np.float32(DEPTH), np.float32)

    def _bridges(self, _index: int, station: Array, amount: Array) -> Floats:
        place = station[:, None] + BRIDGE_SKEW * self._grid.offsets
        number = np.floor(place / BRIDGE_EVERY_M)
        away = np.abs(place - (number + self._jitter[number.astype(int) % HOUSES]) * BRIDGE_EVERY_M)
        half_m = BRIDGE_HALF_M[0] + (BRIDGE_HALF_M[1] - BRIDGE_HALF_M[0]) * amount[:, None]
        lit = np.clip(2 * amount, 0, 1)[:, None] * DEPTH
        return np.asarray(np.clip((half_m - away) / PENUMBRA_M + 0.5, 0, 1) * lit, np.float32)


def _leaves(rng: np.random.Generator, columns: int) -> Floats:
    """Density of the shadows of trunks and crowns across the road, with a ragged rim."""
    shape = (4 * ROWS, columns)
    crowns = 0.85 * smooth_noise(rng, shape, (64, 128)) + 0.4 * smooth_noise(rng, shape, (16, 16))
    return np.asarray(crowns + 0.12 * smooth_noise(rng, shape, (4, 4)), np.float32)
