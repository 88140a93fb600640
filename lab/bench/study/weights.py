"""Weights of a small network by populations, by gradients and by both, at equal evaluations (O03, O07, O08).

The review cites searches of the weights themselves by nature-inspired algorithms as a way around the drawbacks
of back-propagation, searches of weights and structure at once, and hybrids with gradients. The network reads
CELLS areas of the grey frame below the horizon and has UNITS tanh units and one output, the angle in units of
its spread:

    ŷ = w₂·tanh(W₁·x + b₁) + b₂,    cost = mean (ŷ - y)²

A population moves its weights within ±BOUND. An evaluation is one cost on all training frames; a step of a
gradient counts as three (forward, and about twice as much back). A hybrid spends half of them on the population
and goes on from its best by Adam. Weights and structure at once: one number more a unit says whether it is
there, and each unit costs UNIT_COST. The frames are those of :mod:`lab.bench.study.passages`.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.bench.study.passages import every_nth, mean_row, passages, straight_deg
from learning.training.frames import Frames
from sim_harness.tuning.populations import PopulationSampler
from sim_harness.tuning.study import POPULATIONS

Row = dict[str, Any]
Point = NDArray[np.float64]
CELLS_HIGH, CELLS_WIDE = 4, 8
HORIZON = 0.4  # share of the height above the area that is read
UNITS, BOUND = 6, 2.0
UNIT_COST = 0.005
EVALUATIONS, SEEDS = 2000, 8
EVERY = 4  # frame
OF_GRADIENT = 3  # evaluations of a step
RATE, DECAYS, EPSILON = 0.03, (0.9, 0.999), 1e-8  # of Adam (Kingma and Ba, 2015)
DESCENT_RATE = 0.1


class Cells(NamedTuple):
    """Areas (n, CELLS) of frames with mean 0 and deviation 1, and angles (n,) in units of their spread."""

    x: Point
    y: Point
    unit_deg: float


def cells(frames: Frames, unit_rad: float) -> Cells:
    """The areas of all frames below the horizon."""
    top = round(HORIZON * frames.images.shape[1])
    grey = [cv2.cvtColor(image[top:], cv2.COLOR_BGR2GRAY) for image in frames.images]
    small = [cv2.resize(one, (CELLS_WIDE, CELLS_HIGH), interpolation=cv2.INTER_AREA).ravel() for one in grey]
    x = np.array(small, float)
    x -= x.mean(axis=1, keepdims=True)
    x /= x.std(axis=1, keepdims=True) + 1.0  # grey level
    return Cells(x, frames.labels_rad.astype(float) / unit_rad, float(np.degrees(unit_rad)))


class SmallNetwork(NamedTuple):
    """W₁ (units, inputs), b₁ (units,), w₂ (units,), b₂; ``there`` (units,) is 1 for the units that are used."""

    inner: Point
    inner_bias: Point
    outer: Point
    outer_bias: float
    there: Point

    @classmethod
    def of(cls, weights: Point, units: int, there: Point | None = None) -> "SmallNetwork":
        """The network of the weights in one vector."""
        inputs = (len(weights) - 1) // units - 2
        inner, rest = weights[: units * inputs].reshape(units, inputs), weights[units * inputs :]
        used = np.ones(units) if there is None else there
        return cls(inner, rest[:units], rest[units : 2 * units], float(rest[-1]), used)

    def outputs_of_units(self, x: Point) -> Point:
        """The outputs (n, units) of the units."""
        return np.tanh(x @ self.inner.T + self.inner_bias) * self.there

    def angles(self, x: Point) -> Point:
        """ŷ (n,)."""
        return self.outputs_of_units(x) @ self.outer + self.outer_bias

    def cost(self, data: Cells) -> float:
        """mean (ŷ - y)²."""
        return float(np.mean((self.angles(data.x) - data.y) ** 2))

    def gradient(self, data: Cells) -> Point:
        """Its derivative by the weights, by back-propagation."""
        hidden = self.outputs_of_units(data.x)
        error = 2.0 * (hidden @ self.outer + self.outer_bias - data.y) / len(data.y)
        back = error[:, None] * self.outer * (1.0 - hidden**2) * self.there
        return np.concatenate([(back.T @ data.x).ravel(), back.sum(axis=0), hidden.T @ error, [error.sum()]])


def size(inputs: int, units: int) -> int:
    """The number of weights."""
    return units * (inputs + 2) + 1


def by_population(sampler: PopulationSampler, data: Cells, evaluations: int) -> Point:
    """The best weights of a population."""
    count = size(data.x.shape[1], UNITS)
    cube, _ = sampler.minimise(lambda x: SmallNetwork.of(_weights(x), UNITS).cost(data), count, evaluations)
    return _weights(cube)


def by_chance(rng: np.random.Generator, data: Cells, evaluations: int) -> Point:
    """The best of random weights."""
    drawn = rng.uniform(-BOUND, BOUND, (evaluations, size(data.x.shape[1], UNITS)))
    return drawn[int(np.argmin([SmallNetwork.of(one, UNITS).cost(data) for one in drawn]))]


def by_adam(weights: Point, data: Cells, evaluations: int) -> Point:
    """The weights after as many steps of Adam as the evaluations allow."""
    mean, square = np.zeros_like(weights), np.zeros_like(weights)
    for step in range(1, evaluations // OF_GRADIENT + 1):
        slope = SmallNetwork.of(weights, UNITS).gradient(data)
        mean, square = (
            old + (new - old) * (1.0 - decay)
            for old, new, decay in zip((mean, square), (slope, slope**2), DECAYS, strict=True)
        )
        first, second = (one / (1.0 - decay**step) for one, decay in zip((mean, square), DECAYS, strict=True))
        weights = weights - RATE * first / (np.sqrt(second) + EPSILON)
    return weights


def by_descent(weights: Point, data: Cells, evaluations: int) -> Point:
    """The weights after as many steps down the gradient."""
    for _ in range(evaluations // OF_GRADIENT):
        weights = weights - DESCENT_RATE * SmallNetwork.of(weights, UNITS).gradient(data)
    return weights


def by_structure(sampler: PopulationSampler, data: Cells, evaluations: int) -> SmallNetwork:
    """The best of weights and units at once, among twice as many units."""
    units = 2 * UNITS
    count = size(data.x.shape[1], units)

    def network(x: Point) -> SmallNetwork:
        return SmallNetwork.of(_weights(x[:count]), units, (x[count:] > 0.5).astype(float))

    def cost(x: Point) -> float:
        found = network(x)
        return found.cost(data) + UNIT_COST * float(found.there.sum())

    return network(sampler.minimise(cost, count + units, evaluations)[0])


def bench_weights(seed: int) -> Row:
    """Errors of the road wheel on roads that were not learned from, by the way to the weights."""
    frames = passages(seed)
    unit_rad = float(np.sqrt(np.mean(frames.train.labels_rad.astype(float) ** 2)))
    train, test = (cells(every_nth(one, EVERY), unit_rad) for one in (frames.train, frames.test))
    rows: dict[str, list[Row]] = {}
    for number in range(SEEDS):
        for name, network in networks(train, seed + number):
            rows.setdefault(name, []).append(errors(network, train, test))
    table = {name: mean_row(found) for name, found in rows.items()}
    return {
        "way to the weights": dict(sorted(table.items(), key=lambda one: one[1]["mae_deg"])),
        "always straight [deg]": round(straight_deg(frames.test), 3),
        "evaluations": EVALUATIONS,
        "weights": size(train.x.shape[1], UNITS),
        "frames": len(train.y),
        "seeds": SEEDS,
    }


def networks(train: Cells, seed: int) -> list[tuple[str, SmallNetwork]]:
    """The network of every way to its weights, of one seed."""
    rng = np.random.default_rng(seed)
    first = rng.normal(0.0, 1.0 / np.sqrt(train.x.shape[1]), size(train.x.shape[1], UNITS))
    found: dict[str, Point] = {
        "gradient descent": by_descent(first, train, EVALUATIONS),
        "adam": by_adam(first, train, EVALUATIONS),
        "random": by_chance(rng, train, EVALUATIONS),
    }
    for name, make in POPULATIONS.items():
        found[name] = by_population(make(seed), train, EVALUATIONS)
        half = by_population(make(seed), train, EVALUATIONS // 2)
        found[f"{name}, then adam"] = by_adam(half, train, EVALUATIONS // 2)
    joint = [(f"{name}, weights and units", POPULATIONS[name](seed)) for name in ("bat", "ga")]
    return [
        *((name, SmallNetwork.of(weights, UNITS)) for name, weights in found.items()),
        *((name, by_structure(sampler, train, EVALUATIONS)) for name, sampler in joint),
    ]


def errors(network: SmallNetwork, train: Cells, test: Cells) -> Row:
    """Errors of a network [deg], and the number of its units."""
    found = (network.angles(test.x) - test.y) * test.unit_deg
    return {
        "mae_deg": float(np.abs(found).mean()),
        "rmse_deg": float(np.sqrt(np.mean(found**2))),
        "train_rmse_deg": float(np.sqrt(network.cost(train))) * train.unit_deg,
        "units": float(network.there.sum()),
    }


def _weights(cube: Point) -> Point:
    """Weights within ±BOUND of a point of the unit cube."""
    return BOUND * (2.0 * cube - 1.0)
