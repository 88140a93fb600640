"""Inputs of the fear rules beside those of every car: of each estimator by its name, and those of other packages.

Other packages add inputs by entry points of the group ``trepid.fear_inputs``. Such an input is a function of the
validated inputs of one moment, with the range of its values::

    @fear_input(low=0.0, high=1.0)
    def glare(moment: Moment) -> float | None:
        return None if moment.statistics is None else moment.statistics.over_exposed

A rule file names it under ``inputs`` with its sets and the direction of its risk, like every other input; the
proofs of the rule file hold for all values in its range, so for all values of the function. A value outside the
range of the function, NaN, None, or an error in the function is a missing value: fear is 1. The place of an error
is printed once.

A rule file names estimators in inputs such as ``cv_confidence`` and in outputs such as ``trust_cv``. An estimator
that it does not name is rated by the name that ``rated_as`` in ``config/supervisor.yaml`` gives to it or its kind.
"""

import math
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from supervisor.inputs.validation import ValidatedEstimate
from supervisor.path.follow import Lead
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import FORMER_PATH_JITTER, Input
from trepid.clothoid import Motion
from trepid.config import InputError
from trepid.loudness import warn
from trepid.messages import EstimateKind, ImageStatistics
from trepid.plugins import Group, added_entry_points, part
from trepid.spelling import did_you_mean


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


CONFIDENCE, JITTER, PATH_JITTER, SUPPORT = "_confidence", "_jitter", "_path_jitter", "_support"
ESTIMATOR_SUFFIXES = (CONFIDENCE, PATH_JITTER, FORMER_PATH_JITTER, JITTER, SUPPORT)  # longer endings first
RATED_AS: Mapping[str, str] = {EstimateKind.LANE.value: "cv", EstimateKind.ANGLE.value: "angle"}


def rating_names(
    kinds: Mapping[str, EstimateKind], rules: FearRules, rated_as: Mapping[str, str]
) -> dict[str, str]:
    """The name in ``rules`` that rates each estimator, by its name and kind."""
    named = _named_estimators(rules.names, rules.file.estimators)
    return {
        name: name if name in named else rated_as.get(name) or rated_as.get(kind, name)
        for name, kind in kinds.items()
    }


def unrated_names(rules: FearRules, rated_as: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Key and error text of every name in ``rated_as`` that ``rules`` do not rate, where they name any."""
    named = _named_estimators(rules.names, rules.file.estimators)
    known = named.union(RATED_AS.values())
    for key, name in rated_as.items():
        if named and name not in known:
            yield key, f"no rule rates {name!r}; {did_you_mean(name, known)}"


def near_miss(rules: FearRules, name: str) -> str:
    """A question with the known estimator or kind that ``name`` nearly is; "" where it is one, or near none.

    Estimators may have further names, so that a near miss is no error.
    """
    known = _named_estimators(rules.names, rules.file.estimators).union(RATED_AS, RATED_AS.values())
    return "" if name in known else did_you_mean(name, known, otherwise="", cutoff=0.75)


def absent_values(rules: FearRules, estimators: int) -> dict[str, float | None]:
    """Values of the estimator inputs of ``rules`` where no estimator runs that they rate.

    With one estimator alone they are 0: no confidence, because nothing confirms it. With two or more they are calm,
    except support: what does not run supports no other estimator.
    """
    alone = estimators < 2
    return {
        name: 0.0 if alone or name.endswith(SUPPORT) else rules.inputs[name].calmest
        for name in rules.names
        if name.endswith(ESTIMATOR_SUFFIXES)
    }


@lru_cache(maxsize=16)
def _named_estimators(inputs: tuple[str, ...], trusted: tuple[str, ...]) -> frozenset[str]:
    """The estimators that a rule file names."""
    suffixes = {name: next(filter(name.endswith, ESTIMATOR_SUFFIXES), None) for name in inputs}
    return frozenset(name.removesuffix(s) for name, s in suffixes.items() if s).union(trusted)
