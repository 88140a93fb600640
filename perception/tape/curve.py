"""A lane by length: offset and heading at the axle, and its curvature at stations along it, also behind the car.

Unknown are p = (e, ψ, W, κ₁ … κₙ). With the curvature κ(s), linear between the stations, and φ(s) = -ψ + ∫₀ˢκ du,
the lane centre in the vehicle frame is, as x + iy,

    c(s) = -i·e·exp(-iψ) + ∫₀ˢ exp(iφ) du

so that a lane may turn by 180° and more. A point q of a line lies d = Im(exp(-iφ)·(q - c)) left of the nearest
c(s), and on a boundary r = d ∓ W/2 = 0. Gauss-Newton steps minimise Σ w·r²/σ² with the weights 1/(1 + (r/s)²)² of
Geman and McClure, for falling s, and with priors: the prediction from the frame before, and curvatures that change
little between most stations, and at once where a bend begins. The derivatives of d follow from those of c:

    ∂c/∂e = -i·exp(-iψ)     ∂c/∂ψ = -i·c     ∂c/∂κⱼ = ∫₀ˢ i·Tⱼ·exp(iφ) du     Tⱼ(s) = ∫₀ˢ ∂κ/∂κⱼ du
"""

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from perception.tape.floor import TapePoints, VotingPoints
from perception.tape.settings import CurveSettings
from trepid.clothoid import Lane, chord
from trepid.messages import SIGMA_AHEAD_M
from trepid.types import Array, Mask

E, PSI, WIDTH, BENDS = 0, 1, 2, 3  # in the vector p
STEP_M = 0.25  # between the points at which the lane is computed
TURN_RAD, ASIDE_M, LEAST_STEPS = 1.0, 0.15, 6  # of a lane: turn, error and steps of STEP_M of its clothoid
LOOSE = 0.07  # the most weight of a change of curvature at the first scale
STEPS = 2  # of Gauss-Newton, for each scale

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Stations:
    """The stations of the curvature, and the integrals that depend on them alone."""

    at_m: Array  # (n,)
    fine_m: Array  # (m,), with 0
    zero: int  # index of 0
    bend: Array  # κ(fine) = bend @ κ, (m, n)
    turn: Array  # T, (m, n)

    def from_axle(self, values: NDArray[np.complexfloating] | Array) -> NDArray[np.complexfloating] | Array:
        """∫₀ˢ of ``values`` (m, …) at the fine stations, by the trapezoidal rule."""
        total = np.zeros_like(values)
        np.cumsum((values[1:] + values[:-1]) * (STEP_M / 2), axis=0, out=total[1:])
        return total - total[self.zero]


@lru_cache(maxsize=4)
def stations(at_m: tuple[float, ...]) -> Stations:
    """The table for stations at ``at_m``, which contain 0."""
    nodes = np.array(at_m)
    count_behind, count_ahead = round(-nodes[0] / STEP_M), round(nodes[-1] / STEP_M)
    fine_m = STEP_M * np.arange(-count_behind, count_ahead + 1)
    bend = np.column_stack([np.interp(fine_m, nodes, unit) for unit in np.eye(len(nodes))])
    table = Stations(nodes, fine_m, count_behind, bend, np.empty(0))
    return Stations(nodes, fine_m, count_behind, bend, np.asarray(table.from_axle(bend), float))


class DrawnLane(NamedTuple):
    """The lane at the fine stations: centre and unit direction, as x + iy."""

    centre: Complex
    along: Complex


class PlacedPoints(NamedTuple):
    """Points relative to a lane."""

    station: NDArray[np.intp]  # index of the nearest fine station
    left_m: Array  # d
    beside: Mask  # beside the lane, neither before its first station nor beyond its last, and along it


