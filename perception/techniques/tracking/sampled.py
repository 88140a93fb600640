"""Lanes between frames as many guesses: particles and a grid (inventory T03, T04)."""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.ndimage import gaussian_filter

from perception.techniques.image.picture import Boundaries, Motion
from perception.techniques.tracking.model import (
    FIRST_SIGMA,
    KAPPA,
    MEASURED,
    NOISE,
    PSI,
    STILL_M,
    WIDTH,
    Belief,
    E,
    expected,
    first,
    forgotten,
    look,
    moved_state,
)
from trepid.types import Array

OUTLIER = 0.2  # likelihood of a side that fits nothing: a wrong line kills no guess at once


class _Memory:
    """How long a lane has not been seen."""

    def __init__(self) -> None:
        self.unseen_s = self.unseen_m = 0.0

    def after(self, boundaries: Boundaries, motion: Motion) -> None:
        """Counts this frame."""
        seen = boundaries.seen > 0
        self.unseen_s = 0.0 if seen else self.unseen_s + motion.dt_s
        self.unseen_m = 0.0 if seen else self.unseen_m + abs(motion.moved_m)


class Particles:
    """Particle filter: ``count`` guesses of (e, ψ, κ, W), weighted by how well they explain the boundaries (T03).

    p(y | x) = Π over sides of (exp(−Σ(y − expected)²/2σ²) + outlier), systematic resampling; a share ``fresh``
    of the guesses is drawn anew from the frame, so that the other lane is found after a swap. Several lanes may
    be believed; the answer is the mean about the place with most of them. Gordon, Salmond and Smith (1993).
    Source: R [42], [68]. The seed is fixed.
    """

    def __init__(
        self,
        *,
        count: Annotated[int, Field(ge=20, le=5000)] = 300,
        fresh: Annotated[float, Field(ge=0, le=0.5)] = 0.02,
        seed: int = 0,
    ) -> None:
        self._count, self._fresh, self._rng = count, fresh, np.random.default_rng(seed)
        self._guesses: Array | None = None
        self._memory = _Memory()

    def step(self, boundaries: Boundaries, motion: Motion) -> Boundaries:
        """The tracked lane, as for the Kalman filters."""
        self._memory.after(boundaries, motion)
        if self._guesses is None:
            self._guesses = self._from(boundaries, self._count)
            return boundaries
        self._guesses = moved_state(self._guesses, motion)
        sigma = NOISE * np.sqrt(abs(motion.moved_m) + STILL_M)
        self._guesses += sigma * self._rng.standard_normal(self._guesses.shape)
        weight = np.full(self._count, 1 / self._count)
        if boundaries.seen:
            new = self._from(boundaries, round(self._fresh * self._count))
            if new is not None and len(new):
                self._guesses[: len(new)] = new
            weight = likelihood(self._guesses, boundaries)
        belief = self._belief(weight)
        self._guesses = self._guesses[resampled(weight, self._rng)]
        self._rng.shuffle(self._guesses)  # the first ones will be replaced
        if forgotten(belief):
            self._guesses = None
            return boundaries
        return belief.boundaries(boundaries.reason)

    def _from(self, boundaries: Boundaries, count: int) -> Array | None:
        """Guesses about what this frame alone says."""
        belief = first(boundaries)
        if belief is None:
            return None
        sigma = np.sqrt(np.diag(belief.covariance))
        return belief.mean + sigma * self._rng.standard_normal((count, 4))

    def _belief(self, weight: Array) -> Belief:
        """Mean and covariance of the guesses within half a metre of where most of their weight lies."""
        assert self._guesses is not None
        offset = self._guesses[:, E]
        mass, edges = np.histogram(offset, bins=24, range=(-3.0, 3.0), weights=weight)
        best = int(np.argmax(np.convolve(mass, [1, 1, 1], mode="same")))
        near = np.abs(offset - (edges[best] + edges[best + 1]) / 2) < 0.5
        if not near.any():  # all of them far off the road
            near = np.full(len(weight), True)
        share = weight[near] / weight[near].sum()
        mean = share @ self._guesses[near]
        off = self._guesses[near] - mean
        return Belief(mean, (off * share[:, None]).T @ off, self._memory.unseen_s, self._memory.unseen_m)


