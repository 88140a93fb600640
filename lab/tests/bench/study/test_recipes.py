"""Samplers meet the same costs on the trained grid, and their ranks are those of what they find."""

import itertools

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from lab.bench.study import recipes
from lab.bench.study.recipes import (
    NUMBERS,
    RecipeSearch,
    axis_of,
    bench_recipes,
    compare,
    nearest,
    points_tried,
    spans,
    spread_deg,
)
from sim_harness.tuning.settings import Span
from sim_harness.tuning.study import SAMPLERS

RANGES = {"rate": Span(low=1e-4, high=1e-2, log=True), "share": Span(low=0.0, high=1.0)}
AXES = {name: axis_of(span, 5) for name, span in RANGES.items()}
BEST = (AXES["rate"][3], AXES["share"][1])


def distance(point: recipes.Point) -> float:
    """Steps of the grid between a point and the best one."""
    return float(
        sum(abs(axis.index(x) - axis.index(y)) for axis, x, y in zip(AXES.values(), point, BEST, strict=True))
    )


COSTS = {point: 1.0 + distance(point) for point in itertools.product(*AXES.values())}


def test_the_grid_spans_the_ranges_of_the_search_from_end_to_end():
    ranges = spans()
    assert set(ranges) == set(NUMBERS)
    for name, count in NUMBERS.items():
        axis = axis_of(ranges[name], count)
        assert len(set(axis)) == count and list(axis) == sorted(axis)
        assert (axis[0], axis[-1]) == pytest.approx((ranges[name].low, ranges[name].high))


def test_a_value_costs_what_the_nearest_point_does_by_the_logarithm_where_the_range_is():
    rate, share = RANGES["rate"], RANGES["share"]
    for axis, span in ((AXES["rate"], rate), (AXES["share"], share)):
        assert [nearest(span, axis, value) for value in axis] == list(axis)
    assert AXES["rate"] == pytest.approx((1e-4, 3.16e-4, 1e-3, 3.16e-3, 1e-2))
    assert nearest(rate, AXES["rate"], 1.9e-3) == AXES["rate"][3], (
        "the geometric mean of 1e-3 and 3.16e-3 is 1.78e-3"
    )
    assert nearest(share, AXES["share"], 0.374) == 0.25


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_search_asks_for_points_of_the_grid_and_the_same_seed_for_the_same_ones(sampler, monkeypatch):
    monkeypatch.setattr(recipes, "EVALUATIONS", (20, 30))
    first, second = (points_tried(RecipeSearch(sampler, 3), RANGES, AXES, COSTS) for _ in range(2))
    assert first == second and len(first) == 30 and set(first) <= set(COSTS)


def test_a_sampler_that_finds_the_best_recipe_first_has_rank_one(monkeypatch):
    monkeypatch.setattr(recipes, "EVALUATIONS", (1, 2))
    rng = np.random.default_rng(0)
    others = [point for point in COSTS if point != BEST]
    trained = {point: {"validation_deg": cost, "mae_deg": 2 * cost} for point, cost in COSTS.items()}
    tried = {name: [[others[i] for i in rng.integers(24, size=2)] for _ in range(8)] for name in SAMPLERS}
    tried["bat"] = [[BEST, others[0]] for _ in range(8)]
    found = compare(tried, trained)
    for table in (found["1 evaluations"], found["2 evaluations"]):
        assert next(iter(table)) == "bat"
        row = table["bat"]
        assert row["mean rank"] == 1.0 and row["searches better than random"] == 8
        assert row["p against random"] < 0.05
        assert (row["validation error [deg]"], row["test error [deg]"]) == (1.0, 2.0)
    assert found["least validation error of all recipes [deg]"] == 1.0


def test_the_spread_of_a_recipe_is_that_of_which_its_two_trainings_are_drawn():
    rng = np.random.default_rng(1)
    errors = rng.normal(5.0, 2.0, 4000)
    trained = {(float(i),): {"validation_deg": error} for i, error in enumerate(errors)}
    again = {
        point: {"validation_deg": row["validation_deg"] + noise}
        for (point, row), noise in zip(trained.items(), rng.normal(0.0, 0.3 * 2**0.5, 4000), strict=True)
    }
    found = spread_deg(trained, again)
    assert found["all recipes"] == pytest.approx(2.0, rel=0.05)
    assert found["a recipe trained twice"] == pytest.approx(0.3, rel=0.05)
    assert found["best tenth of the recipes"] < 1.0


def test_every_recipe_is_trained_once_and_a_second_run_trains_none(tmp_path, monkeypatch):
    asked: list[recipes.RecipeTraining] = []

    def note(frames: object, one: recipes.RecipeTraining) -> dict[str, float]:
        asked.append(one)
        return {"validation_deg": 1.0 + one.point[3] + 0.1 * (one.seed != 7), "mae_deg": 1.0}

    class NoFrames:
        train = test = ()

    monkeypatch.setattr(recipes, "train_one", note)
    monkeypatch.setattr(recipes, "WORK_DIR", tmp_path)
    monkeypatch.setattr(recipes, "frames_of", lambda seed: NoFrames())
    monkeypatch.setattr(recipes, "straight_deg", lambda frames: 9.0)
    monkeypatch.setattr(recipes, "EVALUATIONS", (5,))
    monkeypatch.setattr(recipes, "SEARCHES", 4)
    monkeypatch.setattr(recipes, "rank_samplers", lambda ranks, units: {name: {} for name in SAMPLERS})
    before, count = bench_recipes(7), len(asked)
    again = before["recipes trained again"]
    assert before["recipes trained"] == 9 * 5 * 3 * 2 and again == -(-before["recipes trained"] // 20)
    assert count == len(set(asked)) == before["recipes trained"] + again
    assert before["spread [deg]"]["a recipe trained twice"] == pytest.approx(0.1 / 2**0.5, abs=1e-3)
    assert bench_recipes(7) == before and len(asked) == count
