"""Paints lines along the road: solid, dashed, double; worn, damaged, interrupted."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim_harness.world.render.ground.strip_grid import (
    PIXEL_M,
    ROWS,
    Grid,
    Stretch,
    Textures,
    coverage,
    distance_along,
    paint_left,
)
from sim_harness.world.roads.appearance import Marking, Paint, Section, Stroke, Surface
from sim_harness.world.roads.features import JunctionKind, Side
from sim_harness.world.roads.lanes import edge_m
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats, Image

PAINT_BGR = {
    Paint.WHITE: (218, 222, 224),
    Paint.YELLOW: (62, 178, 226),
    Paint.BLUE: (168, 96, 34),
    Paint.BLACK: (38, 36, 36),
}
PAIRS = {
    Stroke.DOUBLE_SOLID: (Stroke.SOLID, Stroke.SOLID),
    Stroke.DOUBLE_DASHED: (Stroke.DASHED, Stroke.DASHED),
    Stroke.SOLID_DASHED: (Stroke.SOLID, Stroke.DASHED),
    Stroke.DASHED_SOLID: (Stroke.DASHED, Stroke.SOLID),
}
CUT_EVERY_M = 1.6  # piece of the line with at most one cut
BESIDE_PX = 16  # columns of a pixel of the coarsest level
CRACKS_PER_M = 1.5  # at damage 1


@dataclass(frozen=True)
class Line:
    """A line of a section: its offset at the section's start and end; its side if it is an edge line."""

    marking: Marking
    ends_m: tuple[float, float]
    side: Side | None = None


def lines_of(section: Section, lane_width_m: float) -> list[Line]:
    """All painted lines: of the kept lane, of the lanes to the left, of the lanes to the right."""
    lefts, rights = section.lanes_to_the_left, section.right_lanes
    left = edge_m(section, 0, lane_width_m)
    lines = [
        Line(section.left, left, None if lefts else Side.LEFT),
        Line(section.right, (-left[0], -left[1]), None if rights else Side.RIGHT),
        Line(section.middle, (0.0, 0.0)),
    ]
    for side, sign, lanes in ((Side.LEFT, 1, lefts), (Side.RIGHT, -1, rights)):
        for number, lane in enumerate(lanes, start=1):
            edge = edge_m(section, sign * number, lane_width_m)
            lines.append(Line(lane.marking, edge, side if number == len(lanes) else None))
    return [line for line in lines if line.marking.stroke != Stroke.NONE]


