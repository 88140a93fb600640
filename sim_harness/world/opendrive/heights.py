"""The height and the bank of a lane along an OpenDRIVE road: <elevation> and <superelevation>.

At the station s the centre of the lane, at the offset t from the reference line, lies z(s) + t·tan φ(s) high, with
the height z and the bank φ of the file, + = left side up. As a function of the way along the lane it is taken over
by Hermite's cubics between points (:mod:`sim_harness.world.roads.elevation`), which are those of the file where t
is constant; a span is halved until it is close to 1 mm. Where the grade jumps, the cubic between the places
KINK_M before and beyond rounds it off, as a tyre does.

ASAM OpenDRIVE 1.7.0, 8.4 (elevation) and 8.5.1 (superelevation).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sim_harness.world.opendrive.lane_table import CubicRecord, active, records
from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint

JUMP_M = 0.01  # of a height or of the edge of a lane, that no car drives over
KINK_M = 0.5
SAME_GRADE = 1e-3
CLOSE_M = 1e-3
LEAST_SPAN_M = 1.0
SLOPE_STEP_M = 1e-3
WAY_PLACES = 65  # of a stretch at which its way is summed
STEEPEST, MOST_RAD = 0.35, 0.3  # of roads, as in roads/elevation.py
HALF_LANE_M = 1.75  # from the reference line, where a jump of the bank counts as one of the height


@dataclass(frozen=True, slots=True)
class LaneStretch:
    """A stretch of the lane between two stations of the file."""

    start_m: float
    end_m: float
    centre_m: Callable[[float], float]  # offset of the lane at a station
    way: Callable[[float], float]  # along the lane, per station
    length_m: float  # of the stretch in the new road


class _ProfilePoint(NamedTuple):
    """The value and its slope at a place of the new road."""

    at_m: float
    value: float
    slope: float


@dataclass(frozen=True, slots=True)
class LaneHeights:
    """The points of the profiles of a road; () where it is flat or level."""

    elevation: tuple[ElevationPoint, ...]
    bank: tuple[BankPoint, ...]
    kinks: int  # jumps of the grade that are rounded off


def lane_heights(
    road: Element, stretches: Sequence[LaneStretch], *, backward: bool, closed: bool
) -> LaneHeights:
    """The profiles along the lane that ``stretches`` describe, in its direction of travel.

    Raises InputError for a jump, and for a steeper grade or bank than a road may have.
    """
    heights = records(road.all("elevationProfile/elevation"), "s")
    banks = records(road.all("lateralProfile/superelevation"), "s")
    if not any(any(record.coefficients) for record in banks):
        banks = []
    is_flat = (
        not any(any(r.coefficients[1:]) for r in heights) and len({r.coefficients[0] for r in heights}) < 2
    )
    if is_flat and not banks:  # its height is the zero of the new road, as it is without heights
        heights = []
    reader = _HeightReader(heights, banks, stretches)
    elevation = reader.points(reader.height_m, heights or banks, JUMP_M) if heights or banks else []
    lean = reader.points(reader.bank_rad, banks, JUMP_M / HALF_LANE_M) if banks else []
    _check(elevation, heights or banks, "slope", STEEPEST, "a grade")
    _check(lean, banks, "value", MOST_RAD, "a bank [rad]")
    length_m = math.fsum(stretch.length_m for stretch in stretches)
    if closed and elevation and abs(elevation[-1].value - elevation[0].value) > JUMP_M:
        up_m = elevation[-1].value - elevation[0].value
        raise (heights or banks)[-1].element.error(f"the closed road ends {up_m:.3g} m above its start")
    if closed:
        elevation, lean = elevation[:-1], lean[:-1]
    if backward:
        elevation = [_ProfilePoint(length_m - p.at_m, p.value, -p.slope) for p in reversed(elevation)]
        lean = [_ProfilePoint(length_m - p.at_m, -p.value, p.slope) for p in reversed(lean)]
    return LaneHeights(
        tuple(ElevationPoint(at_m=max(p.at_m, 0.0), grade=p.slope, height_m=p.value) for p in elevation),
        tuple(BankPoint(at_m=max(p.at_m, 0.0), bank_rad=p.value, rate_radpm=p.slope) for p in lean),
        reader.kinks,
    )


def _check(
    points: Sequence[_ProfilePoint], found: Sequence[CubicRecord], field: str, most: float, what: str
) -> None:
    for point in points:
        value = getattr(point, field)
        if abs(value) >= most:
            raise found[0].element.error(f"{what} of {value:.3g}: expected less than {most:g}")


class _HeightReader:
    """Reads quantities along a lane."""

    def __init__(
        self, heights: list[CubicRecord], banks: list[CubicRecord], stretches: Sequence[LaneStretch]
    ) -> None:
        self._heights, self._banks, self._stretches = heights, banks, stretches
        self.kinks = 0

    def height_m(self, stretch: LaneStretch, s: float, near: float) -> float:
        """Height of the lane at ``s`` by the records that hold at ``near``."""
        height_m = _value(self._heights, s, near)
        return (
            height_m + stretch.centre_m(s) * math.tan(self.bank_rad(stretch, s, near))
            if self._banks
            else height_m
        )

    def bank_rad(self, _stretch: LaneStretch, s: float, near: float) -> float:
        """Bank at ``s`` by the record that holds at ``near``."""
        return _value(self._banks, s, near)

    def points(
        self,
        quantity: Callable[[LaneStretch, float, float], float],
        blamed: Sequence[CubicRecord],
        jump: float,
    ) -> list[_ProfilePoint]:
        """The points of the profile of ``quantity`` from the first station to the last."""
        breaks_m = sorted({record.start_m for record in (*self._heights, *self._banks)})
        spans: list[list[_ProfilePoint]] = []
        done_m = 0.0
        for stretch in self._stretches:
            places = [
                m
                for m in breaks_m
                if stretch.start_m + LEAST_SPAN_M / 2 < m < stretch.end_m - LEAST_SPAN_M / 2
            ]
            way = _WayAlong(stretch, done_m)
            for start, end in pairwise([stretch.start_m, *places, stretch.end_m]):
                spans.append(_span(quantity, stretch, way, start, end))
            done_m += stretch.length_m
        joined = [spans[0][0]]
        for here, there in pairwise(spans):
            joined += here[1:-1]
            joined += self._joint(here, there, blamed, jump)
        return _without_repeats([*joined, *spans[-1][1:]])

    def _joint(
        self,
        here: list[_ProfilePoint],
        there: list[_ProfilePoint],
        blamed: Sequence[CubicRecord],
        jump: float,
    ) -> list[_ProfilePoint]:
        """The points at the end of a span: one, or two about a kink."""
        end, start = here[-1], there[0]
        if abs(end.value - start.value) > jump:
            element = (active(blamed, start.at_m) or blamed[0]).element
            raise element.error(
                f"jumps by {abs(end.value - start.value):.3g} at {start.at_m:.6g} m along the lane"
            )
        if abs(end.slope - start.slope) < SAME_GRADE:
            return [_ProfilePoint(end.at_m, (end.value + start.value) / 2, (end.slope + start.slope) / 2)]
        self.kinks += 1
        back_m = min(KINK_M, (end.at_m - here[-2].at_m) / 3)
        on_m = min(KINK_M, (there[1].at_m - start.at_m) / 3)
        return [_inside(here[-2], end, end.at_m - back_m), _inside(start, there[1], start.at_m + on_m)]


class _WayAlong:
    """The way along the lane of a stretch."""

    def __init__(self, stretch: LaneStretch, done_m: float) -> None:
        self._s = np.linspace(stretch.start_m, stretch.end_m, WAY_PLACES)
        speed = np.array([stretch.way(s) for s in self._s.tolist()])
        self._m = np.concatenate([[0.0], np.cumsum((speed[:-1] + speed[1:]) / 2 * np.diff(self._s))])
        self._factor, self._done_m, self._stretch = stretch.length_m / self._m[-1], done_m, stretch

    def at_m(self, s: float) -> float:
        return self._done_m + self._factor * float(np.interp(s, self._s, self._m))

    def per_station(self, s: float) -> float:
        return self._factor * self._stretch.way(s)


def _span(
    quantity: Callable[[LaneStretch, float, float], float],
    stretch: LaneStretch,
    way: _WayAlong,
    start: float,
    end: float,
) -> list[_ProfilePoint]:
    """Points from ``start`` to ``end`` between which Hermite's cubic is close to ``quantity``."""
    near, h = (start + end) / 2, SLOPE_STEP_M

    def point(s: float) -> _ProfilePoint:
        slope = (quantity(stretch, s + h, near) - quantity(stretch, s - h, near)) / (2 * h)
        return _ProfilePoint(way.at_m(s), quantity(stretch, s, near), slope / way.per_station(s))

    def between(a: float, b: float) -> list[_ProfilePoint]:
        """The points beyond ``a`` up to ``b``."""
        first, last, middle = point(a), point(b), (a + b) / 2
        checks = (a + (b - a) * share for share in (0.25, 0.5, 0.75))
        off = max(abs(_inside(first, last, way.at_m(s)).value - quantity(stretch, s, near)) for s in checks)
        if off > CLOSE_M and b - a > LEAST_SPAN_M:
            return between(a, middle) + between(middle, b)
        return [last]

    return [point(start), *between(start, end)]


