"""The height and the bank of a road along its reference line: piecewise cubics with continuous slope.

Between two points of a profile, a distance L apart, with values z₀, z₁ and slopes g₀, g₁, the value at ds from
the first is Hermite's cubic, which has the form of OpenDRIVE's <elevation> and <superelevation> (ASAM OpenDRIVE
1.7.0, 8.4):

    z = a + b·ds + c·ds² + d·ds³        a = z₀, b = g₀, c = (3·Δ - 2·g₀ - g₁)/L, d = (g₀ + g₁ - 2·Δ)/L²

with the mean slope Δ = (z₁ - z₀)/L. A closed road joins the last point to the first.

Height: without a stated one the grade changes evenly, z₁ = z₀ + L·(g₀ + g₁)/2: a vertical curve of radius
L/(g₁ - g₀), d = 0. Before the first and beyond the last point of an open road the grade is constant.

Bank: the angle by which the road leans about its reference line. A point without a slope is level there, so that
the road rolls in and out smoothly. Before the first and beyond the last point of an open road it is constant.
"""

from bisect import bisect_right
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from trepid.config import Settings
from trepid.types import Array, NonNegative

Grade = Annotated[float, Field(gt=-0.35, lt=0.35)]  # height per length; the steepest streets have 0.35
BankAngle = Annotated[float, Field(gt=-0.3, lt=0.3)]  # of roads: at most 0.1 (superelevation of 10 %)
BANKED_WITHIN_M = 8.0  # of the reference line; beyond, the ground is level across
Record = tuple[float, float, float, float, float]
"""Start station and a, b, c, d of a piece."""


class ElevationPoint(Settings):
    """A point of the profile. Without ``height_m`` the grade changes evenly from the point before."""

    at_m: NonNegative  # station
    grade: Grade  # + = uphill
    height_m: float | None = None  # of the first point: 0


class BankPoint(Settings):
    """A point of the bank along a road."""

    at_m: NonNegative  # station
    bank_rad: BankAngle  # + = left side up
    rate_radpm: float = 0.0  # change of the bank along the road there


class CubicProfile:
    """A quantity along a road, by cubics between points."""

    def __init__(
        self,
        stations_m: Sequence[float],
        values: Sequence[float],
        slopes: Sequence[float],
        *,
        length_m: float,
        closed: bool,
        outside: tuple[float, float],
    ) -> None:
        """``stations_m``: rising, at least one; ``outside``: slopes before the first and beyond the last."""
        self._length_m, self._closed = length_m, closed
        stations, values, slopes = [*stations_m], [*values], [*slopes]
        if closed:
            stations.append(stations[0] + length_m)
            slopes.append(slopes[0])
            values.append(values[0])
        before, beyond = outside
        rows: list[Record] = [(stations[0] - 1.0, values[0] - before, before, 0.0, 0.0)]
        for i, run_m in enumerate(np.diff(stations).tolist()):
            mean = (values[i + 1] - values[i]) / run_m
            c = (3 * mean - 2 * slopes[i] - slopes[i + 1]) / run_m
            d = (slopes[i] + slopes[i + 1] - 2 * mean) / run_m**2
            rows.append((stations[i], values[i], slopes[i], c, d))
        rows.append((stations[-1], values[-1], beyond, 0.0, 0.0))
        self._rows, self._table = rows, np.array(rows)
        self._starts = [row[0] for row in rows]

    @property
    def records(self) -> list[Record]:
        """Start station and a, b, c, d of each piece, as in OpenDRIVE; the last goes on to the end of the road."""
        return self._rows[1:-1] if self._closed else self._rows[1:]

    @property
    def records_from_start(self) -> list[Record]:
        """The pieces from station 0 to the end of the road; the first begins at 0, often within its piece."""
        run, (_, a, b, c, d) = self._piece(0.0)
        first = (
            0.0,
            a + run * (b + run * (c + run * d)),
            b + run * (2 * c + 3 * d * run),
            c + 3 * d * run,
            d,
        )
        return [first, *(row for row in self.records if 0.0 < row[0] < self._length_m)]

    def values_at(self, station_m: ArrayLike) -> Array:
        """The value at n stations, shape (n,)."""
        stations = np.asarray(station_m, float)
        if self._closed:
            stations = self._starts[1] + (stations - self._starts[1]) % self._length_m
        here = np.maximum(np.searchsorted(self._table[:, 0], stations, side="right") - 1, 0)
        start, a, b, c, d = self._table[here].T
        run = stations - start
        return np.asarray(a + run * (b + run * (c + run * d)), np.float64)

    def value_at(self, station_m: float) -> float:
        """The value at a station."""
        run, (_, a, b, c, d) = self._piece(station_m)
        return float(a + run * (b + run * (c + run * d)))

    def slope_at(self, station_m: float) -> float:
        """Change of the value per length at a station."""
        run, (_, _, b, c, d) = self._piece(station_m)
        return float(b + run * (2 * c + 3 * d * run))

    def curvature_at(self, station_m: float) -> float:
        """Change of the slope per length at a station [1/m]: of a height + in a sag, - on a crest."""
        run, (_, _, _, c, d) = self._piece(station_m)
        return float(2 * c + 6 * d * run)

    def _piece(self, station_m: float) -> tuple[float, Record]:
        """The distance from the start of the piece at a station, and the piece."""
        if self._closed:
            station_m = self._starts[1] + (station_m - self._starts[1]) % self._length_m
        piece = self._rows[max(bisect_right(self._starts, station_m) - 1, 0)]
        return station_m - piece[0], piece


