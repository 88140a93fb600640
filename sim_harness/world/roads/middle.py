"""The middle of a road, between its outermost lanes: the reference line of cars with ``corridor: road`` (V03)."""

from numpy.typing import ArrayLike

from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.lanes import edge_m
from sim_harness.world.roads.road import FootPoint, Road
from trepid.car.vehicle import Corridor, Vehicle
from trepid.config import InputError
from trepid.types import Array

CONSTANT_WITHIN_M = 0.01


class MiddleOfRoad(Road):
    """A road whose offsets count from a line ``aside_m`` to the left of the middle of its kept lane.

    The corridor along that line is as wide as the lane. Stations are those of the road.
    """

    def __init__(self, road: Road, aside_m: float) -> None:
        super().__init__(road.settings)
        self._aside_m = aside_m
        self.max_curvature_1pm /= 1 - abs(aside_m) * self.max_curvature_1pm

    def position(self, station_m: float, offset_m: float) -> tuple[float, float]:
        """(x, y) of the point ``offset_m`` to the left of the middle."""
        return super().position(station_m, offset_m + self._aside_m)

    def curvature_at(self, station_m: float) -> float:
        """Curvature [1/m] of the middle, κ/(1 - κ·d) at the distance d from the lane."""
        curvature_1pm = super().curvature_at(station_m)
        return curvature_1pm / (1 - curvature_1pm * self._aside_m)

    def foot_point(self, x_m: float, y_m: float, *, near_station_m: float | None = None) -> FootPoint:
        """The foot point on the middle: near ``near_station_m``, else the nearest."""
        foot = super().foot_point(x_m, y_m, near_station_m=near_station_m)
        curvature_1pm = foot.curvature_1pm / (1 - foot.curvature_1pm * self._aside_m)
        return foot._replace(offset_m=foot.offset_m - self._aside_m, curvature_1pm=curvature_1pm)

    def positions(self, station_m: ArrayLike, offset_m: ArrayLike) -> Array:
        """(x, y) of n points, shape (n, 2)."""
        return super().positions(station_m, offset_m + self._aside_m)  # type: ignore[operator]

    def nearest_coordinates(self, points_m: ArrayLike, *, steps: int = 4) -> Array:
        """(station, offset) of the nearest foot points of n points (x, y), shape (n, 2)."""
        return super().nearest_coordinates(points_m, steps=steps) - (0.0, self._aside_m)


def followed_road(road: Road, vehicle: Vehicle) -> Road:
    """``road`` as ``vehicle`` follows it: itself, or its middle. Raises InputError where it has no such line."""
    if vehicle.corridor is Corridor.LANE:
        return road
    places = [place for section in road.sections for place in middle_m(section, road.settings.lane_width_m)]
    if max(places) - min(places) > CONSTANT_WITHIN_M:
        raise InputError(
            f"corridor: road of vehicle.yaml: the middle of the road {road.name} moves aside by"
            f" {max(places) - min(places):.2f} m where its lanes change; expected the same lanes all along"
        )
    if abs(places[0]) * road.max_curvature_1pm >= 1.0:
        raise InputError(
            f"corridor: road of vehicle.yaml: the bends of the road {road.name} are too tight for it"
        )
    return MiddleOfRoad(road, places[0])


def middle_m(section: Section, lane_width_m: float) -> tuple[float, float]:
    """Offset of the middle between the outer lines at the start and the end of a section, + = left of the lane."""
    left = edge_m(section, len(section.lanes_to_the_left), lane_width_m)
    if section.right_lanes:
        right = edge_m(section, -len(section.right_lanes), lane_width_m)
    else:
        first, last = edge_m(section, 0, lane_width_m)
        right = -first, -last
    return (left[0] + right[0]) / 2, (left[1] + right[1]) / 2
