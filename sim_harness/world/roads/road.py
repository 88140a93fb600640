"""The road: a reference line of clothoids, and the road's appearance along it.

The reference line is the centre of the lane that the vehicle keeps, which spans the offsets [-w/2, w/2]. Stations
run along the line, offsets are positive to the left. A closed road repeats with its length; an open road continues
straight beyond both ends.

On a clothoid the heading is θ(s) = θ₀ + κ₀ s + κ' s²/2 and the position is the integral of (cos θ, sin θ), taken
here by three-point Gauss-Legendre quadrature over intervals of at most half a metre and half a radian. For radii
above 5 m that is exact to 1e-9 m per kilometre.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Annotated, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from scipy.spatial import cKDTree

from sim_harness.world.roads.appearance import LaneWidth, Section
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint, RoadHeight
from sim_harness.world.roads.features import Junction, MarkKind, RoadMark, SpeedHump, Wall
from trepid.bounds import at_least, within
from trepid.config import Settings, wrong_at
from trepid.scale import PUBLIC_LANE_M, REFERENCE_LANE_M, scaled_settings
from trepid.types import Array

KNOT_STEP_M = 0.5
GAUSS = ((0.5 - math.sqrt(0.15), 5 / 18), (0.5, 8 / 18), (0.5 + math.sqrt(0.15), 5 / 18))  # nodes, weights
LEAD_IN_M = 1.0
LAST_STEP_M = 1e-4
MAX_STEPS = 30
MAX_STEP_M = 5.0
MIN_SLOPE = 0.2
CLOSED_WITHIN_M, CLOSED_WITHIN_RAD = 1e-3, 1e-4

SAME_WIDTH_M = 1e-9
Curvature = Annotated[float, Field(ge=-10, le=10)]  # 1/m
TIGHTEST_1PM = 1.0  # times the scale of the lanes: no car turns within R = 1 m
KNOT_TURN_RAD = 0.5  # most between two knots


class Segment(Settings):
    """A piece of the reference line: line, arc or clothoid."""

    length_m: Annotated[float, Field(gt=0, le=100_000)]
    # Constant, or (at the start, at the end); + = bends left.
    curvature_1pm: Curvature | tuple[Curvature, Curvature] = 0.0

    @property
    def start_curvature_1pm(self) -> float:
        return self.curvature_1pm[0] if isinstance(self.curvature_1pm, tuple) else self.curvature_1pm

    @property
    def end_curvature_1pm(self) -> float:
        return self.curvature_1pm[1] if isinstance(self.curvature_1pm, tuple) else self.curvature_1pm

    @property
    def tightest_1pm(self) -> float:
        """Greatest magnitude of the curvature [1/m]."""
        return max(abs(self.start_curvature_1pm), abs(self.end_curvature_1pm))


def _is_part(some: Sequence[float], others: Sequence[float]) -> bool:
    """Whether all of ``some`` are among ``others``, in their order."""
    rest = iter(others)
    return all(any(abs(one - other) <= SAME_WIDTH_M for other in rest) for one in some)


class RoadSettings(Settings):
    """A road file, ``config/roads/*.yaml``."""

    name: str
    closed: bool
    lane_width_m: LaneWidth  # of the lane that the vehicle keeps; a section may override it
    sun_azimuth_rad: float = 0.0  # direction of the low sun in the road's coordinates (x east, y north)
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)]
    sections: Annotated[tuple[Section, ...], Field(min_length=1)]
    marks: tuple[RoadMark, ...] = ()
    humps: tuple[SpeedHump, ...] = ()
    junctions: tuple[Junction, ...] = ()
    walls: tuple[Wall, ...] = ()
    elevation: tuple[ElevationPoint, ...] = ()  # at rising stations; none: flat
    bank: tuple[BankPoint, ...] = ()  # at rising stations; none: level across

    @property
    def scale(self) -> float:
        """Of its details to those of a public road: w/:data:`REFERENCE_LANE_M` for lanes of models, w wide."""
        narrow = self.lane_width_m < PUBLIC_LANE_M
        return self.lane_width_m / REFERENCE_LANE_M if narrow else 1.0

    @model_validator(mode="after")
    def _is_continuous(self) -> Self:
        following = self.segments[1:] + (self.segments[:1] if self.closed else ())
        for number, (here, there) in enumerate(zip(self.segments, following, strict=False)):
            if abs(here.end_curvature_1pm - there.start_curvature_1pm) > 1e-9:
                raise wrong_at(
                    ("segments", number),
                    f"curvature jumps from {here.end_curvature_1pm} to {there.start_curvature_1pm} 1/m"
                    f" after segments.{number}; put a clothoid between them",
                )
        return self

    @model_validator(mode="after")
    def _can_be_driven(self) -> Self:
        most_1pm = TIGHTEST_1PM / self.scale
        for number, segment in enumerate(self.segments):
            if segment.tightest_1pm > most_1pm:
                message = (
                    f"{segment.tightest_1pm:g} 1/m is tighter than {most_1pm:g} 1/m, the most for such lanes"
                )
                raise wrong_at(("segments", number, "curvature_1pm"), message)
        return self

    @model_validator(mode="after")
    def _sections_are_in_order(self) -> Self:
        starts = [section.start_m for section in self.sections]
        if starts[0] != 0 or any(a >= b for a, b in pairwise(starts)):
            raise wrong_at(("sections",), f"sections must start at 0 and in rising order, got {starts}")
        length_m = sum(segment.length_m for segment in self.segments)
        if starts[-1] >= length_m:
            raise wrong_at(
                ("sections", len(starts) - 1, "start_m"),
                f"section {self.sections[-1].name!r} starts beyond the end at {length_m:.1f} m",
            )
        return self

    @model_validator(mode="after")
    def _lanes_join(self) -> Self:
        """The kept lane and all lanes that continue have one width at a joint; others open or close there."""
        following = self.sections[1:] + (self.sections[:1] if self.closed else ())
        for number, (here, there) in enumerate(zip(self.sections, following, strict=False), start=1):
            for side in (0, 1, -1):
                before, after = self._widths_m(here, side, 1), self._widths_m(there, side, 0)
                if not (_is_part(before, after) or _is_part(after, before)):
                    pairs = zip(before, after, strict=False)
                    lane = next((k for k, (a, b) in enumerate(pairs) if abs(a - b) > SAME_WIDTH_M), 0)
                    raise wrong_at(
                        ("sections", number % len(self.sections)),
                        f"lane {side * (lane + 1)} jumps from {before[lane]} to {after[lane]} m width at section"
                        f" {there.name!r}; give its width there as [at the start, at the end]",
                    )
        return self

    def _widths_m(self, section: Section, side: int, end: int) -> list[float]:
        """Widths at the start (``end`` 0) or end of the kept lane (``side`` 0), or of the lanes beside it.

        A lane without width there is not listed.
        """
        lanes = section.lanes_to_the_left if side > 0 else section.right_lanes
        indices = [side * (k + 1) for k in range(len(lanes))] if side else [0]
        ends = [section.lane_width_m_at_ends(lane, self.lane_width_m) for lane in indices]
        return [width_m[end] for width_m in ends if width_m is not None and width_m[end] > 0]

    @model_validator(mode="after")
    def _lanes_are_of_one_scale(self) -> Self:
        for number, section in enumerate(self.sections):
            ends = section.lane_width_m_at_ends(0, self.lane_width_m) or ()
            if any((width_m < PUBLIC_LANE_M) != (self.lane_width_m < PUBLIC_LANE_M) for width_m in ends):
                message = f"a road has lanes of models (below {PUBLIC_LANE_M:g} m) or of cars, not both"
                raise wrong_at(("sections", number, "lane_width_m"), message)
        return self

    @model_validator(mode="after")
    def _features_lie_on_the_road(self) -> Self:
        length_m = math.fsum(segment.length_m for segment in self.segments)
        for number, mark in enumerate(self.marks):
            if mark.end_m > length_m:
                message = f"marks.{number} ends at {mark.end_m} m, beyond the road's {length_m:.1f} m"
                raise wrong_at(("marks", number, "at_m"), message)
            section = next(s for s in reversed(self.sections) if s.start_m <= mark.at_m)
            lane = 0 if mark.kind == MarkKind.ZEBRA else mark.lane
            if section.lane_width_m_at_ends(lane, self.lane_width_m) is None:
                message = f"marks.{number}: section {section.name!r} has no lane {lane}"
                raise wrong_at(("marks", number, "lane"), message)
        for number, hump in enumerate(self.humps):
            if hump.end_m > length_m:
                message = f"humps.{number} ends at {hump.end_m:g} m, beyond the road's {length_m:.1f} m"
                raise wrong_at(("humps", number, "at_m"), message)
        for number, junction in enumerate(self.junctions):
            if junction.at_m > length_m:
                message = f"junctions.{number} lies at {junction.at_m} m, beyond the road's {length_m:.1f} m"
                raise wrong_at(("junctions", number, "at_m"), message)
        for number, wall in enumerate(self.walls):
            if wall.to_m > length_m:
                message = f"walls.{number} ends at {wall.to_m} m, beyond the road's {length_m:.1f} m"
                raise wrong_at(("walls", number, "to_m"), message)
            for sign in wall.signs:
                bend_1pm = max(sign * curvature_1pm for curvature_1pm in self._curvatures_beside(wall))
                if bend_1pm * (self.lane_width_m / 2 + wall.distance_m) >= 1:
                    message = (
                        f"walls.{number} lies beyond the centre of a bend of {1 / bend_1pm:.1f} m radius"
                    )
                    raise wrong_at(("walls", number, "distance_m"), message)
        return self

    def _curvatures_beside(self, wall: Wall) -> list[float]:
        """The curvatures at the ends of the segments along a wall."""
        found, start_m = [0.0], 0.0
        for segment in self.segments:
            if start_m < wall.to_m and start_m + segment.length_m > wall.from_m:
                found += [segment.start_curvature_1pm, segment.end_curvature_1pm]
            start_m += segment.length_m
        return found

    @model_validator(mode="after")
    def _profiles_run_forwards(self) -> Self:
        length_m = math.fsum(segment.length_m for segment in self.segments)
        for name, points in (("elevation", self.elevation), ("bank", self.bank)):
            stations = [point.at_m for point in points]
            for number, (before, here) in enumerate(pairwise(stations), start=1):
                if before >= here:
                    message = (
                        f"{name}.{number} lies at {here:g} m, not beyond the point before at {before:g} m"
                    )
                    raise wrong_at((name, number, "at_m"), message)
            if stations and (stations[-1] > length_m or (self.closed and stations[-1] == length_m)):
                message = f"{name} ends at {stations[-1]:g} m; the road is {length_m:.1f} m long"
                if self.closed:
                    message += ", and a closed road returns to its first point by itself"
                raise wrong_at((name, len(stations) - 1, "at_m"), message)
        return self


class FootPoint(NamedTuple):
    """The point of the reference line nearest to a given point."""

    station_m: float
    offset_m: float  # of the given point, + = left
    heading_rad: float  # of the line there
    curvature_1pm: float


class Road(RoadHeight):
    """Reference line, lane and appearance. Immutable; starts at the origin, heading along x."""

    def __init__(self, settings: RoadSettings) -> None:
        """Raises ValueError when a closed road does not close within 1 mm and 1e-4 rad."""
        length_m = math.fsum(segment.length_m for segment in settings.segments)
        super().__init__(settings.elevation, settings.bank, length_m=length_m, closed=settings.closed)
        self.settings = settings
        self.name = settings.name
        self.sections = settings.sections
        self._section_starts = [section.start_m for section in settings.sections]
        self._section_ends = [*self._section_starts[1:], self.length_m]
        self._table = _table(settings.segments, closed=settings.closed)
        self.max_curvature_1pm = max(segment.tightest_1pm for segment in settings.segments)
        self._stations: list[float] = self._table[:, 0].tolist()
        self._intervals: list[list[float]] = self._table.tolist()
        if self.closed:
            x, y, heading, _ = self._pose(self._intervals[-1], self.length_m)
            gap_m, turn_rad = math.hypot(x, y), abs(math.remainder(heading, math.tau))
            if gap_m > CLOSED_WITHIN_M or turn_rad > CLOSED_WITHIN_RAD:
                missed = f"its end misses its start by {gap_m:.4f} m, {turn_rad:.6f} rad"
                raise ValueError(f"{self.name} does not close: {missed}")

    @property
    def in_reference_world(self) -> "Road":
        """The road enlarged to lanes of REFERENCE_LANE_M, with the details of a public road; itself if it is one.

        Lengths that the road file leaves out hold there: a dash of 3 m, paint of 0.12 m.
        """
        enlargement = 1 / self.settings.scale
        if enlargement == 1.0:
            return self
        return Road(scaled_settings(self.settings, enlargement, given_only=True))

    # Scalar methods, for lock-step: floats are ten times faster than arrays of one element.

    def position(self, station_m: float, offset_m: float) -> tuple[float, float]:
        """(x, y) of the point ``offset_m`` to the left of the reference line."""
        x, y, heading, _ = self._pose_at(station_m)
        return x - offset_m * math.sin(heading), y + offset_m * math.cos(heading)

    def heading_at(self, station_m: float) -> float:
        """Heading of the reference line, not wrapped within one lap."""
        station_m = self.wrap(station_m)
        start, _, _, heading, curvature, rate = self._interval_at(station_m)
        run = station_m - start
        return heading + run * (curvature + 0.5 * rate * run)

    def curvature_at(self, station_m: float) -> float:
        """Curvature [1/m] of the reference line, + = bends left."""
        station_m = self.wrap(station_m)
        start, _, _, _, curvature, rate = self._interval_at(station_m)
        return curvature + rate * (station_m - start)

    def width_at(self, station_m: float) -> float:
        """Width of the lane [m]: linear along each section."""
        start_m, end_m = self._widths_m[self._section_index(station_m)]
        return start_m if start_m == end_m else start_m + (end_m - start_m) * self.section_share(station_m)

    def pitch_over_humps(self, station_m: float, wheelbase_m: float) -> float:
        """Pitch [rad] of a vehicle with its rear axle at a station, by the humps under its axles, + = nose down.

        θ = (z(s) - z(s + L))/L with the height z of the humps and the wheelbase L; 0 without humps.
        """
        if not self.settings.humps:
            return 0.0
        rear_m, front_m = (self._hump_height_at(at_m) for at_m in (station_m, station_m + wheelbase_m))
        return (rear_m - front_m) / wheelbase_m

    def _hump_height_at(self, station_m: float) -> float:
        return sum(hump.height_at(self.wrap(station_m) - hump.at_m) for hump in self.settings.humps)

    def section_at(self, station_m: float) -> Section:
        """The section at a station; an open road keeps its first and last section beyond its ends."""
        return self.sections[self._section_index(station_m)]

    def section_length_m(self, station_m: float) -> float:
        index = self._section_index(station_m)
        return self._section_ends[index] - self._section_starts[index]

    def section_share(self, station_m: float) -> float:
        """Position of a station within its section: 0 at the start, 1 at the end, clipped beyond an open road."""
        index = self._section_index(station_m)
        run_m = self.wrap(station_m) - self._section_starts[index]
        return min(max(run_m / (self._section_ends[index] - self._section_starts[index]), 0.0), 1.0)

    def _section_index(self, station_m: float) -> int:
        station_m = station_m % self.length_m if self.closed else at_least(station_m, 0.0)
        return bisect_right(self._section_starts, station_m) - 1

    def transition_at(self, station_m: float, ramp_m: float) -> tuple[Section, Section, float]:
        """The previous section, the section here, and its share (0..1), which rises over its first ``ramp_m``."""
        here = self.section_at(station_m)
        before = self.section_at(here.start_m - 1e-6)
        run = self.wrap(station_m) - here.start_m
        return before, here, min(max(run / ramp_m, 0.0), 1.0)

    def local_coordinates(
        self, x_m: float, y_m: float, *, near_station_m: float | None = None
    ) -> tuple[float, float]:
        """(station, offset) of the foot point on the reference line: near ``near_station_m``, else the nearest."""
        return self.foot_point(x_m, y_m, near_station_m=near_station_m)[:2]

    def foot_point(self, x_m: float, y_m: float, *, near_station_m: float | None = None) -> FootPoint:
        """The foot point on the reference line: near ``near_station_m``, else the nearest.

        Newton's method on (p - c(s))·t(s) = 0, whose derivative is κ·offset - 1. Its error after a step h is below
        κ·h², so the last step leaves less than 1e-8 m.
        """
        station = near_station_m
        if station is None:
            station = self._stations[int(self._knot_tree.query((x_m, y_m))[1])]
        for _ in range(MAX_STEPS):
            x, y, heading, curvature = self._pose_at(station)
            cos, sin = math.cos(heading), math.sin(heading)
            dx, dy = x_m - x, y_m - y
            offset = dy * cos - dx * sin
            step = (dx * cos + dy * sin) / at_least(1 - curvature * offset, MIN_SLOPE)
            station += within(step, MAX_STEP_M)
            if abs(step) < LAST_STEP_M:
                break
        return FootPoint(self.wrap(station), offset, heading + curvature * step, curvature)

    def wrap(self, station_m: float) -> float:
        """The station within [0, length) on a closed road; unchanged on an open one."""
        return station_m % self.length_m if self.closed else station_m

    def _pose_at(self, station_m: float) -> tuple[float, float, float, float]:
        station_m = self.wrap(station_m)
        return self._pose(self._interval_at(station_m), station_m)

    def _interval_at(self, station_m: float) -> list[float]:
        """The row of the table for a wrapped station; the first and last row extend beyond an open road."""
        index = bisect_right(self._stations, station_m) - 1
        return self._intervals[index if index > 0 else 0]

    @staticmethod
    def _pose(interval: list[float], station_m: float) -> tuple[float, float, float, float]:
        """x, y, heading, curvature ``station_m`` into an interval (a row of the table)."""
        start, x, y, heading, curvature, rate = interval
        run = station_m - start
        half_rate = 0.5 * rate
        for node, weight in GAUSS:
            s = node * run
            angle = heading + s * (curvature + half_rate * s)
            x += weight * run * math.cos(angle)
            y += weight * run * math.sin(angle)
        return x, y, heading + run * (curvature + half_rate * run), curvature + rate * run

    # Vectorised methods.

    def poses(self, station_m: ArrayLike) -> Array:
        """x, y, heading, curvature of the reference line at n stations, shape (n, 4)."""
        stations = np.asarray(station_m, float)
        stations = stations % self.length_m if self.closed else stations
        rows = np.maximum(np.searchsorted(self._table[:, 0], stations, side="right") - 1, 0)
        start, x, y, heading, curvature, rate = self._table[rows].T
        run = stations - start
        dx, dy = _chord(heading, curvature, rate, run)
        return np.column_stack(
            [x + dx, y + dy, heading + run * (curvature + 0.5 * rate * run), curvature + rate * run]
        )

    def positions(self, station_m: ArrayLike, offset_m: ArrayLike) -> Array:
        """(x, y) of n points, shape (n, 2)."""
        x, y, heading, _ = self.poses(station_m).T
        return np.column_stack([x - offset_m * np.sin(heading), y + offset_m * np.cos(heading)])

    def nearest_coordinates(self, points_m: ArrayLike, *, steps: int = 4) -> Array:
        """(station, offset) of the nearest foot points of n points (x, y), shape (n, 2).

        ``steps`` of Newton's method from the nearest knot: 4 give 1e-9 m, 2 give 1e-3 m, near the road.
        """
        points = np.asarray(points_m, float)
        knots = self._table[self._knot_tree.query(points)[1]]
        station, pose = knots[:, 0], knots[:, 1:5]  # the table has the pose of a knot
        for step in range(steps):
            x, y, heading, curvature = (self.poses(station) if step else pose).T
            cos, sin = np.cos(heading), np.sin(heading)
            dx, dy = points[:, 0] - x, points[:, 1] - y
            offset = dy * cos - dx * sin
            station = station + (dx * cos + dy * sin) / np.maximum(1 - curvature * offset, MIN_SLOPE)
        return np.column_stack([station % self.length_m if self.closed else station, offset])

    def section_indices(self, station_m: ArrayLike) -> NDArray[np.intp]:
        """Index into ``sections`` at n stations, shape (n,)."""
        stations = np.asarray(station_m, float)
        stations = stations % self.length_m if self.closed else np.maximum(stations, 0)
        return np.searchsorted(self._section_starts, stations, side="right") - 1

    def widths_at(self, station_m: ArrayLike) -> Array:
        """Width of the lane [m] at n stations, shape (n,)."""
        start_m, end_m = np.array(self._widths_m)[self.section_indices(station_m)].T
        return np.asarray(start_m + (end_m - start_m) * self.section_shares(station_m))

    def section_shares(self, station_m: ArrayLike) -> Array:
        """``section_share`` at n stations, shape (n,)."""
        stations = np.asarray(station_m, float)
        stations = stations % self.length_m if self.closed else np.clip(stations, 0, self.length_m)
        here = self.section_indices(stations)
        starts, ends = np.array(self._section_starts)[here], np.array(self._section_ends)[here]
        return np.asarray((stations - starts) / (ends - starts))

    @cached_property
    def _widths_m(self) -> list[tuple[float, float]]:
        """Width of the lane at the start and at the end of each section."""
        default_m = self.settings.lane_width_m
        return [section.lane_width_m_at_ends(0, default_m) or (default_m,) * 2 for section in self.sections]

    @cached_property
    def min_width_m(self) -> float:
        return min(min(ends) for ends in self._widths_m)

    @cached_property
    def _knot_tree(self) -> cKDTree:
        return cKDTree(self._table[:, 1:3])


def _table(segments: tuple[Segment, ...], *, closed: bool) -> Array:
    """Intervals of the reference line, shape (n, 6): start station, x, y, heading, curvature, curvature rate."""
    if not closed:  # straight on beyond both ends
        segments = (Segment(length_m=LEAD_IN_M), *segments, Segment(length_m=LEAD_IN_M))
    starts = np.cumsum([0.0] + [segment.length_m for segment in segments])
    rows = []
    for segment, start in zip(segments, starts, strict=False):
        count = math.ceil(segment.length_m * max(1 / KNOT_STEP_M, segment.tightest_1pm / KNOT_TURN_RAD))
        step = segment.length_m / count
        rate = (segment.end_curvature_1pm - segment.start_curvature_1pm) / segment.length_m
        rows += [
            (start + i * step, step, segment.start_curvature_1pm + rate * i * step, rate)
            for i in range(count)
        ]
    station, step, curvature, rate = np.array(rows).T
    heading = _sum_before(step * (curvature + 0.5 * rate * step))
    dx, dy = _chord(heading, curvature, rate, step)
    x, y = _sum_before(dx), _sum_before(dy)
    if not closed:
        station, x = station - LEAD_IN_M, x - LEAD_IN_M
    return np.column_stack([station, x, y, heading, curvature, rate])


def _sum_before(values: Array) -> Array:
    """Cumulative sum of the preceding values, shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(values)[:-1]])


def _chord(heading: Array, curvature: Array, rate: Array, run: Array) -> tuple[Array, Array]:
    """(dx, dy) along clothoids of length ``run``, by three-point Gauss-Legendre quadrature."""
    dx, dy = np.zeros_like(run), np.zeros_like(run)
    for node, weight in GAUSS:
        s = node * run
        angle = heading + s * (curvature + 0.5 * rate * s)
        dx += weight * run * np.cos(angle)
        dy += weight * run * np.sin(angle)
    return dx, dy