class Elevation(CubicProfile):
    """Heights [m] and grades of a road. Heights are relative to those that the profile states."""

    def __init__(self, points: Sequence[ElevationPoint], *, length_m: float, closed: bool) -> None:
        """``points``: at rising stations, at least one."""
        stations = [point.at_m for point in points]
        grades = [point.grade for point in points]
        heights = [points[0].height_m or 0.0]
        for number, point in enumerate(points[1:], start=1):
            run_m = stations[number] - stations[number - 1]
            even_m = heights[-1] + run_m * (grades[number - 1] + grades[number]) / 2
            heights.append(even_m if point.height_m is None else point.height_m)
        outside = grades[0], grades[-1]
        super().__init__(stations, heights, grades, length_m=length_m, closed=closed, outside=outside)

    def heights_at(self, station_m: ArrayLike) -> Array:
        """Height [m] at n stations, shape (n,)."""
        return self.values_at(station_m)

    def grade_at(self, station_m: float) -> float:
        """Height per length at a station, + = uphill."""
        return self.slope_at(station_m)


class Bank(CubicProfile):
    """Bank [rad] along a road, + = left side up."""

    def __init__(self, points: Sequence[BankPoint], *, length_m: float, closed: bool) -> None:
        """``points``: at rising stations, at least one."""
        fields = ([getattr(point, name) for point in points] for name in ("at_m", "bank_rad", "rate_radpm"))
        super().__init__(*fields, length_m=length_m, closed=closed, outside=(0.0, 0.0))


class RoadHeight:
    """The ground of a road: its height along the reference line, and its bank across.

    At the station s and the offset t, + = left, the ground lies z(s) + t·tan φ(s) high, with the bank φ. Beyond
    BANKED_WITHIN_M to either side it is level.
    """

    def __init__(
        self, elevation: Sequence[ElevationPoint], bank: Sequence[BankPoint], *, length_m: float, closed: bool
    ) -> None:
        self.length_m, self.closed = length_m, closed
        self.elevation = Elevation(elevation, length_m=length_m, closed=closed) if elevation else None
        self.bank = Bank(bank, length_m=length_m, closed=closed) if bank else None

    @property
    def flat(self) -> bool:
        """Whether the ground is one level plane."""
        return self.elevation is None and self.bank is None

    def heights_at(self, station_m: ArrayLike, offset_m: ArrayLike = 0.0) -> Array:
        """Height [m] of the ground at n stations and offsets, shape (n,); 0 on a flat road."""
        hills = self.elevation
        along_m = np.zeros(np.shape(station_m)) if hills is None else hills.heights_at(station_m)
        if self.bank is None:
            return along_m
        offset_m = np.clip(offset_m, -BANKED_WITHIN_M, BANKED_WITHIN_M)
        return np.asarray(along_m + offset_m * np.tan(self.bank.values_at(station_m)))

    def grade_at(self, station_m: float) -> float:
        """Height per length at a station, + = uphill; 0 on a flat road."""
        return 0.0 if self.elevation is None else self.elevation.grade_at(station_m)

    def bank_at(self, station_m: float) -> float:
        """Angle [rad] by which the road leans at a station, + = left side up; 0 on a level road."""
        return 0.0 if self.bank is None else self.bank.value_at(station_m)
