"""The small network has the gradient of its cost, and every way to its weights has the same evaluations."""

import numpy as np
import pytest

from lab.bench.study import weights
from lab.bench.study.weights import UNITS, Cells, SmallNetwork, by_adam, by_chance, by_descent, networks, size

INPUTS = 5


@pytest.fixture
def data() -> Cells:
    rng = np.random.default_rng(2)
    x = rng.normal(size=(60, INPUTS))
    return Cells(x, np.tanh(x @ rng.normal(size=INPUTS)), 10.0)


def test_back_propagation_gives_the_differences_of_the_cost(data):
    rng = np.random.default_rng(3)
    there = np.array([1.0, 0, 1, 1, 0, 1])
    for used in (None, there):
        point, step = rng.normal(size=size(INPUTS, UNITS)), 1e-6
        found = SmallNetwork.of(point, UNITS, used).gradient(data)
        for i, one in enumerate(np.eye(len(point))):
            low, high = (
                SmallNetwork.of(point + way * step * one, UNITS, used).cost(data) for way in (-1.0, 1.0)
            )
            assert found[i] == pytest.approx((high - low) / (2 * step), abs=1e-7)


def test_a_unit_that_is_not_there_has_no_influence(data):
    point = np.random.default_rng(4).normal(size=size(INPUTS, UNITS))
    network = SmallNetwork.of(point, UNITS, np.array([0.0, 1, 1, 1, 1, 1]))
    changed = network._replace(inner=np.where(np.arange(UNITS)[:, None] == 0, 9.0, network.inner))
    assert network.cost(data) == changed.cost(data)


def test_gradients_lower_the_cost_and_more_than_chance(data):
    first = np.random.default_rng(5).normal(0.0, 0.4, size(INPUTS, UNITS))
    before = SmallNetwork.of(first, UNITS).cost(data)
    for way in (by_adam, by_descent):
        assert SmallNetwork.of(way(first, data, 900), UNITS).cost(data) < 0.5 * before
    random = by_chance(np.random.default_rng(6), data, 900)
    assert SmallNetwork.of(by_adam(first, data, 900), UNITS).cost(data) < SmallNetwork.of(random, UNITS).cost(
        data
    )


def test_every_way_has_the_same_evaluations(data, monkeypatch):
    monkeypatch.setattr(weights, "EVALUATIONS", 120)
    count = {"cost": 0, "gradient": 0}

    def watch(name: str) -> None:
        before = getattr(SmallNetwork, name)

        def note_call(self, data):
            count[name] += 1
            return before(self, data)

        monkeypatch.setattr(SmallNetwork, name, note_call)

    watch("cost")
    watch("gradient")
    found = networks(data, 1)
    ways = len(found)
    halves = sum("then adam" in name for name, _ in found)
    pure = sum(name in ("adam", "gradient descent") for name, _ in found)
    assert count["gradient"] == (pure * 120 + halves * 60) // 3
    assert count["cost"] == (ways - pure - halves) * 120 + halves * 60
