"""The samplers of `trepid fear tune` on the 14 functions of the Bat literature, at equal evaluations.

The functions are those by which the harmony variant of the Bat algorithm was published (Wang and Guo, A Novel
Hybrid Bat Algorithm with Harmony Search for Global Numerical Optimization, J. Applied Mathematics (2013), table 1;
Simon, Biogeography-Based Optimization, IEEE Trans. Evolutionary Computation 12 (2008)), each with its published
range. The minimum of each is 0. Half of them have it in the middle of their range, where a search that drifts to
the middle finds it by its drift; so it is moved by a random part of the range that all samplers share (Liang,
Suganthan and Deb, Novel Composition Test Functions for Numerical Global Optimization (2005)).

Samplers are ranked for each function and seed by the least value found. The mean ranks have intervals of a
bootstrap over the functions. The test of all samplers is Friedman's; that of one against random search is the
signed-rank test of Wilcoxon over the functions, one-sided, on the differences of the mean ranks (Demšar,
Statistical Comparisons of Classifiers over Multiple Data Sets, JMLR 7 (2006)), with Holm's correction for their
number.

Every search is one line in ``runs/functions_<seed>.jsonl``: an interrupted benchmark continues.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import optuna
from numpy.typing import NDArray
from scipy.stats import friedmanchisquare, rankdata, wilcoxon

from sim_harness.sweep.store import stored_rows
from sim_harness.tuning.study import SAMPLERS
from trepid.config import WORK_DIR

Row = dict[str, Any]
Point = NDArray[np.float64]
DIMENSIONS, EVALUATIONS, SEEDS = 10, 240, 10
BASELINE = "random"
MOST_SHIFT = 0.2  # of the range, to each side
RESAMPLES = 2000
INTERVAL_PERCENT = (2.5, 97.5)


class Function(NamedTuple):
    """A function of a point with the minimum 0, within ``low`` and ``high`` in every dimension."""

    value: Callable[[Point, np.random.Generator], float]
    low: float
    high: float
    shifted: bool = True  # False: values beyond the range may be below the minimum


def ackley(x: Point, _: np.random.Generator) -> float:
    """20 + e - 20·exp(-0.2·√(Σx²/n)) - exp(Σcos(2πx)/n)."""
    decay = 20 * math.exp(-0.2 * math.sqrt(float(np.mean(x**2))))
    return 20 + math.e - decay - math.exp(float(np.mean(np.cos(2 * np.pi * x))))


def fletcher_powell(x: Point, rng: np.random.Generator) -> float:
    """Σ(A - B)² with A and B sums of a·sin(α) + b·cos(α) at a fixed random α, and at x."""
    fixed = np.random.default_rng(14)
    a, b = fixed.integers(-100, 101, (2, len(x), len(x))).astype(float)
    alpha = fixed.uniform(-np.pi, np.pi, len(x))
    goal, found = (a @ np.sin(point) + b @ np.cos(point) for point in (alpha, x))
    return float(np.sum((goal - found) ** 2))


def griewank(x: Point, _: np.random.Generator) -> float:
    """1 + Σx²/4000 - Πcos(xᵢ/√i)."""
    return 1 + float(np.sum(x**2)) / 4000 - float(np.prod(np.cos(x / np.sqrt(np.arange(1, len(x) + 1)))))


def penalised_first(x: Point, _: np.random.Generator) -> float:
    """π/n·(10·sin²(πy₁) + Σ(y - 1)²·(1 + 10·sin²(πyᵢ₊₁)) + (yₙ - 1)²) + Σu(x, 10, 100, 4), y = 1 + (x + 1)/4."""
    y = 1 + (x + 1) / 4
    inner = np.sum((y[:-1] - 1) ** 2 * (1 + 10 * np.sin(np.pi * y[1:]) ** 2))
    waves = 10 * np.sin(np.pi * y[0]) ** 2 + inner + (y[-1] - 1) ** 2
    return float(np.pi / len(x) * waves + _penalty(x, 10))


def penalised_second(x: Point, _: np.random.Generator) -> float:
    """0.1·(sin²(3πx₁) + Σ(x - 1)²·(1 + sin²(3πxᵢ₊₁)) + (xₙ - 1)²·(1 + sin²(2πxₙ))) + Σu(x, 5, 100, 4)."""
    inner = np.sum((x[:-1] - 1) ** 2 * (1 + np.sin(3 * np.pi * x[1:]) ** 2))
    last = (x[-1] - 1) ** 2 * (1 + np.sin(2 * np.pi * x[-1]) ** 2)
    return float(0.1 * (np.sin(3 * np.pi * x[0]) ** 2 + inner + last) + _penalty(x, 5))


def _penalty(x: Point, free: float) -> float:
    """Σ100·(|x| - a)⁴ beyond ±a."""
    return 100 * float(np.sum(np.maximum(np.abs(x) - free, 0.0) ** 4))


def quartic(x: Point, rng: np.random.Generator) -> float:
    """Σi·xᵢ⁴ + noise, uniform in 0 to 1."""
    return float(np.sum(np.arange(1, len(x) + 1) * x**4)) + float(rng.random())


def rastrigin(x: Point, _: np.random.Generator) -> float:
    """Σ(x² - 10·cos(2πx) + 10)."""
    return float(np.sum(x**2 - 10 * np.cos(2 * np.pi * x) + 10))


def rosenbrock(x: Point, _: np.random.Generator) -> float:
    """Σ100·(xᵢ₊₁ - xᵢ²)² + (1 - xᵢ)²."""
    return float(np.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2))


def schwefel_2_26(x: Point, _: np.random.Generator) -> float:
    """418.98289·n - Σx·sin(√|x|)."""
    return 418.9828872724338 * len(x) - float(np.sum(x * np.sin(np.sqrt(np.abs(x)))))


def schwefel_1_2(x: Point, _: np.random.Generator) -> float:
    """Σ(x₁ + … + xᵢ)²."""
    return float(np.sum(np.cumsum(x) ** 2))


def schwefel_2_22(x: Point, _: np.random.Generator) -> float:
    """Σ|x| + Π|x|."""
    return float(np.sum(np.abs(x)) + np.prod(np.abs(x)))


def schwefel_2_21(x: Point, _: np.random.Generator) -> float:
    """max|x|."""
    return float(np.max(np.abs(x)))


def sphere(x: Point, _: np.random.Generator) -> float:
    """Σx²."""
    return float(np.sum(x**2))


def step(x: Point, _: np.random.Generator) -> float:
    """Σ⌊x + 0.5⌋²."""
    return float(np.sum(np.floor(x + 0.5) ** 2))


FUNCTIONS: Mapping[str, Function] = MappingProxyType(
    {
        "ackley": Function(ackley, -32.768, 32.768),
        "fletcher-powell": Function(fletcher_powell, -math.pi, math.pi, shifted=False),
        "griewank": Function(griewank, -600.0, 600.0),
        "penalised 1": Function(penalised_first, -50.0, 50.0),
        "penalised 2": Function(penalised_second, -50.0, 50.0),
        "quartic with noise": Function(quartic, -1.28, 1.28),
        "rastrigin": Function(rastrigin, -5.12, 5.12),
        "rosenbrock": Function(rosenbrock, -2.048, 2.048),
        "schwefel 2.26": Function(schwefel_2_26, -512.0, 512.0, shifted=False),
        "schwefel 1.2": Function(schwefel_1_2, -100.0, 100.0),
        "schwefel 2.22": Function(schwefel_2_22, -10.0, 10.0),
        "schwefel 2.21": Function(schwefel_2_21, -100.0, 100.0),
        "sphere": Function(sphere, -5.12, 5.12),
        "step": Function(step, -5.12, 5.12),
    }
)
"""Name -> function."""


class Search(NamedTuple):
    """A search of one sampler on one function."""

    function: str
    sampler: str
    seed: int


def least_value(search: Search) -> Row:
    """The least value that a sampler finds in EVALUATIONS evaluations."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    function = FUNCTIONS[search.function]
    rng = np.random.default_rng((search.seed, *search.function.encode()))  # alike for all samplers
    most = MOST_SHIFT * (function.high - function.low) * function.shifted
    shift = rng.uniform(-most, most, DIMENSIONS)

    def cost(trial: optuna.Trial) -> float:
        x = [trial.suggest_float(f"x{i}", function.low, function.high) for i in range(DIMENSIONS)]
        return function.value(np.array(x) - shift, rng)

    study = optuna.create_study(sampler=SAMPLERS[search.sampler](search.seed))
    study.optimize(cost, n_trials=EVALUATIONS)
    return {"value": study.best_value}


