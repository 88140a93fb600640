"""The raster of the unrolled road: columns, textures, stripes, tapers."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats

LEVELS_M = (0.025, 0.05, 0.1, 0.2, 0.4)  # pixel sizes
PIXEL_M = LEVELS_M[0]
TILE_PX = 256  # side of a tile of the ground, at every level
ROWS = 1024  # of a block at the finest level
RIGHT_M, LEFT_M = -4.8, 8.0  # smallest painted width
WIDEN_M = 3.2  # increment of the width: 128 columns, the largest cell of the noises
SPARE_M = 1.0  # smallest painted margin beyond the carriageway
TAPER_M = 12.0  # over which a field of the sections changes


@dataclass(frozen=True)
class Grid:
    """Columns of the finest level, from right to left."""

    right_m: float = RIGHT_M
    left_m: float = LEFT_M

    @cached_property
    def columns(self) -> int:
        return round((self.left_m - self.right_m) / PIXEL_M)

    @cached_property
    def offsets(self) -> Array:
        return np.asarray(self.right_m + (np.arange(self.columns) + 0.5) * PIXEL_M, np.float64)

    def columns_between(self, right_m: float, left_m: float) -> slice:
        """Columns between two offsets, plus one on each side."""
        first = (right_m - PIXEL_M - self.right_m) / PIXEL_M
        last = (left_m + PIXEL_M - self.right_m) / PIXEL_M
        return slice(max(math.floor(first), 0), min(max(math.ceil(last), 0), self.columns))


def grid_of(road: Road) -> Grid:
    """A raster that contains the carriageway of every section."""
    starts = np.array([section.start_m for section in road.sections])
    # The carriageway is widest at an end of a section or of a taper.
    widest = np.concatenate([starts, starts - 1e-6, starts + TAPER_M, [road.length_m - 1e-6]])
    right_m, left_m = (float(edge.max()) + SPARE_M for edge in edges_m(road, widest))
    return Grid(
        RIGHT_M - WIDEN_M * max(0, math.ceil((right_m + RIGHT_M) / WIDEN_M)),
        LEFT_M + WIDEN_M * max(0, math.ceil((left_m - LEFT_M) / WIDEN_M)),
    )


class Textures:
    def __init__(self, rng: np.random.Generator, columns: int) -> None:
        self.grain = smooth_noise(rng, (2 * ROWS, columns), (1, 1))
        self.blotch = smooth_noise(rng, (4 * ROWS, columns), (4, 4))
        self.wave = smooth_noise(rng, (4 * ROWS, columns), (128, 32))
        self.edge = smooth_noise(rng, (4 * ROWS, 2), (32, 1))


@dataclass(frozen=True)
class Stretch:
    """Rows of one block within one section."""

    index: int  # of the block
    rows: slice  # in the block
    station: Array  # of each row
    share: Array  # of the section behind each row, 0..1
    section: Section

    def part(self, noise: Floats) -> Floats:
        """The rows of a periodic noise at this stretch."""
        start = self.index * ROWS % len(noise)
        return noise[start + self.rows.start : start + self.rows.stop]


def stretches(road: Road, index: int, station: Array) -> list[Stretch]:
    number, share = road.section_indices(station), road.section_shares(station)
    cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(number)]
    return [
        Stretch(index, slice(a, b), station[a:b], share[a:b], road.sections[number[a]])
        for a, b in pairwise(cuts)
    ]


def coverage(x: Array, centre: float | Array, width_m: float, pixel_m: float) -> Array:
    """Share of each pixel at ``x`` covered by a stripe."""
    return np.asarray(np.clip((width_m / 2 - np.abs(x - centre)) / pixel_m + 0.5, 0, 1), np.float64)


def paint_left(fine: Floats, long: Floats, wear: float) -> Floats:
    """Share of the paint left at every pixel after ``wear``, from a fine and a long noise."""
    rank = ndtr(0.6 * fine + 0.8 * long)
    return np.asarray(np.clip((rank - wear) / 0.15 + 0.5 + 0.5 * (wear == 0), 0, 1), np.float32)


def distance_along(road: Road, station: Array, at_m: float) -> Array:
    """Signed distance from station ``at_m``, the shorter way round on a closed road."""
    away = station - at_m
    if road.closed:
        away = (away + road.length_m / 2) % road.length_m - road.length_m / 2
    return np.asarray(away, np.float64)


def blend_fields(
    road: Road, station: Array, number: Callable[[Section], float | tuple[float, float]]
) -> Array:
    """A field of the sections (constant or linear) at each station, blended over TAPER_M after each start."""
    ends = np.array([np.broadcast_to(number(section), 2) for section in road.sections], float)
    starts = np.array([section.start_m for section in road.sections])
    here = road.section_indices(station)
    before = here - 1 if road.closed else np.maximum(here - 1, 0)
    first, last = ends[here].T
    value = first if np.array_equal(first, last) else first + (last - first) * road.section_shares(station)
    run = (station % road.length_m if road.closed else station) - starts[here]
    share = np.clip(run / TAPER_M, 0, 1)
    old = np.where(here == before, ends[here, 0], ends[before, 1])
    return np.asarray((1 - share) * old + share * value)


def edges_m(road: Road, station: Array) -> tuple[Array, Array]:
    """Distances of the right and of the left edge of the carriageway from the reference line, unworn."""
    half_m = road.widths_at(station) / 2
    right = half_m + blend_fields(road, station, lambda s: _beyond_m(road, s, -1))
    left = half_m + blend_fields(road, station, lambda s: _beyond_m(road, s, 1))
    return right, left


def _beyond_m(road: Road, section: Section, side: int) -> tuple[float, float]:
    """Width of the carriageway beyond the kept lane on one side, at the start and the end of a section."""
    lanes, paved_m = section.left_lanes, section.paved_left_m
    if side < 0:
        lanes, paved_m = section.right_lanes, section.paved_right_m
    default_m = road.settings.lane_width_m
    ends = [section.lane_width_m_at_ends(side * k, default_m) or (0.0, 0.0) for k in range(1, len(lanes) + 1)]
    return paved_m + sum(start for start, _ in ends), paved_m + sum(end for _, end in ends)
