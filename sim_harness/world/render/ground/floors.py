"""Floors of rooms on which tracks are taped: planks, tiles, loops of carpet, and patches of light from windows.

The pattern lies in the world and not along the road. Lengths are those of the reference world of lanes of 3.3 m, in
which a lane of 0.22 m is 15 times as wide: planks of 9 cm, tiles of 30 cm.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim_harness.world.roads.appearance import Verge
from sim_harness.world.roads.road import Road
from trepid.types import Array

FLOORS = frozenset({Verge.WOOD, Verge.MAT, Verge.LIGHT_FLOOR, Verge.CARPET})
PLANK_M, PLANK_LENGTH_M, PLANK_TONE = 1.35, 13.0, 0.09
JOINT_M, JOINT_TONE = 0.03, 0.45  # of planks: 2 mm wide
TILE_M, TILE_JOINT_M, TILE_JOINT_TONE = 4.5, 0.045, 0.2
LOOP_M, LOOP_TONE = 0.12, 0.12
ROOM_M = 15.0  # from window to window
PANE_M, SILL_M, EDGE_M = (4.0, 6.5), 0.5, 0.3  # size of a patch of light, its cross bar, the blur of its edge
SKEW = 0.5  # of the patches, by the sun
BRIGHTEST = 0.9  # light added by a patch at window_light 1, relative to that of the room


@dataclass(frozen=True)
class Floor:
    """A floor that lies turned by ``turned_rad`` in the world."""

    verge: Verge
    window_light: float
    turned_rad: float
    shift_m: tuple[float, float]
    seed: int

    def tone(self, x_m: Array, y_m: Array, pixel_m: float) -> Array:
        """Brightness of the pixels in columns at ``x_m`` and rows at ``y_m`` around 1, (rows, columns)."""
        along, across = self._coordinates(x_m, y_m)
        match self.verge:
            case Verge.WOOD:
                row = np.floor(across / PLANK_M)
                end = along + PLANK_LENGTH_M * _chance(row, self.seed)
                plank = row * 977 + np.floor(end / PLANK_LENGTH_M)
                tone = 1 + PLANK_TONE * (2 * _chance(plank, self.seed + 1) - 1)
                tone *= 1 - JOINT_TONE * _joint(across, PLANK_M, JOINT_M, pixel_m)
                tone *= 1 - JOINT_TONE * _joint(end, PLANK_LENGTH_M, JOINT_M, pixel_m)
            case Verge.LIGHT_FLOOR:
                joint = np.maximum(
                    _joint(across, TILE_M, TILE_JOINT_M, pixel_m),
                    _joint(along, TILE_M, TILE_JOINT_M, pixel_m),
                )
                tone = 1 - TILE_JOINT_TONE * joint
            case Verge.CARPET:
                fine = LOOP_TONE * min(1.0, (LOOP_M / 2 / pixel_m) ** 2)
                cell = np.floor(along / LOOP_M) * 7919 + np.floor(across / LOOP_M)
                tone = 1 + fine * (2 * _chance(cell, self.seed) - 1)
            case _:
                tone = np.ones_like(along)
        return np.asarray(tone, np.float64)

    def light(self, x_m: Array, y_m: Array) -> Array:
        """Light through windows beside that of the room, (rows, columns)."""
        along, across = self._coordinates(x_m, y_m)
        along = (along + SKEW * across) % ROOM_M - ROOM_M / 2
        across = across % ROOM_M - ROOM_M / 2
        inside = [PANE_M[0] / 2 - np.abs(along), PANE_M[1] / 2 - np.abs(across), np.abs(along) - SILL_M / 2]
        share = np.clip(np.minimum.reduce(inside) / EDGE_M + 0.5, 0, 1)
        return np.asarray(self.window_light * BRIGHTEST * share, np.float64)

    def _coordinates(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
        x, y = np.meshgrid(x_m + self.shift_m[0], y_m + self.shift_m[1])
        return cos * x + sin * y, cos * y - sin * x


def floor_of(road: Road, *, seed: int) -> Floor | None:
    """The floor of the first section of ``road`` that has one, or patches of light; None outdoors."""
    rng = np.random.default_rng((seed, 7))
    for section in road.sections:
        if section.verge in FLOORS or section.window_light:
            shift = float(rng.uniform(0, 50)), float(rng.uniform(0, 50))
            return Floor(section.verge, section.window_light, float(rng.uniform(0, math.tau)), shift, seed)
    return None


def _chance(number: Array, seed: int) -> Array:
    """A number in [0, 1) for each whole ``number``, the same in every tile."""
    return np.asarray(np.modf(np.abs(np.sin(number * 12.9898 + (seed + 1) * 78.233) * 43758.5453))[0])


def _joint(place_m: Array, every_m: float, width_m: float, pixel_m: float) -> Array:
    """Share of each pixel that a joint covers."""
    away = np.abs((place_m + every_m / 2) % every_m - every_m / 2)
    return np.asarray(np.clip((width_m / 2 - away) / pixel_m + 0.5, 0, min(1.0, width_m / pixel_m)))
