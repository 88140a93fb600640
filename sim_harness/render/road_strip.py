"""The carriageway unrolled: painted straight, in blocks along the station, before it is bent into the world.

A block is an image whose rows run along the station and whose columns run from right to left. It carries colour,
a mask of where there is carriageway, and the shade of trees. Coarser levels are area averages, so that a line
thinner than a pixel fades instead of flickering.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sim_harness.render.noise import FloatImage, smooth_noise
from sim_harness.roads.appearance import Marking, Paint, Section, Stroke, Surface
from sim_harness.roads.road import Road

Bytes = NDArray[np.uint8]
T = TypeVar("T")

LEVELS_M = (0.025, 0.05, 0.1, 0.2, 0.4)  # pixel sizes
RIGHT_M, LEFT_M = -4.8, 8.0  # what of the road's width is painted
COLUMNS = round((LEFT_M - RIGHT_M) / LEVELS_M[0])
ROWS = 1024
NOMINAL_BLOCK_M = ROWS * LEVELS_M[0]
MAX_FINEST, MAX_COARSER = 12, 128  # blocks kept: 2 MB each at the finest level, 0.7 MB for all others
TAPER_M = 12.0  # over which the carriageway changes its width
EDGE_SOFTNESS_M = 0.05

PAINT_BGR = {Paint.WHITE: (218, 222, 224), Paint.YELLOW: (62, 178, 226)}
SURFACE_TINT = {
    Surface.ASPHALT: (0.99, 1.0, 1.0),
    Surface.CONCRETE: (0.94, 1.0, 1.03),
    Surface.GRAVEL: (0.80, 0.95, 1.08),
}
GRAIN = {Surface.ASPHALT: 0.09, Surface.CONCRETE: 0.05, Surface.GRAVEL: 0.20}
CONCRETE_SLAB_M = 5.0


@dataclass(frozen=True, slots=True)
class Block:
    """One block at one level: ``colour`` (rows, columns, 4) BGR and mask, ``shade`` (rows, columns) or None."""

    colour: Bytes
    shade: Bytes | None


class RoadStrip:
    """Blocks of a road, painted when first asked for. The same seed paints the same blocks in any order."""

    def __init__(self, road: Road, *, seed: int) -> None:
        self.road = road
        self.seed = seed
        self.count = max(1, round(road.length_m / NOMINAL_BLOCK_M))
        self.block_m = road.length_m / self.count if road.closed else NOMINAL_BLOCK_M
        rng = np.random.default_rng((seed, 1))
        self._grain = smooth_noise(rng, (2 * ROWS, COLUMNS), (1, 1))
        self._blotch = smooth_noise(rng, (4 * ROWS, COLUMNS), (4, 4))
        self._wave = smooth_noise(rng, (4 * ROWS, COLUMNS), (128, 32))
        self._edge_noise = smooth_noise(rng, (4 * ROWS, 2), (32, 1))
        self._leaves = _leaves(rng) if any(section.shadows for section in road.sections) else None
        self._tint = rng.uniform(0.975, 1.025, 3)
        self._finest: OrderedDict[int, Block] = OrderedDict()
        self._coarser: OrderedDict[int, tuple[Block, ...]] = OrderedDict()

    def block_at(self, station_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Index of the block at each station."""
        return np.floor(station_m / self.block_m).astype(np.int64)

    def run(self, first: int, count: int, level: int) -> Block:
        """``count`` blocks from block ``first`` on, joined."""
        blocks = [self._block(first + i, level) for i in range(count)]
        if all(block.shade is None for block in blocks):
            shade = None
        else:
            shade = np.concatenate([_shade_or_light(block) for block in blocks])
        return Block(np.concatenate([block.colour for block in blocks]), shade)

    def _block(self, index: int, level: int) -> Block:
        index = index % self.count if self.road.closed else index
        known = index in self._finest if level == 0 else index in self._coarser
        if not known:
            finest = self._paint(index)
            _keep(self._finest, index, finest, MAX_FINEST)
            _keep(self._coarser, index, _coarser(finest), MAX_COARSER)
        return self._finest[index] if level == 0 else self._coarser[index][level - 1]

    def _paint(self, index: int) -> Block:
        """Block ``index`` at the finest level."""
        station = (index + (np.arange(ROWS) + 0.5) / ROWS) * self.block_m
        rng = np.random.default_rng((self.seed, 2, index % 2**32))
        colour = np.empty((ROWS, COLUMNS, 4), np.uint8)
        mask = self._carriageway(index, station)
        for rows, section in _sections(self.road, station):
            tone = self._tone(index, rows, station[rows], section, rng)
            tint = np.array(SURFACE_TINT[section.surface]) * self._tint * (255 * section.surface_grey)
            for channel in range(3):
                colour[rows, :, channel] = cv2.convertScaleAbs(tone, alpha=tint[channel])
            self._mark(colour[rows], index, rows, station[rows], section)
        colour[:, :, 3] = mask
        shadows = _tapered(self.road, station, "shadows")
        if self._leaves is None or not shadows.any():
            return Block(colour, None)
        return Block(colour, self._shade(self._leaves, index, shadows))

    def _noise(self, noise: FloatImage, index: int, rows: slice) -> FloatImage:
        """The rows of a periodic noise that belong to block ``index``."""
        start = index * ROWS % len(noise)
        return noise[start + rows.start : start + rows.stop]

    def _carriageway(self, index: int, station: NDArray[np.float64]) -> Bytes:
        """Mask of the carriageway with rough edges."""
        half_m = self.road.settings.lane_width_m / 2
        rough = self._noise(self._edge_noise, index, slice(0, ROWS))
        amount = _tapered(self.road, station, "edge_roughness_m")
        right = half_m + _tapered(self.road, station, "paved_right_m") + amount * rough[:, 0]
        left = half_m + _tapered(self.road, station, "paved_left_m") + amount * rough[:, 1]
        offset = _offsets().astype(np.float32)
        inside = left.astype(np.float32)[:, None] - offset
        np.minimum(inside, offset + right.astype(np.float32)[:, None], out=inside)
        inside += self._noise(self._blotch, index, slice(0, ROWS)) * np.float32(0.02)
        inside *= np.float32(255 / EDGE_SOFTNESS_M)
        inside += np.float32(127)
        return np.clip(inside, 0, 255, out=inside).astype(np.uint8)

    def _tone(
        self,
        index: int,
        rows: slice,
        station: NDArray[np.float64],
        section: Section,
        rng: np.random.Generator,
    ) -> FloatImage:
        """Brightness of the bare carriageway around 1, (rows, columns)."""
        tone = self._noise(self._wave, index, rows) * np.float32(0.05 * (0.4 + section.patchiness))
        tone += self._noise(self._blotch, index, rows) * np.float32(0.03)
        start = int(rng.integers(ROWS))
        tone += self._grain[start : start + len(tone)] * np.float32(GRAIN[section.surface])
        tone += 1 + _wheel_tracks()
        if section.surface == Surface.CONCRETE:
            tone[station % CONCRETE_SLAB_M < 0.03] *= 0.65
        if section.surface != Surface.GRAVEL:
            _repair(tone, section.patchiness, rng)
        return tone

    def _mark(
        self, colour: Bytes, index: int, rows: slice, station: NDArray[np.float64], section: Section
    ) -> None:
        """Paint the lines of the section onto ``colour``."""
        width_m = self.road.settings.lane_width_m
        lines = ((section.left, 0.5), (section.right, -0.5), (section.far_left, 1.5))
        for marking, place in lines:
            if marking.stroke == Stroke.NONE:
                continue
            columns = _columns(place * width_m, marking.width_m)
            across = _coverage(_offsets()[columns], place * width_m, marking.width_m, LEVELS_M[0])
            along = _dashes(station - section.start_m, marking)
            wear = self._kept(index, rows, columns, marking.wear)
            cover = (across * along[:, None] * wear)[:, :, None].astype(np.float32)
            grain = 1 + 0.04 * self._noise(self._blotch, index, rows)[:, columns, None]
            paint = np.array(PAINT_BGR[marking.paint], np.float32) * grain
            bare = colour[:, columns, :3].astype(np.float32)
            colour[:, columns, :3] = np.clip(bare + cover * (paint - bare), 0, 255)

    def _kept(self, index: int, rows: slice, columns: slice, wear: float) -> FloatImage:
        """Share of the paint left at every pixel."""
        fine = self._noise(self._blotch, index, rows)[:, columns]
        long = self._noise(self._wave, index, rows)[:, columns]
        rank = ndtr(0.6 * fine + 0.8 * long)
        return np.asarray(np.clip((rank - wear) / 0.15 + 0.5 + 0.5 * (wear == 0), 0, 1), np.float32)

    def _shade(self, leaves: FloatImage, index: int, shadows: NDArray[np.float64]) -> Bytes:
        """Shade of trees, 255 in the sun, fading out towards the sides of the strip."""
        amount = shadows.astype(np.float32)[:, None]
        foliage = self._noise(leaves, index, slice(0, ROWS)) - (1.3 - 1.6 * amount)
        dark = np.clip(foliage / 0.5, 0, 1) * np.clip(5 * amount, 0, 1) * np.float32(0.62)
        side = np.clip(np.minimum(_offsets() - RIGHT_M, LEFT_M - _offsets()) / 1.5, 0, 1)
        return np.asarray(255 * (1 - dark * side.astype(np.float32)), np.uint8)


