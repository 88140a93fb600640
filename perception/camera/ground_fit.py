"""Focal length and mounting of a camera from the motion of the ground in its images, with odometry.

Relative to the horizon row and to the column of the direction of driving, a point of the road x ahead of the camera
and y to the left lies at v = f·h/x, u = −f·y/x. While the vehicle drives Δ and turns by Δψ to the left, it moves

    v' = v/(1 − v·Δ/(f·h)),    u' = u·v'/v + v'·Δψ·x_c/h          (translation; the camera is x_c ahead of the axle)
    v″ = v'·(1 + u'·Δψ/f),     u″ = u' + Δψ·(f + u'²/f)            (rotation, to the first order)

(Longuet-Higgins and Prazdny, The interpretation of a moving retinal image, Proc. R. Soc. B 208, 1980). The rows
give f·h where Δ is known, the columns f where Δψ is known too. Both are fitted to corners of many pairs of frames
by least squares with Cauchy weights, together with the errors of the horizon and of the direction of driving, the
change of pitch in each pair, x_c/h, and a constant error of the yaw rate.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.camera.ground_flow import GroundFlow
from trepid.types import Array, Mask

ROUNDS = 8  # of iteratively reweighted least squares
ALTERNATIONS = 3  # between rows and columns
SHARP_PX = 0.3  # accuracy of a tracked corner
FOCAL_SIGMA = 0.3  # of ln f in the fit
HORIZON_SIGMA, ASIDE_SIGMA = 0.04, 0.03  # of the horizon and of the direction of driving [f]
PITCHING_RAD = 0.0015  # of the change of pitch in a pair
AHEAD, AHEAD_SIGMA = 1.3, 0.5  # x_c/h
RATE_SIGMA_RADPS = 0.005  # of the error of the yaw rate
TURNING_RADPS = 0.02  # yaw rate of a turning pair
RATE_NOISE_RADPS = 0.005  # of a gyroscope; it shrinks f
LEAST_ENERGY = 30.0  # ΣΔψ² of the pairs over that of the noise, from which f is measured
MAX_FOCAL_CHANGE = 3 * FOCAL_SIGMA  # of ln f from the first value; further, the turns contradict the images


@dataclass(frozen=True)
class Optics:
    """Measured values. The deviations are those of the noise alone."""

    focal_height_pxm: float  # f·h
    focal_height_sigma: float  # of its logarithm
    focal_px: float | None  # None where the drive turns too little
    focal_sigma: float  # of its logarithm; infinite without a value
    horizon_px: float  # rows by which the horizon lies above the assumed one
    aside_px: (
        float | None
    )  # columns by which the direction of driving lies left of the middle; None as `focal_px`

    def enlarge(self, scale: float) -> "Optics":
        """For an image ``scale`` times as large."""
        return replace(
            self,
            focal_height_pxm=self.focal_height_pxm * scale,
            focal_px=None if self.focal_px is None else self.focal_px * scale,
            horizon_px=self.horizon_px * scale,
            aside_px=None if self.aside_px is None else self.aside_px * scale,
        )


def turning(turn_rad: float | None, dt_s: float) -> bool:
    """Whether the vehicle turns during ``dt_s``."""
    return turn_rad is not None and abs(turn_rad) > TURNING_RADPS * dt_s


def optics(pairs: Sequence[GroundFlow], focal_px: float) -> Optics | None:
    """The camera by ``pairs`` of frames; ``focal_px`` is a first value.

    None where the ground does not move, or where the turns contradict the images.
    """
    pair = np.repeat(np.arange(len(pairs)), [len(one.before_px) for one in pairs])
    before = np.concatenate([one.before_px for one in pairs])
    after = np.concatenate([one.after_px for one in pairs])
    way, turn, dt = (
        np.array(values)[pair]
        for values in zip(*((one.way_m, one.turn_rad or 0.0, one.dt_s) for one in pairs), strict=True)
    )
    known = np.array([one.turn_rad is not None for one in pairs])[pair]
    energy = sum((one.turn_rad or 0.0) ** 2 for one in pairs)
    turns = energy > LEAST_ENERGY * sum((RATE_NOISE_RADPS * one.dt_s) ** 2 for one in pairs)
    columns = _Columns(focal_px, np.inf, 0.0)
    rows = _rows(before[:, 1], _remove_turn(after, turn, columns), way, pair, focal_px)
    for _ in range(ALTERNATIONS if turns else 0):
        if rows is None:
            return None
        below = _remove_turn(after, turn, columns) + rows.horizon_px
        moves = _Moves(before[:, 0], after[:, 0], below / (before[:, 1] + rows.horizon_px), below, turn, dt)
        fitted = _columns(moves.part(known), columns)
        if fitted is None or not abs(math.log(fitted.focal_px / focal_px)) < MAX_FOCAL_CHANGE:
            return None
        columns = fitted
        rows = _rows(before[:, 1], _remove_turn(after, turn, columns), way, pair, columns.focal_px)
    if rows is None:
        return None
    return Optics(
        1 / rows.growth,
        rows.growth_sigma / rows.growth,
        columns.focal_px if turns else None,
        columns.focal_sigma_px / columns.focal_px,
        rows.horizon_px,
        columns.aside_px if turns else None,
    )


def _remove_turn(after: Array, turn: Array, columns: "_Columns") -> Array:
    """The rows after the way without the turn: v′ = v″/(1 + u″·Δψ/f)."""
    return np.asarray(after[:, 1] / (1 + (after[:, 0] + columns.aside_px) * turn / columns.focal_px))


class _Moves(NamedTuple):
    """What the columns follow from, by corner."""

    before: Array  # u
    after: Array  # u″
    ratio: Array  # ρ = v′/v
    below: Array  # v′
    turn: Array  # Δψ
    dt: Array

    def part(self, chosen: Mask) -> "_Moves":
        """The corners where ``chosen`` is true."""
        return _Moves(*(values[chosen] for values in self))


@dataclass(frozen=True)
class _Rows:
    growth: float  # 1/(f·h) [1/(px·m)]
    growth_sigma: float
    horizon_px: float


@dataclass(frozen=True)
class _Columns:
    focal_px: float
    focal_sigma_px: float
    aside_px: float


def _rows(before: Array, after: Array, way: Array, pair: NDArray[np.int64], focal_px: float) -> _Rows | None:
    """Fit of v′ − v = Δ·g·(v + b)·(v′ + b) + c_i with g = 1/(f·h), horizon error b, change of pitch c_i of a pair.

    The c_i are eliminated from the normal equations, as in bundle adjustment (Schur complement).
    """
    change = after - before
    growth, horizon_px = float(np.median(change / (way * before * after))), 0.0
    pitch = np.zeros(int(pair[-1]) + 1)
    loose = 1 / (HORIZON_SIGMA * focal_px) ** 2
    tight = 1 / (PITCHING_RAD * focal_px) ** 2
    for _ in range(ROUNDS):
        if not growth > 0:
            return None
        below = (before + horizon_px) * (after + horizon_px)
        residual = change - way * growth * below - pitch[pair]
        weight = 1 / (SHARP_PX**2 + residual**2)
        slopes = np.array([way * below, way * growth * (before + after + 2 * horizon_px)])
        own = np.bincount(pair, weight, len(pitch)) + tight
        mixed = np.array([np.bincount(pair, weight * slope, len(pitch)) for slope in slopes])
        right = np.bincount(pair, weight * residual, len(pitch)) - tight * pitch
        normal = (slopes * weight) @ slopes.T + np.diag([0.0, loose]) - (mixed / own) @ mixed.T
        target = (slopes * weight) @ residual - np.array([0.0, loose * horizon_px]) - (mixed / own) @ right
        step = np.linalg.solve(normal, target)
        growth, horizon_px = growth + float(step[0]), horizon_px + float(step[1])
        pitch = pitch + (right - step @ mixed) / own
    return _Rows(growth, float(np.sqrt(np.linalg.inv(normal)[0, 0])), horizon_px) if growth > 0 else None


def _columns(moves: _Moves, start: _Columns) -> _Columns | None:
    """Fit of u″ − u·ρ = Δψ·(f + u″²/f) + v′·Δψ·x_c/h + a·(ρ − 1) + ε·dt with error a of the direction, and ε."""
    focal_px, turn = start.focal_px, moves.turn
    mean = np.array([focal_px, AHEAD, 0.0, 0.0])
    sigma = np.array([FOCAL_SIGMA, AHEAD_SIGMA / focal_px, ASIDE_SIGMA, RATE_SIGMA_RADPS]) * focal_px
    slopes, found = np.array([turn, turn * moves.below, moves.ratio - 1, moves.dt]), mean
    for _ in range(ROUNDS):
        target = moves.after - moves.before * moves.ratio - turn * (moves.after + found[2]) ** 2 / found[0]
        residual = target - found @ slopes
        weight = 1 / (SHARP_PX**2 + residual**2)
        normal = (slopes * weight) @ slopes.T + np.diag(1 / sigma**2)
        found = found + np.linalg.solve(normal, (slopes * weight) @ residual - (found - mean) / sigma**2)
    if not found[0] > 0:
        return None
    return _Columns(float(found[0]), float(np.sqrt(np.linalg.inv(normal)[0, 0])), float(found[2]))
