"""The samplers of `trepid train --search` on the recipe of a network, at equal evaluations (F13, O04, O09).

The review asks for the Bat algorithm on the hyper-parameters of a convolutional network: a bat is a set of them,
its fitness the score of the training. Here the numbers of NUMBERS are searched, within their ranges of
``config/driving_search.yaml``, for the network of Rausch et al. on the frames of :mod:`lab.bench.study.passages`;
the cost is that of `trepid train --search`, the mean absolute error of the validation frames in the best epoch.

Eight samplers, each with many seeds, would need ten thousands of trainings. So every point of a grid is trained
once, and a candidate costs what the nearest point of the grid does, by logarithms where the range is logarithmic
(Klein and Hutter, Tabular Benchmarks for Joint Architecture and Hyperparameter Optimization (2019)): all samplers
meet the same costs. Ranks are of the least cost of each search; intervals and tests as in
:mod:`lab.bench.study.functions`, over the seeds of the searches.

A difference counts only where it exceeds what chance does to one recipe. So some recipes, spread over the grid, are
trained again with other first weights and another order of the frames: the deviation of a repeated training stands
beside that of all recipes, and beside that of the best tenth, where a search ends.

One line a training in ``runs/recipes_<seed>.jsonl``: an interrupted benchmark continues.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import optuna
from numpy.typing import NDArray
from scipy.stats import rankdata

from lab.bench.study.functions import rank_samplers
from lab.bench.study.optimisers import HEIGHT_PX, MODEL, WIDTH_PX
from lab.bench.study.passages import (
    Passages,
    errors_deg,
    every_nth,
    passages,
    resize,
    stages,
    straight_deg,
    train_passages,
)
from learning.rendered import need_torch
from learning.training.recipe import load_recipe
from learning.training.search import searched_parameters
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from sim_harness.tuning.settings import Span
from sim_harness.tuning.study import SAMPLERS
from trepid.config import WORK_DIR

Row = dict[str, Any]
Point = tuple[float, ...]
RATE = "stages.0.learning_rate"
NUMBERS: Mapping[str, int] = {RATE: 9, "batch": 5, "weight_decay": 3, "warm_up": 2}
"""Searched number of the recipe -> points of the grid along it."""
EPOCHS, EVERY = (
    12,
    4,
)  # of a training; frame. With half of both no recipe learns more than a wheel held straight
EVALUATIONS = (20, 40, 80)  # 20: those of `trepid train --search` by default
SEARCHES = 30  # of each sampler
REPEATED_EVERY = 20  # recipe of the grid in the order of its cost: trained again with another seed
REPEAT_SEED = 1000  # beyond that of the grid


class RecipeTraining(NamedTuple):
    """A training at one point of the grid."""

    data_seed: int
    point: Point  # the values of NUMBERS
    seed: int  # of the first weights and of the order of the frames


class RecipeSearch(NamedTuple):
    """A search of one sampler on the trained grid."""

    sampler: str
    seed: int


def spans() -> dict[str, Span]:
    """The ranges of NUMBERS. Raises InputError."""
    known = searched_parameters([], load_recipe(MODEL, None))
    return {name: known[name] for name in NUMBERS}


def axis_of(span: Span, count: int) -> Point:
    """``count`` values from end to end of a range, evenly spread, by the logarithm where the range is."""
    spread = np.geomspace if span.log else np.linspace
    return tuple(span.round_value(float(value)) for value in spread(span.low, span.high, count))


def nearest(span: Span, axis: Point, value: float) -> float:
    """The value of ``axis`` nearest to ``value``, by the logarithm where the range is."""
    scale = math.log if span.log else float
    return min(axis, key=lambda one: abs(scale(one) - scale(value)))


def frames_of(seed: int) -> Passages:
    """Small frames, and few to learn from."""
    train, validation, test = (resize(one, HEIGHT_PX, WIDTH_PX) for one in passages(seed))
    return Passages(every_nth(train, EVERY), every_nth(validation, EVERY), every_nth(test, EVERY))


def train_one(frames: Passages, one: RecipeTraining) -> Row:
    """The errors of a training; a loss that is not finite has those of a wheel that is held straight."""
    from learning.training.loop import Divergence

    values = dict(zip(NUMBERS, one.point, strict=True))
    words = {name: f"{value:g}" for name, value in values.items() if name != RATE}
    changes = {**stages(EPOCHS, values[RATE]), "average": "0", "augmentation.flip": "0.5", **words}
    try:
        network, progress = train_passages(frames, MODEL, {**changes, "seed": str(one.seed)})
    except Divergence:
        return {"validation_deg": straight_deg(frames.validation), "mae_deg": straight_deg(frames.test)}
    error_deg = float(np.abs(errors_deg(network, frames.test)).mean())
    return {"validation_deg": math.degrees(progress.best_mae_rad), "mae_deg": error_deg}


def points_tried(
    search: RecipeSearch, ranges: Mapping[str, Span], axes: Mapping[str, Point], costs: Mapping[Point, float]
) -> list[Point]:
    """The points of the grid that a search asks for, in their order."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    tried: list[Point] = []

    def cost(trial: optuna.Trial) -> float:
        asked = {
            name: trial.suggest_float(name, span.low, span.high, log=span.log)
            for name, span in ranges.items()
        }
        tried.append(tuple(nearest(ranges[name], axes[name], value) for name, value in asked.items()))
        return costs[tried[-1]]

    study = optuna.create_study(sampler=SAMPLERS[search.sampler](search.seed))
    study.optimize(cost, n_trials=max(EVALUATIONS))
    return tried


