"""Lanes parallel to the ego lane, with the four methods of highway-env's ``AbstractLane``.

A lane's centre has the offset d(s) from the reference line, linear along each section. Offsets are measured
perpendicular to the reference line, so lane and road coordinates have the same stations.
Source of the four methods: Leurent, highway-env (2018), ``road/lane.py``.
"""

import math

from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.road import Road

ABSENT = (math.nan, math.nan)
Ends = tuple[float, float]


class RoadLane:
    """Lane ``index`` of a road: 0 the ego lane, 1 the next to the left, -1 the next to the right.

    All methods return NaN at stations where the road has no such lane.
    """

    def __init__(self, road: Road, index: int) -> None:
        """Raises ValueError when no section of the road has the lane."""
        self.road = road
        self.index = index
        default_m = road.settings.lane_width_m
        self._centres = {id(section): centre_m(section, index, default_m) for section in road.sections}
        self._widths = {
            id(section): section.lane_width_m_at_ends(index, default_m) or ABSENT for section in road.sections
        }
        if all(math.isnan(start_m) for start_m, _ in self._widths.values()):
            raise ValueError(f"{road.name} has no lane {index} in any section")

    def position(self, station_m: float, offset_m: float) -> tuple[float, float]:
        """(x, y) of the point ``offset_m`` to the left of the lane's centre."""
        return self.road.position(station_m, self.centre_at(station_m) + offset_m)

    def local_coordinates(
        self, x_m: float, y_m: float, *, near_station_m: float | None = None
    ) -> tuple[float, float]:
        """(station, offset from the lane's centre) of a point; as ``Road.local_coordinates``."""
        station_m, offset_m = self.road.local_coordinates(x_m, y_m, near_station_m=near_station_m)
        return station_m, offset_m - self.centre_at(station_m)

    def heading_at(self, station_m: float) -> float:
        """Heading of the lane's centre: θ + atan(d' / (1 - κ d))."""
        start_m, end_m = self._centres[id(self.road.section_at(station_m))]
        length_m = self.road.section_length_m(station_m)
        along = 1 - self.road.curvature_at(station_m) * self.centre_at(station_m)
        return self.road.heading_at(station_m) + math.atan((end_m - start_m) / length_m / along)

    def width_at(self, station_m: float) -> float:
        return self._between(self._widths, station_m)

    def centre_at(self, station_m: float) -> float:
        """Offset of the lane's centre from the reference line [m]."""
        return self._between(self._centres, station_m)

    def _between(self, ends: dict[int, Ends], station_m: float) -> float:
        start, end = ends[id(self.road.section_at(station_m))]
        return start if start == end else start + (end - start) * self.road.section_share(station_m)


def centre_m(section: Section, index: int, default_m: float) -> Ends:
    """Offset of a lane's centre at the start and at the end of a section; NaN where there is no such lane."""
    side = 1 if index > 0 else -1
    inner = [section.lane_width_m_at_ends(side * k, default_m) or ABSENT for k in range(abs(index) + 1)]
    start_m, end_m = (
        0.0 if index == 0 else side * (ends[0] / 2 + sum(ends[1:-1]) + ends[-1] / 2)
        for ends in zip(*inner, strict=True)
    )
    return start_m, end_m


def edge_m(section: Section, index: int, default_m: float) -> Ends:
    """Offset of a lane's outer edge at the start and at the end of a section; of lane 0 the left edge."""
    centre = centre_m(section, index, default_m)
    width = section.lane_width_m_at_ends(index, default_m) or ABSENT
    side = 1 if index >= 0 else -1
    return centre[0] + side * width[0] / 2, centre[1] + side * width[1] / 2
