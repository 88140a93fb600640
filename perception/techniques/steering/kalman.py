"""Lanes between frames by Kalman filters: linear, extended, unscented (inventory T01, T02, T05, B26).

The tests compare them with filterpy.
"""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from perception.techniques.image.picture import Boundaries, FrameMotion
from perception.techniques.steering.lane import ground_curve
from perception.techniques.steering.tracking import (
    MEASURED,
    WIDTH,
    TrackState,
    expected_offsets,
    expected_slope,
    initial,
    moved_state,
    process_noise,
    samples_of,
    transition,
)
from trepid.types import Array, Positive

GATE = 5.0  # greatest normalised innovation squared per measured value
RESTART_S = 0.4  # a track with all measurements outside of the gate for longer begins again


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
    """The common part of the filters: prediction, gate, coasting and restart; each has its own ``_updated``."""

    def __init__(self, *, gate: Positive = GATE) -> None:
        self._gate = gate
        self._track: TrackState | None = None
        self._refused_s = 0.0

    def step(self, boundaries: Boundaries, motion: FrameMotion) -> Boundaries:
        """The tracked lane; predicted while unseen or outside of the gate; ``boundaries`` once that expires."""
        if self._track is None:
            self._track, self._refused_s = initial(boundaries), 0.0
            return boundaries
        before = self._predict(self._track, motion)
        after = self._update(before, boundaries) if boundaries.side_count else None
        if after is not None:
            self._track, self._refused_s = after, 0.0
            return after.boundaries(boundaries.reason)
        self._refused_s += motion.dt_s if boundaries.side_count else 0.0
        self._track = before.without_measurement(motion)
        if self._refused_s > RESTART_S or self._track.is_expired:
            self._track = initial(boundaries)
            return boundaries
        return self._track.boundaries(boundaries.reason or "the lines are not those of the tracked lane")

    def _predict(self, track: TrackState, motion: FrameMotion) -> TrackState:
        matrix = transition(motion)
        covariance = matrix @ track.covariance @ matrix.T + process_noise(motion)
        return replace(track, mean=moved_state(track.mean, motion), covariance=covariance)

    def _correct(self, track: TrackState, innovation: Array, slope: Array, noise: Array) -> TrackState | None:
        if nis(track.covariance, innovation, slope, noise) > self._gate * len(innovation):
            return None
        return TrackState(*update(track.mean, track.covariance, innovation, slope, noise))

    @abstractmethod
    def _update(self, track: TrackState, boundaries: Boundaries) -> TrackState | None:
        """The track after the measurement; None outside of the gate."""


class Kalman(_Gaussian):
    """Linear Kalman filter on (e, ψ, κ, W) as one frame shows them (T01). Source: R [56], [58], [59], [62], [63].

    Kalman, A New Approach to Linear Filtering and Prediction Problems (1960). A single line measures e, ψ, κ
    with the tracked width. Limit: far parts of a boundary count as much as near ones.
    """

    def _predict(self, track: TrackState, motion: FrameMotion) -> TrackState:
        """x' = Fx + u, the linear form of the motion."""
        matrix = transition(motion)
        turned = np.array([motion.distance_m / 2, 1.0, 0.0, 0.0]) * motion.turn_rad
        covariance = matrix @ track.covariance @ matrix.T + process_noise(motion)
        return replace(track, mean=matrix @ track.mean + turned, covariance=covariance)

    def _update(self, track: TrackState, boundaries: Boundaries) -> TrackState | None:
        measurement = ground_curve(boundaries, width_m=float(track.mean[WIDTH]))
        if measurement is None:
            return None
        values, width_m = measurement.lane[:3], measurement.width_m
        measured = np.array(values if width_m is None else [*values, width_m])
        slope = np.eye(4)[: len(measured)]
        noise = np.diag(MEASURED[: len(measured)] ** 2)
        return self._correct(track, measured - slope @ track.mean, slope, noise)


class ExtendedKalman(_Gaussian):
    """Extended Kalman filter: places of the boundaries measure the structure of the road (T02, B26).

    Source: R [77], [73]. No curve is fitted in one frame, so a dash is a measurement too; H is the slope of
    :func:`expected_offsets` at the prediction.
    """

    def _update(self, track: TrackState, boundaries: Boundaries) -> TrackState | None:
        samples = samples_of(boundaries)
        if not len(samples):
            return None
        innovation, noise = samples.y_m - expected_offsets(track.mean, samples), np.diag(samples.sigma_m**2)
        return self._correct(track, innovation, expected_slope(track.mean, samples), noise)


class UnscentedKalman(_Gaussian):
    """Unscented Kalman filter: the same road, without slopes (T02). Source: R [73].

    2n + 1 points x̄ ± √((n+λ)P) through motion and measurement; Julier and Uhlmann, Unscented Filtering and
    Nonlinear Estimation (2004), with α = 1, κ = 0: all weights 1/2n, that of the mean 0 (Arasaratnam's cubature
    points).
    """

    def _predict(self, track: TrackState, motion: FrameMotion) -> TrackState:
        points = moved_state(spread(track.mean, track.covariance), motion)
        mean = points.mean(axis=0)
        covariance = (points - mean).T @ (points - mean) / len(points) + process_noise(motion)
        return replace(track, mean=mean, covariance=covariance)

    def _update(self, track: TrackState, boundaries: Boundaries) -> TrackState | None:
        samples = samples_of(boundaries)
        if not len(samples):
            return None
        points = spread(track.mean, track.covariance)
        predicted = expected_offsets(points, samples)
        middle = predicted.mean(axis=0)
        total = (predicted - middle).T @ (predicted - middle) / len(points) + np.diag(samples.sigma_m**2)
        cross = (points - track.mean).T @ (predicted - middle) / len(points)
        innovation = samples.y_m - middle
        if innovation @ np.linalg.solve(total, innovation) > self._gate * len(samples):
            return None
        gain = np.linalg.solve(total, cross.T).T
        covariance = track.covariance - gain @ total @ gain.T
        return TrackState(track.mean + gain @ innovation, (covariance + covariance.T) / 2)


def spread(mean: Array, covariance: Array) -> Array:
    """The 2n points x̄ ± columns of √(nP), shape (2n, n): their mean and covariance are x̄ and P."""
    root = np.linalg.cholesky(len(mean) * covariance).T
    return np.concatenate([mean + root, mean - root])
