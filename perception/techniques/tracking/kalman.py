"""Lanes between frames by Kalman filters: linear, extended, unscented (inventory T01, T02, T05, B26).

Own few lines instead of filterpy, which would bring matplotlib into every vehicle; the tests compare both.
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.techniques.boundaries.ground_curve import parallel_sides
from perception.techniques.image.picture import Boundaries, Motion
from perception.techniques.tracking.model import (
    MEASURED,
    WIDTH,
    Belief,
    expected,
    expected_slope,
    first,
    forgotten,
    look,
    moved_state,
    process_noise,
    transition,
)
from trepid.types import Array

GATE = 5.0  # normalised innovation squared per measured value, above which a look is not of this lane
RESTART_S = 0.4  # after so long of nothing but such looks, they are right and the track is wrong


def update(
    mean: Array, covariance: Array, innovation: Array, slope: Array, noise: Array
) -> tuple[Array, Array]:
    """x + Kν and (I − KH)P(I − KH)ᵀ + KRKᵀ with K = PHᵀS⁻¹, S = HPHᵀ + R (Joseph's form stays positive)."""
    gain = np.linalg.solve(slope @ covariance @ slope.T + noise, slope @ covariance).T
    rest = np.eye(len(mean)) - gain @ slope
    return mean + gain @ innovation, rest @ covariance @ rest.T + gain @ noise @ gain.T


def nis(covariance: Array, innovation: Array, slope: Array, noise: Array) -> float:
    """Normalised innovation squared νᵀS⁻¹ν: χ² with as many degrees of freedom as there are measured values."""
    return float(innovation @ np.linalg.solve(slope @ covariance @ slope.T + noise, innovation))


class _Gaussian(ABC):
    """What the three filters share: prediction, gate, coasting and restart; each has its own ``_looked``."""

    def __init__(self, *, gate: Annotated[float, Field(gt=0)] = GATE) -> None:
        self._gate = gate
        self._belief: Belief | None = None
        self._refused_s = 0.0

    def step(self, boundaries: Boundaries, motion: Motion) -> Boundaries:
        """The tracked lane; from memory while unseen or implausible, nothing when that is too old."""
        if self._belief is None:
            self._belief, self._refused_s = first(boundaries), 0.0
            return boundaries
        before = self._predicted(self._belief, motion)
        after = self._looked(before, boundaries) if boundaries.seen else None
        if after is not None:
            self._belief, self._refused_s = after, 0.0
            return after.boundaries(boundaries.reason)
        self._refused_s += motion.dt_s if boundaries.seen else 0.0
        self._belief = replace(
            before,
            unseen_s=before.unseen_s + motion.dt_s,
            unseen_m=before.unseen_m + abs(motion.moved_m),
        )
        if self._refused_s > RESTART_S or forgotten(self._belief):
            self._belief = first(boundaries)
            return boundaries
        return self._belief.boundaries(boundaries.reason or "the lines seen are not of the lane tracked")

    def _predicted(self, belief: Belief, motion: Motion) -> Belief:
        matrix = transition(motion)
        covariance = matrix @ belief.covariance @ matrix.T + process_noise(motion)
        return replace(belief, mean=moved_state(belief.mean, motion), covariance=covariance)

    @abstractmethod
    def _looked(self, belief: Belief, boundaries: Boundaries) -> Belief | None:
        """The belief after the look; None when the look is not of this lane."""


class Kalman(_Gaussian):
    """Linear Kalman filter on (e, ψ, κ, W) as one frame shows them (T01). Source: R [56], [58], [59], [62], [63].

    Kalman, A New Approach to Linear Filtering and Prediction Problems (1960). A single line measures e, ψ, κ
    with the width that is believed. Cannot see: that far parts of a boundary are less sure than near ones.
    """

    def _predicted(self, belief: Belief, motion: Motion) -> Belief:
        """x' = Fx + u, the linear form of the motion."""
        matrix = transition(motion)
        turned = np.array([motion.moved_m / 2, 1.0, 0.0, 0.0]) * motion.turned_rad
        covariance = matrix @ belief.covariance @ matrix.T + process_noise(motion)
        return replace(belief, mean=matrix @ belief.mean + turned, covariance=covariance)

    def _looked(self, belief: Belief, boundaries: Boundaries) -> Belief | None:
        measurement = parallel_sides(boundaries, width_m=float(belief.mean[WIDTH]))
        if measurement is None:
            return None
        values, width_m = measurement.lane[:3], measurement.width_m
        measured = np.array(values if width_m is None else [*values, width_m])
        slope = np.eye(4)[: len(measured)]
        noise = np.diag(MEASURED[: len(measured)] ** 2)
        innovation = measured - slope @ belief.mean
        if nis(belief.covariance, innovation, slope, noise) > self._gate * len(measured):
            return None
        return Belief(*update(belief.mean, belief.covariance, innovation, slope, noise))


class Extended(_Gaussian):
    """Extended Kalman filter: the boundary's places measure the road's structure (T02, B26). Source: R [77], [73].

    The lane's curve is not fitted in one frame, so a dash or the end of a line measures what it can; H is the
    slope of :func:`expected` at the prediction. Survives interrupted markings.
    """

    def _looked(self, belief: Belief, boundaries: Boundaries) -> Belief | None:
        seen = look(boundaries)
        if not len(seen):
            return None
        innovation, noise = seen.y_m - expected(belief.mean, seen), np.diag(seen.sigma_m**2)
        slope = expected_slope(belief.mean, seen)
        if nis(belief.covariance, innovation, slope, noise) > self._gate * len(seen):
            return None
        return Belief(*update(belief.mean, belief.covariance, innovation, slope, noise))


class Unscented(_Gaussian):
    """Unscented Kalman filter: the same road, without slopes (T02). Source: R [73].

    2n + 1 points x̄ ± √((n+λ)P) through motion and look; Julier and Uhlmann, Unscented Filtering and Nonlinear
    Estimation (2004), with α = 1, κ = 0: all weights 1/2n, that of the mean 0 (Arasaratnam's cubature points).
    """

    def _predicted(self, belief: Belief, motion: Motion) -> Belief:
        points = moved_state(spread(belief.mean, belief.covariance), motion)
        mean = points.mean(axis=0)
        covariance = (points - mean).T @ (points - mean) / len(points) + process_noise(motion)
        return replace(belief, mean=mean, covariance=covariance)

    def _looked(self, belief: Belief, boundaries: Boundaries) -> Belief | None:
        seen = look(boundaries)
        if not len(seen):
            return None
        points = spread(belief.mean, belief.covariance)
        looks = expected(points, seen)
        middle = looks.mean(axis=0)
        total = (looks - middle).T @ (looks - middle) / len(points) + np.diag(seen.sigma_m**2)
        cross = (points - belief.mean).T @ (looks - middle) / len(points)
        innovation = seen.y_m - middle
        if innovation @ np.linalg.solve(total, innovation) > self._gate * len(seen):
            return None
        gain = np.linalg.solve(total, cross.T).T
        covariance = belief.covariance - gain @ total @ gain.T
        return Belief(belief.mean + gain @ innovation, (covariance + covariance.T) / 2)


def spread(mean: Array, covariance: Array) -> Array:
    """The 2n points x̄ ± columns of √(nP), shape (2n, n): their mean and covariance are x̄ and P."""
    root = np.linalg.cholesky(len(mean) * covariance).T
    return np.concatenate([mean + root, mean - root])
