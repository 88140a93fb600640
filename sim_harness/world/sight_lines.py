"""Straight lines of sight over the ground of a road: what its walls and crests leave free."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sim_harness.world.roads.features import TRUNK_M, Wall, WallKind
from sim_harness.world.roads.road import Road
from trepid.types import Array, Mask

WALL_M = 3.0  # of a straight piece of a wall
PROFILE_M = 1.0  # between the places at which the ground is compared with the line


class Spot(NamedTuple):
    """A point near a road."""

    station_m: float
    x_m: float
    y_m: float
    up_m: float  # above the ground


class SightLines:
    """The lines of sight along one road."""

    def __init__(self, road: Road) -> None:
        self._road = road
        self._walls, self._stations_m = wall_faces(road)

    @property
    def hide_nothing(self) -> bool:
        """Whether every line is free: a flat road without walls."""
        return self._road.flat and not len(self._walls)

    def walls_from(self, station_m: float, reach_m: float) -> Array:
        """The faces (n, 5) of the walls beside the road from a station on."""
        if not len(self._walls):
            return self._walls
        ahead_m = self._stations_m - station_m
        if self._road.closed:
            ahead_m = ahead_m % self._road.length_m
        return self._walls[(ahead_m > -WALL_M) & (ahead_m < reach_m)]

    def are_free(self, eye: Spot, spot: Spot) -> bool:
        """Whether the line from ``eye`` to ``spot``, ahead of it, meets neither a wall nor the ground."""
        if self.hide_nothing:
            return True
        ahead_m = spot.station_m - eye.station_m
        if self._road.closed:
            ahead_m = ahead_m % self._road.length_m
        count = max(math.ceil(abs(ahead_m) / PROFILE_M), 1)
        share = np.arange(count + 1) / count
        ground_m = self._road.heights_at(eye.station_m + share * ahead_m)
        low_m, high_m = float(ground_m[0]) + eye.up_m, float(ground_m[-1]) + spot.up_m
        if (ground_m > low_m + share * (high_m - low_m)).any():
            return False
        start, end = np.array([eye.x_m, eye.y_m, low_m]), np.array([[spot.x_m, spot.y_m, high_m]])
        return not meet(start, end, self.walls_from(eye.station_m, ahead_m))[0]


def wall_faces(road: Road) -> tuple[Array, Array]:
    """The faces of all walls of a road, x, y of both ends and the height of the top, (n, 5), and their stations."""
    faces, stations_m = [np.empty((0, 5))], [np.empty(0)]
    for wall in road.settings.walls:
        for starts_m, ends_m, corners in _strips(road, wall):
            tops_m = road.heights_at((starts_m + ends_m) / 2) + wall.tall_m
            faces.append(np.column_stack([*corners, tops_m]))
            stations_m.append(starts_m)
    return np.concatenate(faces), np.concatenate(stations_m)


def _strips(road: Road, wall: Wall) -> Iterator[tuple[Array, Array, tuple[Array, Array]]]:
    """Stations where the upright strips of a wall start and end, and their corners in plan, by side.

    A trunk has two strips that cross; crowns are above every line from a lens to the ground near it.
    """
    if wall.kind is WallKind.TREES:
        half_m = TRUNK_M / 2
        starts_m, ends_m = wall.trunks_m - half_m, wall.trunks_m + half_m
        for sign in wall.signs:
            aside_m = wall.aside_m(road.widths_at(wall.trunks_m), sign)
            yield starts_m, ends_m, (road.positions(starts_m, aside_m), road.positions(ends_m, aside_m))
            near, far = (road.positions(wall.trunks_m, aside_m + off_m) for off_m in (-half_m, half_m))
            yield starts_m, ends_m, (near, far)
        return
    count = max(math.ceil((wall.to_m - wall.from_m) / WALL_M), 1)
    stations = np.linspace(wall.from_m, wall.to_m, count + 1)
    for sign in wall.signs:
        places = road.positions(stations, wall.aside_m(road.widths_at(stations), sign))
        yield stations[:-1], stations[1:], (places[:-1], places[1:])


def box_faces(corners_m: Sequence[tuple[float, float]], top_m: float) -> list[tuple[float, ...]]:
    """The four faces of an upright box with these corners, in order."""
    return [(*corners_m[i], *corners_m[(i + 1) % 4], top_m) for i in range(4)]


def meet(eye_m: Array, places_m: Array, faces: Array) -> Mask:
    """Whether the lines from ``eye_m`` (x, y, z) to places (n, 3) meet an upright face (faces, 5), (n,).

    In plan eye + t·(place - eye) = end + u·(other end - end), with t and u in 0..1; there the line is not above
    the face.
    """
    ray = places_m - eye_m
    start, along = faces[:, :2] - eye_m[:2], faces[:, 2:4] - faces[:, :2]
    across = ray[:, None, 0] * along[:, 1] - ray[:, None, 1] * along[:, 0]
    across = np.where(across == 0, np.nan, across)  # parallel: never met
    with np.errstate(invalid="ignore"):
        t = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
        u = (start[:, 0] * ray[:, None, 1] - start[:, 1] * ray[:, None, 0]) / across
        low = eye_m[2] + t * ray[:, None, 2] <= faces[:, 4]
        met = (t > 0) & (t <= 1) & (u >= 0) & (u <= 1) & low
    return np.asarray(met.any(axis=1), np.bool_)