def _inside(a: _ProfilePoint, b: _ProfilePoint, at_m: float) -> _ProfilePoint:
    """The point of Hermite's cubic from ``a`` to ``b``."""
    run_m, length_m = at_m - a.at_m, b.at_m - a.at_m
    mean = (b.value - a.value) / length_m
    c = (3 * mean - 2 * a.slope - b.slope) / length_m
    d = (a.slope + b.slope - 2 * mean) / length_m**2
    value = a.value + run_m * (a.slope + run_m * (c + run_m * d))
    return _ProfilePoint(at_m, value, a.slope + run_m * (2 * c + 3 * d * run_m))


def _without_repeats(points: Sequence[_ProfilePoint]) -> list[_ProfilePoint]:
    """``points`` without those on the cubic of their neighbours."""
    kept = [points[0]]
    for here, there in pairwise(points[1:]):
        on = _inside(kept[-1], there, here.at_m)
        if abs(on.value - here.value) > 1e-9 or abs(on.slope - here.slope) > 1e-9:
            kept.append(here)
    return [*kept, points[-1]]


def _value(found: Sequence[CubicRecord], s: float, near: float) -> float:
    """The polynomial that holds at ``near``, at ``s``; before the first it is that one."""
    return (active(found, near) or found[0]).at(s) if found else 0.0
