"""Paints tiles of the ground: verge and carriageway.

The station and offset of every pixel are computed on a coarse grid and interpolated (error at most step²/(8 R),
1.3 mm at R = 15 m on the finest level); the colour is read from the unrolled road at that place.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.render.ground.floors import FLOORS, floor_of
from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.render.ground.road_strip import RoadStrip
from sim_harness.world.render.ground.side_roads import arms_of, lay_arm
from sim_harness.world.render.ground.strip_grid import LEVELS_M, ROWS, TILE_PX
from sim_harness.world.roads.appearance import Verge
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats, Image, Mask

STEP_PX = (16, 16, 8, 4, 4)  # of the coarse grid
FIRST_LARGE_LEVEL, GROUP = 3, 4  # from this level on, points far from the road are computed in groups
VERGE_PX = 1024  # period of the verge at the finest level
OUTSIDE = -1e4  # a source coordinate outside every image

VERGE_BGR = {
    Verge.GRASS: (72, 124, 104),
    Verge.DRY_GRASS: (110, 152, 166),
    Verge.SOIL: (92, 116, 138),
    Verge.SNOW: (228, 222, 218),
    Verge.GRAVEL: (132, 146, 156),
    Verge.PAVEMENT: (146, 152, 156),
    Verge.WATER: (112, 100, 84),
    Verge.WOOD: (84, 124, 162),
    Verge.MAT: (52, 50, 50),
    Verge.LIGHT_FLOOR: (176, 184, 188),
    Verge.CARPET: (98, 92, 90),
}
GREY = {Verge.PAVEMENT, Verge.WATER, *FLOORS}  # verges of constant hue


class GroundPainter:
    """Paints tiles around a road. Equal seeds paint equal tiles, in any order."""

    def __init__(self, road: Road, *, seed: int) -> None:
        self.road = road
        self.strip = RoadStrip(road, seed=seed)
        self._arms = tuple(arms_of(road, self.strip.tint))
        rng = np.random.default_rng((seed, 3))
        jitter = rng.uniform(0.8, 1.15) * rng.uniform(0.9, 1.1, 3)
        verges = [section.verge for section in road.sections]
        tints = [jitter.mean() if verge in GREY else jitter for verge in verges]
        self._verge_bgr = np.array(
            [np.array(VERGE_BGR[verge]) * tint for verge, tint in zip(verges, tints, strict=True)]
        )
        self._floor = floor_of(road, seed=seed)
        self._verge = _verge_levels(rng)
        self._phase = rng.uniform(0, math.tau, 4)

    def paint(self, level: int, column: int, row: int) -> Image:
        """The tile in this column and row of a level, (TILE_PX, TILE_PX, 4)."""
        step = STEP_PX[level]
        points = _cell_centres(level, column, row)
        station, offset = self._coordinates(level, points)
        grain = self._grain(level, column, row)
        tile = self._verge_tile(level, grain, points, station)
        run_m = (np.arange(TILE_PX, dtype=np.float64) + 0.5) * LEVELS_M[level]
        tile_m = TILE_PX * LEVELS_M[level]
        if self._floor is not None:
            tone = self._floor.tone(column * tile_m + run_m, row * tile_m + run_m, LEVELS_M[level])
            tile = np.asarray(np.clip(tile * tone[:, :, None], 0, 255), np.uint8)
        for arm in self._arms:
            lay_arm(tile, arm, column * tile_m + run_m, row * tile_m + run_m, grain)
        tile = np.asarray(cv2.cvtColor(tile, cv2.COLOR_BGR2BGRA), np.uint8)
        right_m, left_m = self.strip.grid.right_m, self.strip.grid.left_m
        spare_m = 2 * step * LEVELS_M[level]
        near = (offset > right_m - spare_m) & (offset < left_m + spare_m)
        if near.any():
            box, pixels = _box(near, step)
            station, offset, near = station[box], offset[box], near[box]
            distance = _spread(np.abs(offset), step)
            columns = _spread((offset - right_m) / LEVELS_M[level] - 0.5, step)
            columns[distance > max(left_m, -right_m)] = OUTSIDE
            for first, count in self._runs(self.strip.block_at(station[near])):
                self._lay(tile[pixels], level, first, count, station, near, columns)
        if self._floor is not None and self._floor.window_light:
            light = self._floor.light(column * tile_m + run_m, row * tile_m + run_m)
            tile[:, :, :3] = np.clip(tile[:, :, :3] * (1 + light[:, :, None]), 0, 250)
        return tile

    def _coordinates(self, level: int, points: Array) -> tuple[Array, ...]:
        """Station and offset of a tile's grid of points, (cells, cells, 2) -> twice (cells, cells).

        On a large tile most points lie far from the road and determine only the colour of the verge. They take the
        coordinates of one point among GROUP² neighbours, unless the colour changes within the tile.
        """
        cells = len(points)
        if level < FIRST_LARGE_LEVEL:
            station, offset = self.road.nearest_coordinates(points.reshape(-1, 2), steps=2).T
            return station.reshape(cells, cells), offset.reshape(cells, cells)
        middles = np.minimum(np.arange(0, cells, GROUP) + GROUP // 2, cells - 1)
        rough = self.road.nearest_coordinates(points[np.ix_(middles, middles)].reshape(-1, 2), steps=2)
        colours = self._verge_bgr[self.road.section_indices(rough[:, 0])]
        rough = rough.reshape(len(middles), len(middles), 2)
        station, offset = np.moveaxis(rough.repeat(GROUP, axis=0).repeat(GROUP, axis=1)[:cells, :cells], 2, 0)
        reach_m = max(self.strip.grid.left_m, -self.strip.grid.right_m)
        # A point is within GROUP steps of its middle.
        spare_m = (2 + GROUP) * STEP_PX[level] * LEVELS_M[level]
        close = np.abs(offset) < reach_m + spare_m
        close |= (colours != colours[0]).any()
        station[close], offset[close] = self.road.nearest_coordinates(points[close], steps=2).T
        return station, offset

    def _runs(self, blocks: NDArray[np.int64]) -> list[tuple[int, int]]:
        """Runs (first, count) of neighbouring blocks; on a closed road the last block neighbours the first."""
        wanted = set(blocks.tolist())
        total = self.strip.count if self.road.closed else 0
        before = {b: (b - 1) % total if total else b - 1 for b in wanted}
        after = {b: (b + 1) % total if total else b + 1 for b in wanted}
        firsts = sorted(b for b in wanted if before[b] not in wanted) or [min(wanted)]
        runs = []
        for first in firsts:
            count, block = 1, after[first]
            while block in wanted and block != first:
                count, block = count + 1, after[block]
            runs.append((first, count))
        return runs

    def _lay(
        self, tile: Image, level: int, first: int, count: int, station: Array, near: Mask, columns: Floats
    ) -> None:
        """Paint the carriageway of a run of blocks onto the tile."""
        strip, length_m = self.strip, count * self.strip.block_m
        along = station - first * strip.block_m
        if self.road.closed:
            along = along % self.road.length_m
        along = np.where(near & (along >= 0) & (along <= length_m), along, OUTSIDE)
        height = count * (ROWS >> level)
        rows = along * (height / length_m) - 0.5
        inside = rows[along != OUTSIDE]
        part = slice(max(math.floor(inside.min()), 0), min(math.ceil(inside.max()) + 1, height))
        block = strip.run(first, level, part)
        rows = _spread(rows, STEP_PX[level]) - part.start
        bent = cv2.remap(block.colour, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        mask = np.divide(bent[:, :, 3], 255, dtype=np.float32)
        tile[:] = cv2.blendLinear(bent, tile, mask, 1 - mask)
        if block.shade is not None:
            shade = cv2.remap(block.shade, columns, rows, cv2.INTER_LINEAR, borderValue=255)
            tile[:] = cv2.multiply(tile, cv2.merge([shade] * 4), scale=1 / 255)

    def _verge_tile(self, level: int, grain: Image, points: Array, station: Array) -> Image:
        a, b, c, d = self._phase
        x, y = np.moveaxis(points, 2, 0)
        wave = (
            np.sin(x / 7 + a) * np.sin(y / 9 + b) + np.sin(x / 23 + y / 31 + c) + np.sin(y / 17 - x / 41 + d)
        )
        colours = self._verge_bgr[self.road.section_indices(station)] * (1 + 0.06 * wave[:, :, None])
        tint = _spread(colours, STEP_PX[level])
        return np.asarray(cv2.multiply(cv2.convertScaleAbs(tint, beta=-0.5), grain, scale=1 / 128), np.uint8)

    def _grain(self, level: int, column: int, row: int) -> Image:
        """The periodic texture of the verge, around 128, on one tile."""
        noise, size = self._verge[level], TILE_PX
        top, left = row * size % len(noise), column * size % len(noise)
        return noise[top : top + size, left : left + size]


def _cell_centres(level: int, column: int, row: int) -> Array:
    """World points (x, y) of the coarse grid of a tile and one cell on each side, shape (cells, cells, 2)."""
    step_m, tile_m = STEP_PX[level] * LEVELS_M[level], TILE_PX * LEVELS_M[level]
    run = (np.arange(TILE_PX // STEP_PX[level] + 2) - 0.5) * step_m
    x, y = np.meshgrid(column * tile_m + run, row * tile_m + run)
    return np.stack([x, y], axis=2)


def _spread(values: Array, step: int) -> Floats:
    """Values at cell centres interpolated to every pixel of the tile, without the outer ring of cells."""
    wide = cv2.resize(values.astype(np.float32), None, fx=step, fy=step, interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide[step:-step, step:-step], np.float32)


def _box(near: Mask, step: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The part of the coarse grid near the road, with a margin for the interpolation, and its pixels."""
    spans = [np.flatnonzero(near.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (
        slice(max(int(span[0]) - 2, 0), min(int(span[-1]) + 3, size))
        for span, size in zip(spans, near.shape, strict=True)
    )
    pixels = tuple(slice(part.start * step, (part.stop - 2) * step) for part in (rows, columns))
    return (rows, columns), (pixels[0], pixels[1])


def _verge_levels(rng: np.random.Generator) -> list[Image]:
    """A periodic texture around 128 at every level, in three equal channels, at least as wide as a tile."""
    shape = (VERGE_PX, VERGE_PX)
    mixture = 0.55 * smooth_noise(rng, shape, (1, 1)) + 0.5 * smooth_noise(rng, shape, (4, 4))
    mixture += 0.35 * smooth_noise(rng, shape, (32, 32)) + 0.3 * smooth_noise(rng, shape, (128, 128))
    levels = [np.clip(128 * (1 + 0.16 * mixture), 0, 255).astype(np.uint8)]
    while len(levels) < len(LEVELS_M):
        size = len(levels[-1]) // 2
        halved = cv2.resize(levels[-1], (size, size), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(halved, np.uint8))
    repeats = [-(-TILE_PX // len(noise)) for noise in levels]
    tiled = [np.tile(noise, (count, count)) for noise, count in zip(levels, repeats, strict=True)]
    return [np.asarray(cv2.merge([noise] * 3), np.uint8) for noise in tiled]
