"""Inputs of the fear rules that other packages add, by entry points of the group ``trepid.fear_inputs``.

Such an input is a function of the validated inputs of one moment, with the range of its values::

    @fear_input(low=0.0, high=1.0)
    def glare(moment: Moment) -> float | None:
        return None if moment.statistics is None else moment.statistics.over_exposed

A rule file names it under ``inputs`` with its sets and the direction of its risk, like every other input; the
proofs of the rule file hold for all values in its range, so for all values of the function. A value outside the
range of the function, NaN, None, or an error in the function is a missing value: fear is 1. The place of an error
is printed once.
"""

import math
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from supervisor.inputs.validation import ValidatedEstimate
from supervisor.path.follow import Lead
from supervisor.rules.rule_file import Input
from trepid.clothoid import Motion
from trepid.config import InputError
from trepid.loudness import warn
from trepid.messages import ImageStatistics
from trepid.plugins import Group, added_entry_points, part


class Moment(NamedTuple):
    """The validated inputs of the supervisor at one step."""

    estimates: tuple[ValidatedEstimate, ...]
    statistics: ImageStatistics | None  # of the image; None: lost or too old
    lead: Lead
    motion: Motion | None  # None: lost
    # The inputs of Trepid that do not depend on the fusion; None: missing.
    features: Mapping[str, float | None]
    now_s: float


Measure = Callable[[Moment], float | None]


class FearInput(NamedTuple):
    """A function of a moment, and the least and the greatest value that it may have."""

    measure: Measure
    low: float
    high: float

    def __call__(self, moment: Moment) -> float | None:
        """The value at ``moment``; None when there is none in the range, or the function fails."""
        try:
            found = self.measure(moment)
            valid = found is not None and math.isfinite(found) and self.low <= found <= self.high
        except Exception as error:  # noqa: BLE001 - the function is code of another package
            _report(getattr(self.measure, "__name__", ""), type(error).__name__, _place(error))
            return None
        return found if valid else None


@lru_cache(maxsize=64)  # of each place one line, however often the function fails there
def _report(function: str, error: str, where: str) -> None:
    """Print that a function has failed."""
    warn(f"trepid: {where}: {error}: the fear input {function} is missing")


def _place(error: Exception) -> str:
    """File and line of ``error``."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{frame.filename}:{frame.lineno}"


def fear_input(*, low: float, high: float) -> Callable[[Measure], FearInput]:
    """Decorator that makes a function an input with values from ``low`` to ``high``."""
    if not low < high:
        raise ValueError(f"the range must rise, got {low} to {high}")
    return lambda measure: FearInput(measure, low, high)


def added_names() -> frozenset[str]:
    """Names of the inputs of other packages. Raises InputError."""
    return frozenset(added_entry_points(Group.FEAR_INPUTS))


def wrong_ranges(inputs: Mapping[str, Input]) -> Iterator[tuple[str, str]]:
    """Each of ``inputs`` that another package adds and whose range leaves out values, with the fault."""
    for name, found in _functions(tuple(inputs)):
        low, high = inputs[name].range
        if not (low <= found.low and found.high <= high):
            yield name, f"{name} has values from {found.low:g} to {found.high:g}; the range must contain them"


def added_values(names: Iterable[str], moment: Moment) -> dict[str, float | None]:
    """The values of those inputs among ``names`` that other packages add."""
    return {name: found(moment) for name, found in _functions(tuple(names))}


@lru_cache(maxsize=16)
def _functions(names: tuple[str, ...]) -> tuple[tuple[str, FearInput], ...]:
    """Raises InputError for an entry point that is no fear input."""
    return tuple((name, _function(name)) for name in names if name in added_names())


def _function(name: str) -> FearInput:
    found: Any = part(Group.FEAR_INPUTS, name, {})
    if not isinstance(found, FearInput):
        raise InputError(
            f"{Group.FEAR_INPUTS} {name!r}: is no fear input; decorate the function with fear_input"
        )
    return found