@dataclass(frozen=True)
class LaneCurve:
    """A lane by length, with the covariance of p."""

    at_m: tuple[float, ...]  # the stations
    p: Array
    covariance: Array

    @property
    def table(self) -> Stations:
        return stations(self.at_m)

    @property
    def width_m(self) -> float:
        return float(self.p[WIDTH])

    def draw(self) -> DrawnLane:
        """Centre and direction at the fine stations."""
        table, psi = self.table, float(self.p[PSI])
        along = np.exp(1j * (table.turn @ self.p[BENDS:] - psi))
        start = -1j * self.p[E] * cmath.exp(-1j * psi)
        return DrawnLane(start + table.from_axle(along), along)

    def place(self, points: TapePoints, drawn: DrawnLane, slant_rad: float) -> PlacedPoints:
        """The points beside the lane; those of lines that are askew by more than ``slant_rad`` are not."""
        at = points.x_m + 1j * points.y_m
        apart = at[:, None] - drawn.centre
        station = np.argmin(apart.real**2 + apart.imag**2, axis=1) if len(at) else np.empty(0, np.intp)
        rest = apart[np.arange(len(at)), station] * np.conj(drawn.along[station])
        askew = np.abs(np.sin(points.course_rad - np.angle(drawn.along[station])))
        beside = (np.abs(rest.real) <= STEP_M) & (askew < math.sin(slant_rad))
        return PlacedPoints(station, rest.imag, beside)

    def gradient(self, drawn: DrawnLane) -> Array:
        """∂d/∂p at the fine stations without the part of the width, (m, 3 + n): minus the shift of the centre."""
        table = self.table
        shift = np.empty((len(table.fine_m), len(self.p)), np.complex128)
        shift[:, E] = -1j * cmath.exp(-1j * float(self.p[PSI]))
        shift[:, PSI] = -1j * drawn.centre
        shift[:, WIDTH] = 0.0
        shift[:, BENDS:] = table.from_axle(1j * table.turn * drawn.along[:, None])
        return np.asarray(-(shift * np.conj(drawn.along)[:, None]).imag, float)

    def after(self, way_m: float, turned_rad: float) -> Self:
        """The lane in the frame of the vehicle after an arc of ``way_m`` that turned by ``turned_rad``."""
        drawn, table = self.draw(), self.table
        here = complex(*chord(way_m, turned_rad))
        nearest = int(np.argmin(np.abs(drawn.centre - here)))
        rest = (here - drawn.centre[nearest]) * np.conj(drawn.along[nearest])
        gone_m = float(table.fine_m[nearest] + rest.real)
        bends = np.interp(table.at_m + gone_m, table.at_m, self.p[BENDS:])
        turn = float(np.interp(gone_m, table.fine_m, table.turn @ self.p[BENDS:]))
        heading = turned_rad - (turn - float(self.p[PSI]))
        p = np.r_[float(rest.imag), heading, self.p[WIDTH], bends]
        return type(self)(self.at_m, p, self.covariance)

    def clothoid(self, most_m: float) -> Lane:
        """The clothoid from the axle that turns as this lane does: least squares of the angle.

        It ends at most ``most_m`` ahead, after a radian of turns to either side, and before its own error aside,
        the integral of that of the angle, exceeds ASIDE_M: behind a tight bend no clothoid follows the lane.
        """
        table, bends = self.table, self.p[BENDS:]
        turned = (table.turn @ bends)[table.zero :]
        to_either_side = np.cumsum(np.abs(table.bend @ bends)[table.zero :]) * STEP_M
        steps = min(max(int(np.searchsorted(to_either_side, TURN_RAD)), LEAST_STEPS), round(most_m / STEP_M))
        while True:
            s_m = table.fine_m[table.zero : table.zero + steps + 1]
            slope = np.column_stack([s_m, s_m**2 / 2])
            (bend, rate), *_ = np.linalg.lstsq(slope, turned[: steps + 1], rcond=None)
            aside_m = np.cumsum(slope @ (bend, rate) - turned[: steps + 1]) * STEP_M
            if np.abs(aside_m).max() <= ASIDE_M or steps <= LEAST_STEPS:
                return Lane(float(self.p[E]), float(self.p[PSI]), float(bend), float(rate), steps * STEP_M)
            steps -= 1

    def sigma_m(self, ahead_m: float, gradient: Array) -> float:
        """Standard deviation across the lane of its centre, ``ahead_m`` along it; larger beyond the stations."""
        table = self.table
        inside_m = min(ahead_m, float(table.at_m[-1]))
        row = gradient[round((inside_m - table.fine_m[0]) / STEP_M)]
        sigma_m = math.sqrt(max(float(row @ self.covariance @ row), 0.0))
        return sigma_m * (ahead_m / inside_m) ** 2 if ahead_m > inside_m > 0 else sigma_m

    def ahead_sigma_m(self, gradient: Array) -> tuple[float, ...]:
        """:meth:`sigma_m` at SIGMA_AHEAD_M."""
        return tuple(self.sigma_m(ahead_m, gradient) for ahead_m in SIGMA_AHEAD_M)