def likelihood(states: Array, boundaries: Boundaries) -> Array:
    """Normalised weights, shape (n,), of states (n, 4) given the boundaries."""
    seen = look(boundaries)
    if not len(seen):
        return np.full(len(states), 1 / len(states))
    off = ((expected(states, seen) - seen.y_m) / seen.sigma_m) ** 2 / 2
    sides = [off[:, seen.side == side].sum(axis=1) for side in (1.0, -1.0)]
    weight = np.prod([np.exp(-side) + OUTLIER for side in sides], axis=0)
    return np.asarray(weight / weight.sum(), float)


def resampled(weight: Array, rng: np.random.Generator) -> Array:
    """Indices of n guesses drawn by weight, systematically: one random number for all (Kitagawa 1996)."""
    places = (np.arange(len(weight)) + rng.random()) / len(weight)
    return np.searchsorted(np.cumsum(weight) / weight.sum(), places).clip(0, len(weight) - 1)


class Bayes:
    """Histogram filter over offset and heading, Bayes' rule cell by cell (T04). Source: R [73].

    Prediction moves the whole grid with the vehicle and blurs it; the frame multiplies it with its likelihood.
    κ and W are smoothed values of the frames. Thrun, Burgard and Fox, Probabilistic Robotics (2005), section
    4.1. Cannot see: two lanes of different bend at once.
    """

    OFFSETS = np.linspace(-2.4, 2.4, 61)
    HEADINGS = np.linspace(-0.3, 0.3, 41)

    def __init__(self, *, smoothing: Annotated[float, Field(gt=0, le=1)] = 0.3) -> None:
        self._smoothing = smoothing
        self._grid: Array | None = None
        self._shape = np.zeros(2)  # κ and W
        self._memory = _Memory()

    def step(self, boundaries: Boundaries, motion: Motion) -> Boundaries:
        """The tracked lane, as for the Kalman filters."""
        self._memory.after(boundaries, motion)
        seen = first(boundaries)
        if self._grid is None:
            if seen is None:
                return boundaries
            self._shape = seen.mean[[KAPPA, WIDTH]]
            self._grid = np.ones((len(self.OFFSETS), len(self.HEADINGS)))
        else:
            self._grid = self._moved(self._grid, motion)
        if seen is not None:
            known = np.array([1.0, seen.covariance[WIDTH, WIDTH] < FIRST_SIGMA[WIDTH] ** 2])
            self._shape = self._shape + self._smoothing * known * (seen.mean[[KAPPA, WIDTH]] - self._shape)
            self._grid = self._grid * likelihood(self._states(), boundaries).reshape(self._grid.shape)
        self._grid = self._grid / self._grid.sum() + 1e-6 / self._grid.size  # nothing is ever impossible
        belief = self._belief(self._grid)
        if forgotten(belief):
            self._grid = None
            return boundaries
        return belief.boundaries(boundaries.reason)

    def _states(self) -> Array:
        e, psi = np.meshgrid(self.OFFSETS, self.HEADINGS, indexing="ij")
        kappa, width = np.broadcast_to(self._shape[0], e.shape), np.broadcast_to(self._shape[1], e.shape)
        return np.stack([e, psi, kappa, width], axis=-1).reshape(-1, 4)

    def _moved(self, grid: Array, motion: Motion) -> Array:
        """The grid where the vehicle's motion takes every cell, bilinearly, and blurred by the noise of the way."""
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
        noise = NOISE[[E, PSI]] * np.sqrt(abs(motion.moved_m) + STILL_M)
        cells = noise / [self.OFFSETS[1] - self.OFFSETS[0], self.HEADINGS[1] - self.HEADINGS[0]]
        return np.asarray(gaussian_filter(after, cells, mode="constant"), float)

    def _belief(self, grid: Array) -> Belief:
        """Mean and covariance about the best cell, within half a metre."""
        best = self.OFFSETS[np.unravel_index(int(np.argmax(grid)), grid.shape)[0]]
        near = grid * (np.abs(self.OFFSETS - best) < 0.5)[:, None]
        near /= near.sum()
        e, psi = near.sum(axis=1) @ self.OFFSETS, near.sum(axis=0) @ self.HEADINGS
        spread_e = near.sum(axis=1) @ (self.OFFSETS - e) ** 2
        spread_psi = near.sum(axis=0) @ (self.HEADINGS - psi) ** 2
        covariance = np.diag([spread_e, spread_psi, *MEASURED[[KAPPA, WIDTH]] ** 2])
        mean = np.array([e, psi, *self._shape])
        return Belief(mean, covariance, self._memory.unseen_s, self._memory.unseen_m)
