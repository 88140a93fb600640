"""The height of a road along its reference line: piecewise cubic, with continuous grade.

Between two points of the profile, a distance L apart, with heights z₀, z₁ and grades g₀, g₁, the height at ds from
the first is Hermite's cubic, which has the form of OpenDRIVE's <elevation> (ASAM OpenDRIVE 1.7.0, 8.4):

    z = a + b·ds + c·ds² + d·ds³        a = z₀, b = g₀, c = (3·Δ - 2·g₀ - g₁)/L, d = (g₀ + g₁ - 2·Δ)/L²

with the mean grade Δ = (z₁ - z₀)/L.

Without a height the grade changes evenly, z₁ = z₀ + L·(g₀ + g₁)/2: a vertical curve of radius L/(g₁ - g₀), d = 0.
Before the first and beyond the last point of an open road the grade is constant; a closed road joins them.
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


class ElevationPoint(Settings):
    """A point of the profile. Without ``height_m`` the grade changes evenly from the point before."""

    at_m: NonNegative  # station
    grade: Grade  # + = uphill
    height_m: float | None = None  # of the first point: 0


class Elevation:
    """Heights and grades of a road. Heights are relative to those that the profile states."""

    def __init__(self, points: Sequence[ElevationPoint], *, length_m: float, closed: bool) -> None:
        """``points``: at rising stations, at least one."""
        self._length_m, self._closed = length_m, closed
        stations = [point.at_m for point in points]
        grades = [point.grade for point in points]
        heights = [points[0].height_m or 0.0]
        for number, point in enumerate(points[1:], start=1):
            run_m = stations[number] - stations[number - 1]
            even_m = heights[-1] + run_m * (grades[number - 1] + grades[number]) / 2
            heights.append(even_m if point.height_m is None else point.height_m)
        if closed:
            stations.append(stations[0] + length_m)
            grades.append(grades[0])
            heights.append(heights[0])
        rows = [(stations[0] - 1.0, heights[0] - grades[0], grades[0], 0.0, 0.0)]
        for i, run_m in enumerate(np.diff(stations).tolist()):
            mean = (heights[i + 1] - heights[i]) / run_m
            c = (3 * mean - 2 * grades[i] - grades[i + 1]) / run_m
            d = (grades[i] + grades[i + 1] - 2 * mean) / run_m**2
            rows.append((stations[i], heights[i], grades[i], c, d))
        rows.append((stations[-1], heights[-1], grades[-1], 0.0, 0.0))
        self._rows, self._table = rows, np.array(rows)
        self._starts = [row[0] for row in rows]

    @property
    def records(self) -> list[tuple[float, float, float, float, float]]:
        """Start station and a, b, c, d of each piece, as in OpenDRIVE; the last goes on to the end of the road."""
        return self._rows[1:-1] if self._closed else self._rows[1:]

    def heights_at(self, station_m: ArrayLike) -> Array:
        """Height [m] at n stations, shape (n,)."""
        stations = np.asarray(station_m, float)
        if self._closed:
            stations = self._starts[1] + (stations - self._starts[1]) % self._length_m
        here = np.maximum(np.searchsorted(self._table[:, 0], stations, side="right") - 1, 0)
        start, a, b, c, d = self._table[here].T
        run = stations - start
        return np.asarray(a + run * (b + run * (c + run * d)), np.float64)

    def grade_at(self, station_m: float) -> float:
        """Height per length at a station, + = uphill."""
        if self._closed:
            station_m = self._starts[1] + (station_m - self._starts[1]) % self._length_m
        start, _, b, c, d = self._rows[max(bisect_right(self._starts, station_m) - 1, 0)]
        run = station_m - start
        return float(b + run * (2 * c + 3 * d * run))