def _leaves(rng: np.random.Generator) -> FloatImage:
    """Density of foliage: trunks and crowns thrown across the road, with a ragged rim."""
    shape = (4 * ROWS, COLUMNS)
    crowns = 0.85 * smooth_noise(rng, shape, (64, 128)) + 0.4 * smooth_noise(rng, shape, (16, 16))
    return np.asarray(crowns + 0.12 * smooth_noise(rng, shape, (4, 4)), np.float32)


def _offsets() -> NDArray[np.float64]:
    """Offset of every column of the finest level."""
    return np.asarray(RIGHT_M + (np.arange(COLUMNS) + 0.5) * LEVELS_M[0], np.float64)


def _columns(offset_m: float, width_m: float) -> slice:
    """Columns that a line touches."""
    margin = width_m / 2 + LEVELS_M[0]
    first, last = ((offset_m + side * margin - RIGHT_M) / LEVELS_M[0] for side in (-1, 1))
    return slice(max(math.floor(first), 0), min(math.ceil(last), COLUMNS))


def _coverage(x: NDArray[np.float64], centre: float, width_m: float, pixel_m: float) -> NDArray[np.float64]:
    """Share of each pixel at ``x`` that a stripe covers."""
    return np.asarray(np.clip((width_m / 2 - np.abs(x - centre)) / pixel_m + 0.5, 0, 1), np.float64)