def arc_lane(
    settings: CurveSettings, *, offset_m: float, heading_rad: float, bend_1pm: float, width_m: float
) -> LaneCurve:
    """An arc as a lane by length."""
    bends = np.full(len(settings.stations_m), bend_1pm)
    p = np.r_[offset_m, heading_rad, width_m, bends]
    return LaneCurve(settings.stations_m, p, np.diag(np.full(len(p), 1.0)))


class CurveFit:
    """Fits lanes to points."""

    def __init__(self, settings: CurveSettings, width_m: float, *, aside: float = 0.5) -> None:
        """``width_m``: the usual width of the lanes; ``aside``: the lines from their middle, by it."""
        self._settings, self._width_m, self._aside = settings, width_m, aside
        at_m, count = np.array(settings.stations_m), BENDS + len(settings.stations_m)
        sigma = np.full(count, settings.bend_1pm)
        sigma[[E, PSI, WIDTH]] = math.inf, math.inf, settings.width_sigma * width_m
        self._usual = np.diag(1 / sigma**2)
        steps = np.diff(np.eye(len(at_m)), axis=0) / np.sqrt(np.diff(at_m))[:, None]
        self._changes = np.hstack([np.zeros((len(steps), BENDS)), steps])
        self._changes /= settings.bend_change_1pm_per_sqrt_m

    def _shape_information(self, p: Array, most: float) -> Array:
        """Information of the shape near ``p``: the usual width, and small curvatures that mostly change little.

        A bend may begin at once: changes x, in deviations, have the weights 1/(1 + x²) of Cauchy's distribution,
        and ``most`` at most: from a stiff lane Gauss-Newton does not find a bend tighter than the lane is wide.
        """
        share = np.minimum(1 / (1 + (self._changes @ p) ** 2), most)
        return self._usual + self._changes.T @ (self._changes * share[:, None])

    def bends(self, lane: LaneCurve, most_m: float) -> list[LaneCurve]:
        """``lane`` with curvatures of ±bend_1pm from a station below ``most_m`` on, one for each of both."""
        at_m, found = np.array(lane.at_m), []
        for from_m in at_m[(at_m > 0) & (at_m < most_m)]:
            for bend_1pm in (-self._settings.bend_1pm, self._settings.bend_1pm):
                p = lane.p.copy()
                p[BENDS:][at_m >= from_m] = bend_1pm
                found.append(LaneCurve(lane.at_m, p, lane.covariance))
        return found

    def fit(
        self, start: LaneCurve, voting: VotingPoints, *, tracked: bool, predicted: LaneCurve | None = None
    ) -> LaneCurve:
        """The lane near ``start`` that fits the points best.

        ``tracked``: ``predicted``, by default ``start``, follows from the frame before and counts as a measurement.
        """
        settings, expected = self._settings, (predicted or start).p
        trust = np.diag(self._step_information(tracked))
        usual = np.zeros(len(start.p))
        usual[WIDTH] = self._width_m
        lane = start
        normal = trust
        for scale_m in settings.scales_m:
            for _ in range(STEPS):
                drawn = lane.draw()
                placed = lane.place(voting.points, drawn, settings.slant_rad)
                side = self._aside * np.sign(placed.left_m)
                off_m = placed.left_m - side * lane.p[WIDTH]
                share = placed.beside * voting.weight(placed.left_m) / (1 + (off_m / scale_m) ** 2) ** 2
                slope = lane.gradient(drawn)[placed.station]
                slope[:, WIDTH] = -side
                weighted = slope * (share / settings.point_sigma_m**2)[:, None]
                prior = self._shape_information(lane.p, LOOSE if scale_m == settings.scales_m[0] else 1.0)
                normal = weighted.T @ slope + prior + trust
                pull = weighted.T @ off_m + prior @ (lane.p - usual) + trust @ (lane.p - expected)
                p = np.asarray(lane.p - np.linalg.solve(normal, pull), float)
                lane = LaneCurve(lane.at_m, p, lane.covariance)
        return LaneCurve(lane.at_m, lane.p, np.asarray(np.linalg.inv(normal), float))

    def _step_information(self, tracked: bool) -> Array:
        """Information of a prediction by one frame about p, shape (3 + n,); hardly any for a lane of the search."""
        settings = self._settings
        step = settings.step if tracked else settings.searched
        sigma = np.full(BENDS + len(settings.stations_m), step.bend_1pm)
        sigma[[E, PSI, WIDTH]] = step.offset_m, step.heading_rad, self._width_m
        return np.asarray(1 / sigma**2)
