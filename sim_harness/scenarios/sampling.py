"""Concrete cases of a logical scenario: samples of the parameters under ``vary``.

Every parameter is sampled in the unit interval and mapped to its values by its :mod:`~sim_harness.scenarios.vary`
entry. All randomness, the seed of each case included, comes from one seed and the name of the scenario (NumPy's
``SeedSequence``), so that the printed seed reproduces a case; case k of ``random`` sampling
does not depend on the number of cases.
"""

import json
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue, ValidationError

from sim_harness.scenarios.scenario import Scenario
from sim_harness.scenarios.vary import change_settings, fields
from trepid.config import InputError

DEFAULT_CASES = 100  # of random and Latin hypercube sampling
_DRAWS, _SEEDS = 0, 1  # the two uses of the seed


class Method(StrEnum):
    """Sampling method. For the search by outcome see ``limits``."""

    GRID = "grid"  # every combination of ``steps`` values of each range and of all choices
    RANDOM = "random"  # independent and uniform
    LHS = "lhs"  # Latin hypercube: each of n cases in another n-th of every range (McKay et al., 1979)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One run of a logical scenario: its values and its seed."""

    scenario: Scenario  # with the values set, without ``vary``
    index: int
    seed: int
    parameters: dict[str, JsonValue]  # as named in ``vary``

    @property
    def settings(self) -> list[str]:
        """The values as ``KEY=VALUE`` texts for ``--set``, which reproduce this case."""
        return [
            f"{field}={json.dumps(value)}"
            for parameter, value in self.parameters.items()
            for field in fields(parameter)
        ]


def fresh_seed() -> int:
    """A seed below 2³² from the operating system; print it, so that the runs can be repeated."""
    return int(np.random.SeedSequence().generate_state(1)[0])


def cases(scenario: Scenario, method: Method, count: int | None = None, *, seed: int = 0) -> Iterator[Case]:
    """``count`` concrete cases of ``scenario``.

    Without ``count`` a grid is complete and the others have 100 cases; of a larger grid ``count`` cases are drawn
    without repetition, in its order. A scenario in which nothing varies has one grid case, and differs only by
    seed in the others. Raises InputError for valid values that exclude each other.
    """
    if method is Method.GRID:
        rows = _grid_rows(scenario, count, seed)
    else:
        units = _latin_hypercube if method is Method.LHS else _independent
        variations = scenario.vary.values()
        rows = (
            [variation.value(float(unit)) for variation, unit in zip(variations, row, strict=True)]
            for row in units(scenario, DEFAULT_CASES if count is None else count, seed)
        )
    for index, values in enumerate(rows):
        parameters = dict(zip(scenario.vary, values, strict=True))
        yield Case(
            scenario=concrete(scenario, parameters),
            index=index,
            seed=case_seed(scenario, index, seed),
            parameters=parameters,
        )


def grid_size(scenario: Scenario) -> int:
    """The number of cases in the complete grid of ``scenario``."""
    return math.prod(len(variation.grid()) for variation in scenario.vary.values())


def case_seed(scenario: Scenario, index: int, seed: int) -> int:
    """The seed of case ``index``, below 2³²; neighbouring ``seed`` and ``index`` give independent seeds."""
    return int(_sequence(scenario, seed, _SEEDS, index).generate_state(1)[0])


def _sequence(scenario: Scenario, seed: int, *use: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(zlib.crc32(scenario.name.encode()), *use))


def concrete(scenario: Scenario, parameters: Mapping[str, JsonValue]) -> Scenario:
    """``scenario`` with these values, without ``vary``. Raises InputError for values that exclude each other."""
    try:
        return change_settings(scenario, parameters)
    except (LookupError, ValidationError) as error:
        values = ", ".join(f"{name} = {value}" for name, value in parameters.items())
        problem = error.errors()[0]["msg"] if isinstance(error, ValidationError) else error.args[0]
        raise InputError(f"scenario {scenario.name}: {values}: {problem}") from error


def _grid_rows(scenario: Scenario, count: int | None, seed: int) -> Iterator[Sequence[JsonValue]]:
    grids = [variation.grid() for variation in scenario.vary.values()]
    size = grid_size(scenario)
    if count is None or count >= size:
        yield from product(*grids)
        return
    generator = np.random.default_rng(_sequence(scenario, seed, _DRAWS))
    for number in sorted(generator.choice(size, count, replace=False).tolist()):
        places = np.unravel_index(number, [len(grid) for grid in grids])
        yield [grid[place] for grid, place in zip(grids, places, strict=True)]


def _independent(scenario: Scenario, count: int, seed: int) -> Iterator[NDArray[np.float64]]:
    for index in range(count):
        yield np.random.default_rng(_sequence(scenario, seed, _DRAWS, index)).random(len(scenario.vary))


def _latin_hypercube(scenario: Scenario, count: int, seed: int) -> NDArray[np.float64]:
    """Shape (count, parameters)."""
    if not scenario.vary:
        return np.empty((count, 0))
    from scipy.stats import qmc  # a second, which only this method needs

    generator = np.random.default_rng(_sequence(scenario, seed, _DRAWS))
    return qmc.LatinHypercube(len(scenario.vary), rng=generator).random(count)