def _dashes(station: NDArray[np.float64], marking: Marking) -> NDArray[np.float64]:
    """Share of each row that is painted."""
    if marking.stroke == Stroke.SOLID:
        return np.ones(len(station))
    phase = station % (marking.dash_m + marking.gap_m)
    return _coverage(phase, marking.dash_m / 2, marking.dash_m, LEVELS_M[0])


def _wheel_tracks() -> FloatImage:
    """Relative darkening where wheels roll, per column."""
    offset = _offsets()
    tracks = sum(np.exp(-(((offset - place) / 0.25) ** 2)) for place in (-0.75, 0.75))
    return np.asarray(-0.05 * tracks, np.float32)


def _repair(tone: FloatImage, patchiness: float, rng: np.random.Generator) -> None:
    """Draw patches, tar seams and cracks into ``tone``."""
    rows = len(tone)
    for _ in range(rng.poisson(3 * patchiness * rows / ROWS)):
        row, column = int(rng.integers(rows)), int(rng.integers(COLUMNS))
        height, width = int(rng.uniform(20, 160)), int(rng.uniform(15, 70))
        patch = tone[row : row + height, column : column + width]
        patch *= np.float32(rng.uniform(0.75, 1.2))
        cv2.rectangle(tone, (column, row), (column + width, row + height), 0.8, int(rng.integers(1, 3)))
    for _ in range(rng.poisson(8 * patchiness * rows / ROWS)):
        steps = rng.normal((0, 0), (4, 6), (int(rng.integers(8, 40)), 2)) + rng.normal(0, 4, 2)
        path = np.cumsum(steps, axis=0) + rng.uniform((0, 0), (COLUMNS, rows))
        cv2.polylines(tone, [path.astype(np.int32)], False, float(rng.uniform(0.5, 0.8)), 1)


def _sections(road: Road, station: NDArray[np.float64]) -> list[tuple[slice, Section]]:
    """Runs of rows with their section."""
    index = road.section_indices(station)
    cuts = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(index)]
    return [(slice(a, b), road.sections[index[a]]) for a, b in pairwise(cuts)]


def _tapered(road: Road, station: NDArray[np.float64], field: str) -> NDArray[np.float64]:
    """A number of the sections, changing linearly over TAPER_M after the start of each."""
    values = np.array([getattr(section, field) for section in road.sections])
    starts = np.array([section.start_m for section in road.sections])
    here = road.section_indices(station)
    before = here - 1 if road.closed else np.maximum(here - 1, 0)
    run = (station % road.length_m if road.closed else station) - starts[here]
    share = np.clip(run / TAPER_M, 0, 1)
    return np.asarray((1 - share) * values[before] + share * values[here])


def _keep(cache: OrderedDict[int, T], index: int, item: T, most: int) -> None:
    """Put ``item`` into the cache and drop the oldest when there are too many."""
    cache[index] = item
    if len(cache) > most:
        cache.popitem(last=False)


def _coarser(finest: Block) -> tuple[Block, ...]:
    """The block at every level but the finest."""
    blocks = [finest]
    while len(blocks) < len(LEVELS_M):
        above = blocks[-1]
        blocks.append(Block(_halved(above.colour), None if above.shade is None else _halved(above.shade)))
    return tuple(blocks[1:])


def _halved(image: Bytes) -> Bytes:
    size = (image.shape[1] // 2, image.shape[0] // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _shade_or_light(block: Block) -> Bytes:
    return np.full(block.colour.shape[:2], 255, np.uint8) if block.shade is None else block.shade