def bench_samplers(seed: int, *, jobs: int = 1) -> Row:
    """Ranks of the samplers over all functions, and the median value found on each."""
    searches = [
        Search(function, sampler, seed + number)
        for function in FUNCTIONS
        for number in range(SEEDS)
        for sampler in SAMPLERS
    ]
    path = WORK_DIR / "runs" / f"functions_{seed}.jsonl"
    tasks = {" ".join(map(str, search)): search for search in searches}
    rows = stored_rows(path, least_value, tasks, jobs=jobs)
    return compare(np.reshape([row["value"] for row in rows], (len(FUNCTIONS), SEEDS, len(SAMPLERS))))


def compare(values: NDArray[np.float64]) -> Row:
    """The tables of least values of shape (functions, seeds, samplers)."""
    ranks = rankdata(values, axis=2).mean(axis=1)  # function × sampler
    medians = {
        function: {name: float(f"{np.median(values[i, :, j]):.3g}") for j, name in enumerate(SAMPLERS)}
        for i, function in enumerate(FUNCTIONS)
    }
    return {
        "ranks over all functions": rank_samplers(ranks, "functions"),
        "median of the least values": medians,
        "Friedman p": float(f"{friedmanchisquare(*ranks.T).pvalue:.2g}"),
        "evaluations a search": EVALUATIONS,
        "dimensions": DIMENSIONS,
        "seeds": values.shape[1],
    }