def bench_recipes(seed: int) -> Row:
    """Ranks of the samplers after each number of EVALUATIONS, and the errors of the recipes that they find."""
    need_torch("bench study recipes")
    ranges, frames = spans(), frames_of(seed)
    axes = {name: axis_of(ranges[name], count) for name, count in NUMBERS.items()}
    points = list(itertools.product(*axes.values()))
    trained = train_points(frames, seed, points, seed)
    by_cost = sorted(points, key=lambda point: _cost(trained[point]))
    again = train_points(frames, seed, by_cost[::REPEATED_EVERY], seed + REPEAT_SEED)
    return compare(search_grid(seed, ranges, axes, trained), trained) | {
        "spread [deg]": spread_deg(trained, again),
        "recipes trained again": len(again),
        "always straight [deg]": round(straight_deg(frames.test), 3),
        "frames": len(frames.train),
        "epochs": EPOCHS,
        "recipes trained": len(trained),
        "searches of each sampler": SEARCHES,
    }


def train_points(frames: Passages, data_seed: int, points: Sequence[Point], seed: int) -> dict[Point, Row]:
    """Point -> the errors of its training."""
    trainings = {
        " ".join([f"seed {seed}", *(f"{value:g}" for value in point)]): RecipeTraining(data_seed, point, seed)
        for point in points
    }
    code = fingerprint(
        *import_closure([__name__, "learning.training.run", "learning.models.papers"]), "config"
    )
    codes = {name: short_hash(code, *map(str, one)) for name, one in trainings.items()}
    path = WORK_DIR / "runs" / f"recipes_{data_seed}.jsonl"
    rows = stored_rows(path, partial(train_one, frames), trainings, codes=codes, jobs=1)
    return {one.point: row for one, row in zip(trainings.values(), rows, strict=True)}


def spread_deg(trained: Mapping[Point, Row], again: Mapping[Point, Row]) -> Row:
    """Standard deviations of the errors: of all recipes, of the best tenth, and of one recipe trained twice.

    That of a recipe is √(Σd²/2n) of the differences d of n pairs (Dahlberg (1940)), of all pairs and of those in
    the better half.
    """
    every = sorted(map(_cost, trained.values()))
    pairs = sorted((_cost(trained[point]), _cost(row)) for point, row in again.items())

    def of_pairs(some: Sequence[tuple[float, float]]) -> float:
        return float(np.sqrt(np.mean([(a - b) ** 2 for a, b in some]) / 2))

    found = {
        "all recipes": float(np.std(every)),
        "best tenth of the recipes": float(np.std(every[: len(every) // 10])),
        "a recipe trained twice": of_pairs(pairs),
        "a recipe of the better half trained twice": of_pairs(pairs[: len(pairs) // 2]),
    }
    return {name: round(value, 3) for name, value in found.items()}


def search_grid(
    seed: int, ranges: Mapping[str, Span], axes: Mapping[str, Point], trained: Mapping[Point, Row]
) -> dict[str, list[list[Point]]]:
    """Sampler -> the points that each of its searches asks for."""
    costs = {point: row["validation_deg"] for point, row in trained.items()}
    return {
        sampler: [
            points_tried(RecipeSearch(sampler, seed + number), ranges, axes, costs)
            for number in range(SEARCHES)
        ]
        for sampler in SAMPLERS
    }


def compare(tried: Mapping[str, list[list[Point]]], trained: Mapping[Point, Row]) -> Row:
    """A table of ranks for each number of EVALUATIONS, and the errors of the recipes found by the last."""
    found: Row = {}
    for count in EVALUATIONS:
        least = {
            name: [min((trained[point] for point in search[:count]), key=_cost) for search in searches]
            for name, searches in tried.items()
        }
        costs = np.array([list(map(_cost, rows)) for rows in least.values()]).T
        table = rank_samplers(_ranks(costs), "searches")
        for name, row in table.items():
            row["validation error [deg]"] = round(float(np.mean(list(map(_cost, least[name])))), 3)
            row["test error [deg]"] = round(float(np.mean([one["mae_deg"] for one in least[name]])), 3)
        found[f"{count} evaluations"] = table
    every = sorted(map(_cost, trained.values()))
    return found | {
        "least validation error of all recipes [deg]": round(every[0], 3),
        "median validation error of all recipes [deg]": round(float(np.median(every)), 3),
    }


def _cost(row: Row) -> float:
    return float(row["validation_deg"])


def _ranks(costs: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ranks (searches, samplers) of costs of that shape; equal costs share the middle rank."""
    found: NDArray[np.float64] = rankdata(costs, axis=1)
    return found