class LinePainter:
    def __init__(self, road: Road, grid: Grid, textures: Textures, *, seed: int) -> None:
        self._road, self._grid, self._textures, self._seed = road, grid, textures, seed
        self._lines = {
            id(section): lines_of(section, road.settings.lane_width_m) for section in road.sections
        }

    def paint(self, colour: Image, here: Stretch) -> None:
        for number, line in enumerate(self._lines[id(here.section)]):
            open_ = self._uninterrupted_share(line, here.station)
            for shift_m, stroke in _strokes(line.marking):
                along = _dashes(here.station - here.section.start_m, line.marking, stroke)
                along = along if open_ is None else along * open_
                self._stroke(colour, here, line, shift_m, along, number)

    def _stroke(
        self, colour: Image, here: Stretch, line: Line, shift_m: float, along: Array, number: int
    ) -> None:
        marking, grid = line.marking, self._grid
        first, last = line.ends_m
        centre = np.array([first]) if first == last else first + (last - first) * here.share
        centre = centre + shift_m if shift_m else centre
        half_m = marking.width_m / 2
        columns = grid.columns_between(float(centre.min()) - half_m, float(centre.max()) + half_m)
        across = coverage(grid.offsets[columns], centre[:, None], marking.width_m, PIXEL_M)
        fine = here.part(self._textures.blotch)[:, columns]
        wear = paint_left(fine, here.part(self._textures.wave)[:, columns], marking.wear)
        cover = (across * along[:, None] * wear)[:, :, None].astype(np.float32)
        if marking.damage:
            cover *= self._intact(here, columns, centre, marking, number)[:, :, None]
        if here.section.surface == Surface.FLOOR:
            self._lay_tape(colour, columns, cover[:, :, 0], marking.paint)
        else:
            colour[:, columns, :3] = paint_over(colour[:, columns, :3], cover, marking.paint, fine)

    @staticmethod
    def _lay_tape(colour: Image, columns: slice, cover: Floats, paint: Paint) -> None:
        """Tape covers the floor, which is painted elsewhere: its colour beyond its edges, where the mask is 0, too.

        Coarser levels are averages, which would else mix it with the ground below the strip.
        """
        beside = slice(max(columns.start - BESIDE_PX, 0), columns.stop + BESIDE_PX)
        colour[:, beside, :3] = PAINT_BGR[paint]
        colour[:, columns, 3] = np.maximum(colour[:, columns, 3], np.asarray(255 * cover, np.uint8))

    def _uninterrupted_share(self, line: Line, station: Array) -> Array | None:
        """Share of each row outside all gaps and junctions; None without any."""
        gaps = [((a + b) / 2, b - a) for a, b in (*line.marking.gaps_m, *self._mouths(line))]
        away = [(distance_along(self._road, station, centre), length) for centre, length in gaps]
        covers = [coverage(d, 0.0, length, PIXEL_M) for d, length in away if np.abs(d).min() < length]
        return 1 - np.maximum.reduce(covers) if covers else None

    def _mouths(self, line: Line) -> Iterator[tuple[float, float]]:
        """Intervals of stations in which side roads interrupt the line."""
        for junction in self._road.settings.junctions:
            crossed = junction.kind == JunctionKind.INTERSECTION
            if crossed if line.side is None else junction.side in (line.side, Side.BOTH):
                yield junction.mouth_m

    def _intact(self, here: Stretch, columns: slice, centre: Array, marking: Marking, number: int) -> Floats:
        """1 where the line is intact, 0 where it is cut out or cracked; equal for every part of a block."""
        rng = np.random.default_rng((self._seed, 4, here.index % 2**32, number))
        whole = np.ones((ROWS, columns.stop - columns.start), np.float32)
        piece = round(CUT_EVERY_M / PIXEL_M)
        for start in range(0, ROWS, piece):
            is_cut, where, length = rng.uniform(0, 1, 3)
            if is_cut < marking.damage:
                length_px = round(piece * (0.3 + 0.7 * length) * (0.4 + 0.6 * marking.damage))
                first = start + round((piece - length_px) * where)
                whole[first : first + length_px] = 0
        for row in rng.integers(0, ROWS, round(CRACKS_PER_M * ROWS * PIXEL_M * marking.damage)):
            slope = int(rng.integers(-2, 3))
            for column in range(whole.shape[1]):
                at = int(row) + slope * column
                whole[max(at, 0) : max(at + 2, 0), column] = 0
        return whole[here.rows]


def paint_over(bare: Image, cover: Floats | Array, paint: Paint, fine: Floats) -> Floats:
    """``bare`` under ``cover`` (rows, columns, 1) of slightly uneven paint."""
    bgr = np.array(PAINT_BGR[paint], np.float32) * (1 + 0.04 * fine[:, :, None])
    colour = bare.astype(np.float32)
    return np.clip(colour + cover * (bgr - colour), 0, 255)


def _strokes(marking: Marking) -> list[tuple[float, Stroke]]:
    """Shift to the left and pattern of each line of a marking."""
    if marking.stroke not in PAIRS:
        return [(0.0, marking.stroke)]
    left, right = PAIRS[marking.stroke]
    apart_m = (marking.width_m + marking.spacing_m) / 2
    return [(apart_m, left), (-apart_m, right)]


def _dashes(run_m: Array, marking: Marking, stroke: Stroke) -> Array:
    """Share of each row that is painted."""
    if stroke == Stroke.SOLID:
        return np.ones(len(run_m))
    phase = run_m % (marking.dash_m + marking.gap_m)
    return coverage(phase, marking.dash_m / 2, marking.dash_m, PIXEL_M)
