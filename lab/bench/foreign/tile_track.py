"""A closed track of floor tiles: its floor from above, and the right half of its road, by length.

The place of the car is counted along nominal pieces, straights and arcs; the lane lies beside them as each tile
shows it (:mod:`.tile_lane`).

A tile shows a straight road or a quarter of a circle around one of its corners; a word beside its kind, N, W, S or
E, is the direction in which it is entered: N as it is drawn, W turned by a quarter to the left. The middle of the
road is the middle of the tile. The first row of a map is the northernmost one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from lab.bench.foreign.tile_lane import picture, profile
from trepid.config import InputError, read
from trepid.types import Image

TURNED = "NWSE"  # by quarters to the left
TILE_PX = 320  # of the floor, per tile
SLOPE_M = 0.03  # to either side, over which the slope of the lane is taken
HALF = 0.2165  # from the middle of the road to the nominal middle of its right half, by the size of a tile


class Piece(NamedTuple):
    """The part of the lane on one tile: from a pose along an arc."""

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    curvature_1pm: float
    kind: str  # of its tile
    reverse: bool  # driven from where its drawing ends

    @property
    def turn(self) -> int:
        """1 to the left, -1 to the right, 0."""
        return int(np.sign(self.curvature_1pm))


class LanePlace(NamedTuple):
    """A place in the lane."""

    number: int  # of the piece
    along_m: float  # on it
    offset_m: float
    heading_rad: float
    width_m: float


@dataclass(frozen=True)
class TileTrack:
    """The track; x to the east and y to the north, from the south-western corner of the map."""

    tiles: tuple[tuple[str, ...], ...]  # rows from north to south
    tile_m: float
    pieces: tuple[Piece, ...]
    looks: Path  # with a folder per kind of tile

    @property
    def length_m(self) -> float:
        """Of a lap."""
        return math.fsum(piece.length_m for piece in self.pieces)

    def draw(self) -> Image:
        """The floor, BGR, north at the top."""
        rows = [np.hstack([_tile(self.looks, name) for name in row]) for row in self.tiles]
        return np.ascontiguousarray(np.vstack(rows))

    def place(self, x_m: float, y_m: float, yaw_rad: float, near: int) -> LanePlace:
        """The place of a pose; ``near``: number of the last piece."""
        found = []
        for step in (-1, 0, 1, 2):
            number = (near + step) % len(self.pieces)
            along_m, offset_m, heading_rad = _local(self.pieces[number], x_m, y_m)
            beyond_m = max(-along_m, along_m - self.pieces[number].length_m, 0.0)
            found.append((beyond_m + abs(offset_m), number, along_m, offset_m, heading_rad))
        _, number, along_m, offset_m, heading_rad = min(found)
        aside_m, slope, width_m = self.lane(number, along_m)
        error_rad = math.remainder(yaw_rad - heading_rad - math.atan(slope), math.tau)
        return LanePlace(number, along_m, offset_m - aside_m, error_rad, width_m)

    def lane(self, number: int, along_m: float) -> tuple[float, float, float]:
        """Middle of the lane to the left of a nominal piece [m], its slope, and the width of the lane [m]."""
        piece = self.pieces[number]
        seen = profile(self.looks / piece.kind / "texture.jpg", reverse=piece.reverse, turn=piece.turn)
        nominal = 0.5 + HALF * (piece.turn or 1)
        aside_m = (seen.middle - nominal) * self.tile_m * (-piece.turn or -1)
        ways_m = np.linspace(0.0, piece.length_m, len(aside_m))
        here_m, there_m = (float(np.interp(along_m + d, ways_m, aside_m)) for d in (-SLOPE_M, SLOPE_M))
        width_m = float(np.interp(along_m, ways_m, seen.width)) * self.tile_m
        return (here_m + there_m) / 2, (there_m - here_m) / (2 * SLOPE_M), width_m

    def curvature_at(self, number: int, along_m: float) -> float:
        """Curvature [1/m] ``along_m`` after the beginning of a piece."""
        while along_m > self.pieces[number].length_m:
            along_m -= self.pieces[number].length_m
            number = (number + 1) % len(self.pieces)
        return self.pieces[number].curvature_1pm


def read_track(path: Path, looks: Path) -> TileTrack:
    """The track of a map file with the tiles in the folder ``looks``.

    Raises InputError for a map with junctions, and for one that does not close.
    """
    try:
        content: dict[str, Any] = read(path)
        tiles = tuple(tuple(map(str, row)) for row in content["tiles"])
        tile_m = float(content["tile_size"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: no map of tiles: {error!r}") from error
    if "way" in "".join(map("".join, tiles)):
        raise InputError(f"{path}: has junctions; this bench drives closed tracks without them")
    return TileTrack(tiles, tile_m, tuple(_pieces(path, tiles, tile_m)), looks)


def _pieces(path: Path, tiles: Sequence[Sequence[str]], tile_m: float) -> list[Piece]:
    """The lane from the first bend on, in the direction of its tile."""
    at = {(x, len(tiles) - 1 - row): name for row, line in enumerate(tiles) for x, name in enumerate(line)}
    start = next((cell for cell, name in at.items() if name.startswith("curve")), None)
    if start is None:
        raise InputError(f"{path}: has no bend")
    cell, heading = start, TURNED.index(at[start][-1])
    pieces: list[Piece] = []
    while not pieces or (cell, heading) != (start, TURNED.index(at[start][-1])):
        name = at.get(cell, "nothing")
        turn = _turn(name, heading)
        if turn is None or len(pieces) > len(at):
            raise InputError(f"{path}: the road does not close: {name!r} at column {cell[0]}, row {cell[1]}")
        pieces.append(_piece(cell, heading, turn, tile_m, name))
        heading = (heading + turn) % 4
        east, north = _step(heading)
        cell = (cell[0] + east, cell[1] + north)
    return pieces


def _step(heading: int) -> tuple[int, int]:
    """East and north, by quarters to the left of north."""
    return ((0, 1), (-1, 0), (0, -1), (1, 0))[heading]


def _turn(name: str, heading: int) -> int | None:
    """Quarters to the left on a tile that is entered with ``heading``; None where no road begins there."""
    kind, _, word = name.partition("/")
    if word not in tuple(TURNED):
        return None
    drawn = (heading - TURNED.index(word)) % 4
    if kind == "straight":
        return 0 if drawn % 2 == 0 else None
    left = {"curve_left": {0: 1, 3: -1}, "curve_right": {0: -1, 1: 1}}.get(kind, {})
    return left.get(drawn)


def _piece(cell: tuple[int, int], heading: int, turn: int, tile_m: float, name: str) -> Piece:
    """The right half of the road on a tile."""
    yaw_rad = math.pi / 2 * (1 + heading)
    east, north = _step(heading)
    x_m = (cell[0] + 0.5 - 0.5 * east + HALF * north) * tile_m
    y_m = (cell[1] + 0.5 - 0.5 * north - HALF * east) * tile_m
    radius_m = (0.5 + HALF * turn) * tile_m
    length_m = math.pi / 2 * radius_m if turn else tile_m
    kind, _, word = name.partition("/")
    return Piece(x_m, y_m, yaw_rad, length_m, turn / radius_m, kind, heading != TURNED.index(word))


def _local(piece: Piece, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Way along a piece, offset to its left, and its heading there."""
    apart = complex(x_m - piece.x_m, y_m - piece.y_m) * complex(
        math.cos(piece.yaw_rad), -math.sin(piece.yaw_rad)
    )
    if piece.curvature_1pm == 0.0:
        return apart.real, apart.imag, piece.yaw_rad
    radius_m = 1 / piece.curvature_1pm
    out = complex(apart.real, apart.imag - radius_m)
    turned_rad = math.atan2(out.real, -out.imag) if radius_m > 0 else math.atan2(out.real, out.imag)
    along_m = abs(radius_m) * turned_rad
    offset_m = math.copysign(1.0, radius_m) * (abs(radius_m) - abs(out))
    return along_m, offset_m, piece.yaw_rad + along_m / radius_m


def _tile(looks: Path, name: str) -> Image:
    """The picture of a tile, turned. Raises InputError where the package has none."""
    kind, _, word = name.partition("/")
    image = picture(looks / kind / "texture.jpg")
    image = np.asarray(cv2.resize(image, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA), np.uint8)
    return np.ascontiguousarray(np.rot90(image, TURNED.index(word) if word else 0))