def rank_samplers(ranks: NDArray[np.float64], units: str) -> dict[str, Row]:
    """The mean ranks, best first, of ranks of shape (``units``, samplers), and the tests against random search."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(ranks), size=(RESAMPLES, len(ranks)))
    low, high = np.percentile(ranks[drawn].mean(axis=1), INTERVAL_PERCENT, axis=0)
    names = list(SAMPLERS)
    gains = ranks[:, [names.index(BASELINE)]] - ranks
    others = [j for j, name in enumerate(names) if name != BASELINE]
    corrected = _holm({j: float(wilcoxon(gains[:, j], alternative="greater").pvalue) for j in others})
    table: dict[str, Row] = {
        name: {
            "mean rank": round(float(ranks[:, j].mean()), 2),
            "from": round(float(low[j]), 2),
            "to": round(float(high[j]), 2),
            f"{units} better than random": int((gains[:, j] > 0).sum()) if j in corrected else None,
            "p against random": float(f"{corrected[j]:.2g}") if j in corrected else None,
        }
        for j, name in enumerate(names)
    }
    return dict(sorted(table.items(), key=lambda one: one[1]["mean rank"]))


def _holm(chance: Mapping[int, float]) -> dict[int, float]:
    """p values with Holm's correction, the k-th least times the number of those left."""
    corrected, largest = {}, 0.0
    for place, (key, p) in enumerate(sorted(chance.items(), key=lambda one: one[1])):
        largest = max(largest, min(1.0, p * (len(chance) - place)))
        corrected[key] = largest
    return corrected
