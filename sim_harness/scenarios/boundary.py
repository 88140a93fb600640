"""Boundary search: the greatest change of a parameter that the scenario passes.

From the values of the scenario a ray runs to each end of each range and, optionally, to random corners of all
ranges together. On a ray between a passing and a failing case the limit is found by bisection: n runs find it to
within 2⁻ⁿ of the ray. Where passing and failing alternate along a ray, it is one of the limits.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_harness.scenarios.sampling import Case, case_seed, concrete
from sim_harness.scenarios.scenario import Scenario
from sim_harness.scenarios.vary import Range, fields

TOLERANCE = 1 / 32  # of a ray
_MIDDLE = 0.5

Passes = Callable[[Case], bool]
"""Runs a case; True when it passed."""
Place = dict[str, float]
"""Parameters by their position in the range, 0..1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """The result of one ray: the last case that passed and the first that failed."""

    ray: str  # e.g. "start.offset_m up"
    passes: Case | None  # None: neither the scenario as written passes nor the end of the ray
    fails: Case | None  # None: both pass, the limit lies beyond the range
    gap: float  # between the two, as a share of the ray
    runs: int  # of this ray

    def row(self) -> dict[str, Any]:
        """The limit as one JSON object."""
        parameters = {
            name: case.parameters if case else None
            for name, case in (("passes", self.passes), ("fails", self.fails))
        }
        return {"ray": self.ray, **parameters, "gap": self.gap, "runs": self.runs}


def limits(
    scenario: Scenario, passes: Passes, *, seed: int = 0, tolerance: float = TOLERANCE, corners: int = 0
) -> Iterator[Limit]:
    """The limit along each ray of ``scenario``, where ``passes`` decides.

    Choices have no order: they stay as written. All cases have the same seed, so that only parameters differ.
    Raises InputError for values that exclude each other.
    """
    search = _Search(scenario, passes, seed)
    for name, end in search.rays(corners):
        yield search.along(name, end, tolerance)


class _Search:
    """Runs the scenario as written once, for all rays."""

    def __init__(self, scenario: Scenario, passes: Passes, seed: int) -> None:
        self._scenario, self._passes, self._seed = scenario, passes, seed
        self._ranges = {name: v for name, v in scenario.vary.items() if isinstance(v, Range)}
        self._start: Place = {name: _written_position(scenario, name, v) for name, v in self._ranges.items()}
        self._runs = 0
        self._start_passes = self._run(self._case(self._start)) if self._ranges else True

    def rays(self, corners: int) -> Iterator[tuple[str, Place]]:
        """The name and the end of each ray of non-zero length."""
        for name in self._ranges:
            for direction, end in (("down", 0.0), ("up", 1.0)):
                if self._start[name] != end:
                    yield f"{name} {direction}", {**self._start, name: end}
        generator = np.random.default_rng(case_seed(self._scenario, 1, self._seed))
        for number in range(corners):
            ends = generator.integers(2, size=len(self._ranges)).tolist()
            yield f"corner {number}", dict(zip(self._ranges, map(float, ends), strict=True))

    def along(self, name: str, end: Place, tolerance: float) -> Limit:
        """The limit on the ray from the scenario as written to ``end``."""
        self._runs, last = 0, self._case(end)
        if self._run(last) == self._start_passes:
            found = (last, None) if self._start_passes else (None, self._case(self._start))
            return Limit(ray=name, passes=found[0], fails=found[1], gap=1.0, runs=self._runs)
        near, far = 0.0, 1.0  # same outcome as the start; other outcome
        while far - near > tolerance:
            middle = (near + far) / 2
            if self._run(self._between(end, middle)) == self._start_passes:
                near = middle
            else:
                far = middle
        passes, fails = (near, far) if self._start_passes else (far, near)
        return Limit(
            ray=name,
            passes=self._between(end, passes),
            fails=self._between(end, fails),
            gap=far - near,
            runs=self._runs,
        )

    def _between(self, end: Place, share: float) -> Case:
        start = self._start
        return self._case({name: start[name] + share * (end[name] - start[name]) for name in end})

    def _case(self, place: Place) -> Case:
        parameters = {name: self._ranges[name].value(unit) for name, unit in place.items()}
        return Case(
            scenario=concrete(self._scenario, parameters),
            index=0,
            seed=case_seed(self._scenario, 0, self._seed),
            parameters=dict(parameters),
        )

    def _run(self, case: Case) -> bool:
        self._runs += 1
        return self._passes(case)


def _written_position(scenario: Scenario, parameter: str, span: Range) -> float:
    """The position in its range of a parameter in the scenario as written; the middle when absent."""
    value: Any = scenario.model_dump(mode="json")
    for part in fields(parameter)[0].split("."):
        value = value[int(part)] if isinstance(value, list) else (value or {}).get(part)
    return span.unit(value) if isinstance(value, int | float) else _MIDDLE
