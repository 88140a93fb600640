"""Lanes between frames by sampled distributions: particles and a grid (inventory T03, T04)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.ndimage import gaussian_filter

from perception.techniques.image.picture import Boundaries, FrameMotion
from perception.techniques.steering.tracking import (
    KAPPA,
    MEASURED,
    NOISE,
    PRIOR_SIGMA,
    PSI,
    STILL_M,
    WIDTH,
    E,
    TrackState,
    expected_offsets,
    initial,
    moved_state,
    samples_of,
)
from trepid.types import Array, PositiveShare

OUTLIER = 0.2  # likelihood of a side far from a particle: a single wrong line removes no particle


@dataclass
class _Unseen:
    """Time and way since a measurement."""

    unseen_s: float = 0.0
    unseen_m: float = 0.0

    def after(self, boundaries: Boundaries, motion: FrameMotion) -> None:
        """Count this frame."""
        measured = boundaries.side_count > 0
        self.unseen_s = 0.0 if measured else self.unseen_s + motion.dt_s
        self.unseen_m = 0.0 if measured else self.unseen_m + abs(motion.distance_m)


class Particles:
    """Particle filter: ``count`` particles (e, ψ, κ, W), weighted by the likelihood of the boundaries (T03).

    p(y | x) = Π over sides of (exp(−Σ(y − expected)²/2σ²) + outlier), systematic resampling; a share ``fresh``
    of the particles is drawn from the frame, so that the other lane is found after a swap. The result is the mean
    about the greatest mode. Source: R [42], [68]; Gordon, Salmond and Smith (1993).
    """

    def __init__(
        self,
        *,
        count: Annotated[int, Field(ge=20, le=5000)] = 300,
        fresh: Annotated[float, Field(ge=0, le=0.5)] = 0.02,
        seed: int = 0,
    ) -> None:
        self._count, self._fresh, self._rng = count, fresh, np.random.default_rng(seed)
        self._particles: Array | None = None
        self._unseen = _Unseen()

    def step(self, boundaries: Boundaries, motion: FrameMotion) -> Boundaries:
        """The tracked lane, as for the Kalman filters."""
        self._unseen.after(boundaries, motion)
        if self._particles is None:
            self._particles = self._from(boundaries, self._count)
            return boundaries
        self._particles = moved_state(self._particles, motion)
        sigma = NOISE * np.sqrt(abs(motion.distance_m) + STILL_M)
        self._particles += sigma * self._rng.standard_normal(self._particles.shape)
        weight = np.full(self._count, 1 / self._count)
        if boundaries.side_count:
            new = self._from(boundaries, round(self._fresh * self._count))
            if new is not None and len(new):
                self._particles[: len(new)] = new
            weight = likelihood(self._particles, boundaries)
        track = self._track(weight)
        self._particles = self._particles[resample_indices(weight, self._rng)]
        self._rng.shuffle(self._particles)  # the first of them are replaced in the next step
        if track.is_expired:
            self._particles = None
            return boundaries
        return track.boundaries(boundaries.reason)

    def _from(self, boundaries: Boundaries, count: int) -> Array | None:
        """Particles about the lane of this frame alone."""
        track = initial(boundaries)
        if track is None:
            return None
        sigma = np.sqrt(np.diag(track.covariance))
        return track.mean + sigma * self._rng.standard_normal((count, 4))

    def _track(self, weight: Array) -> TrackState:
        """Mean and covariance of the particles within half a metre of the offset with most weight."""
        assert self._particles is not None
        offset = self._particles[:, E]
        mass, edges = np.histogram(offset, bins=24, range=(-3.0, 3.0), weights=weight)
        best = int(np.argmax(np.convolve(mass, [1, 1, 1], mode="same")))
        near = np.abs(offset - (edges[best] + edges[best + 1]) / 2) < 0.5
        if not near.any():  # all of them off the road
            near = np.full(len(weight), True)
        share = weight[near] / weight[near].sum()
        mean = share @ self._particles[near]
        off = self._particles[near] - mean
        return TrackState(mean, (off * share[:, None]).T @ off, self._unseen.unseen_s, self._unseen.unseen_m)


def likelihood(states: Array, boundaries: Boundaries) -> Array:
    """Normalised weights, shape (n,), of states (n, 4) given the boundaries."""
    samples = samples_of(boundaries)
    if not len(samples):
        return np.full(len(states), 1 / len(states))
    off = ((expected_offsets(states, samples) - samples.y_m) / samples.sigma_m) ** 2 / 2
    sides = [off[:, samples.side == side].sum(axis=1) for side in (1.0, -1.0)]
    weight = np.prod([np.exp(-side) + OUTLIER for side in sides], axis=0)
    return np.asarray(weight / weight.sum(), float)


def resample_indices(weight: Array, rng: np.random.Generator) -> Array:
    """Indices of n particles drawn systematically by weight: one random number for all (Kitagawa 1996)."""
    places = (np.arange(len(weight)) + rng.random()) / len(weight)
    return np.searchsorted(np.cumsum(weight) / weight.sum(), places).clip(0, len(weight) - 1)


class Bayes:
    """Histogram filter over offset and heading, Bayes' rule cell by cell (T04). Source: R [73].

    Prediction moves the grid with the vehicle and blurs it; the frame multiplies it with its likelihood. κ and W
    are smoothed values of the frames. Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 4.1.
    """

    OFFSETS = np.linspace(-2.4, 2.4, 61)
    HEADINGS = np.linspace(-0.3, 0.3, 41)

    def __init__(self, *, smoothing: PositiveShare = 0.3) -> None:
        self._smoothing = smoothing
        self._grid: Array | None = None
        self._shape = np.zeros(2)  # κ and W
        self._unseen = _Unseen()

    def step(self, boundaries: Boundaries, motion: FrameMotion) -> Boundaries:
        """The tracked lane, as for the Kalman filters."""
        self._unseen.after(boundaries, motion)
        frame = initial(boundaries)
        if self._grid is None:
            if frame is None:
                return boundaries
            self._shape = frame.mean[[KAPPA, WIDTH]]
            self._grid = np.ones((len(self.OFFSETS), len(self.HEADINGS)))
        else:
            self._grid = self._move_grid(self._grid, motion)
        if frame is not None:
            known = np.array([1.0, frame.covariance[WIDTH, WIDTH] < PRIOR_SIGMA[WIDTH] ** 2])
            self._shape = self._shape + self._smoothing * known * (frame.mean[[KAPPA, WIDTH]] - self._shape)
            self._grid = self._grid * likelihood(self._states(), boundaries).reshape(self._grid.shape)
        self._grid = self._grid / self._grid.sum() + 1e-6 / self._grid.size  # no cell is impossible
        track = self._track(self._grid)
        if track.is_expired:
            self._grid = None
            return boundaries
        return track.boundaries(boundaries.reason)

    def _states(self) -> Array:
        e, psi = np.meshgrid(self.OFFSETS, self.HEADINGS, indexing="ij")
        kappa, width = np.broadcast_to(self._shape[0], e.shape), np.broadcast_to(self._shape[1], e.shape)
        return np.stack([e, psi, kappa, width], axis=-1).reshape(-1, 4)

    def _move_grid(self, grid: Array, motion: FrameMotion) -> Array:
        """The grid with every cell moved by the motion, bilinearly, and blurred by the noise of the way."""
        states = moved_state(self._states(), motion)
        rows = (states[:, E] - self.OFFSETS[0]) / (self.OFFSETS[1] - self.OFFSETS[0])
        columns = (states[:, PSI] - self.HEADINGS[0]) / (self.HEADINGS[1] - self.HEADINGS[0])
        after = np.zeros_like(grid)
        row, column = np.floor(rows).astype(int), np.floor(columns).astype(int)
        for down in (0, 1):
            for right in (0, 1):
                share = np.abs(1 - down - (rows - row)) * np.abs(1 - right - (columns - column))
                inside = (row + down >= 0) & (row + down < grid.shape[0])
                inside &= (column + right >= 0) & (column + right < grid.shape[1])
                np.add.at(after, (row[inside] + down, column[inside] + right), (share * grid.ravel())[inside])
        noise = NOISE[[E, PSI]] * np.sqrt(abs(motion.distance_m) + STILL_M)
        cells = noise / [self.OFFSETS[1] - self.OFFSETS[0], self.HEADINGS[1] - self.HEADINGS[0]]
        return np.asarray(gaussian_filter(after, cells, mode="constant"), float)

    def _track(self, grid: Array) -> TrackState:
        """Mean and covariance about the best cell, within half a metre."""
        best = self.OFFSETS[np.unravel_index(int(np.argmax(grid)), grid.shape)[0]]
        near = grid * (np.abs(self.OFFSETS - best) < 0.5)[:, None]
        near /= near.sum()
        e, psi = near.sum(axis=1) @ self.OFFSETS, near.sum(axis=0) @ self.HEADINGS
        spread_e = near.sum(axis=1) @ (self.OFFSETS - e) ** 2
        spread_psi = near.sum(axis=0) @ (self.HEADINGS - psi) ** 2
        covariance = np.diag([spread_e, spread_psi, *MEASURED[[KAPPA, WIDTH]] ** 2])
        mean = np.array([e, psi, *self._shape])
        return TrackState(mean, covariance, self._unseen.unseen_s, self._unseen.unseen_m)
