"""The 14 functions have their published minimum 0, and the ranks of samplers are those of their values."""

import math

import numpy as np
import pytest

from lab.bench.study import functions
from lab.bench.study.functions import DIMENSIONS, FUNCTIONS, SAMPLERS, Search, compare, least_value

AT = {
    "penalised 1": -1.0,
    "penalised 2": 1.0,
    "rosenbrock": 1.0,
    "schwefel 2.26": 420.968746,
}  # of the minimum, in every dimension; elsewhere 0
RNG = np.random.default_rng(0)


def minimum(name: str) -> np.ndarray:
    if name == "fletcher-powell":
        rng = np.random.default_rng(14)
        rng.integers(-100, 101, (2, DIMENSIONS, DIMENSIONS))
        return rng.uniform(-np.pi, np.pi, DIMENSIONS)
    return np.full(DIMENSIONS, AT.get(name, 0.0))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_minimum_is_zero_at_its_published_place_and_nowhere_is_less(name):
    function = FUNCTIONS[name]
    least, noise = function.value(minimum(name), RNG), 1.0 if "noise" in name else 1e-4
    assert 0 <= least + 1e-9 <= noise
    for x in RNG.uniform(function.low, function.high, (200, DIMENSIONS)):
        assert function.value(x, RNG) > least - noise


def test_there_are_14_functions_and_a_shift_keeps_the_minimum_within_the_range():
    assert len(FUNCTIONS) == 14
    for name, function in FUNCTIONS.items():
        reach = functions.MOST_SHIFT * (function.high - function.low) * function.shifted
        assert function.low <= minimum(name).min() - reach and minimum(name).max() + reach <= function.high


def test_a_sampler_that_is_always_best_has_rank_one_and_a_small_chance():
    values = np.broadcast_to(np.arange(len(SAMPLERS))[::-1], (14, 4, len(SAMPLERS)))
    ranked = compare(values.astype(float))
    best = list(SAMPLERS)[-1]
    assert next(iter(ranked["ranks over all functions"])) == best
    row = ranked["ranks over all functions"][best]
    assert row["mean rank"] == row["from"] == row["to"] == 1.0
    assert row["functions better than random"] == 14 and row["p against random"] < 0.05
    assert ranked["Friedman p"] < 0.001


def test_samplers_with_equal_values_share_the_middle_rank():
    ranked = compare(np.random.default_rng(1).random((14, 200, len(SAMPLERS))))
    middle = (len(SAMPLERS) + 1) / 2
    for row in ranked["ranks over all functions"].values():
        assert row["mean rank"] == pytest.approx(middle, abs=0.2)


def test_a_search_is_the_same_for_the_same_seed(monkeypatch):
    monkeypatch.setattr(functions, "EVALUATIONS", 15)
    search = Search("quartic with noise", "bat", 3)
    assert least_value(search) == least_value(search) != least_value(search._replace(seed=4))


def test_holms_correction_multiplies_by_the_number_of_those_left_and_never_falls():
    assert functions._holm({0: 0.01, 1: 0.04, 2: 0.03}) == pytest.approx({0: 0.03, 2: 0.06, 1: 0.06})
    assert functions._holm({0: 0.9}) == {0: 0.9} and math.isclose(functions._holm({0: 0.9, 1: 0.8})[1], 1.0)
