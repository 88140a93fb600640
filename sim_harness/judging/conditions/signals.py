"""The signals of conditions: columns of the trace by their names without unit.

``speed`` is the column ``speed_mps``; ``fear`` is ``decision.fear``; ``cv.confidence`` is of an estimator. The
lookup order is: column names, truth and vehicle state, decision. Absent is NaN.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from perception.estimators import ESTIMATORS
from sim_harness.judging import margins
from sim_harness.judging.trace import LABELS, Trace, column_names
from supervisor.rules.rule_file import LEVELS, RuleFile
from trepid.config import default_file, load
from trepid.spelling import did_you_mean
from trepid.types import Column

SUFFIXES = {
    "_1pm2": "1/m²",
    "_1pm": "1/m",
    "_radps": "rad/s",
    "_mps3": "m/s³",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
}
_MULTIPLES = {  # unit of the trace -> as written: factor
    "m": {"m": 1.0, "cm": 0.01, "km": 1000.0},
    "s": {"s": 1.0, "ms": 0.001, "min": 60.0},
    "m/s": {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704},
    "m/s²": {"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "g": 9.80665},
    "m/s³": {"m/s³": 1.0, "m/s^3": 1.0, "m/s3": 1.0},
    "rad": {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180},
    "rad/s": {"rad/s": 1.0, "deg/s": np.pi / 180, "°/s": np.pi / 180},
    "1/m": {"1/m": 1.0},
    "": {"%": 0.01},
}
UNITS = {written: (unit, factor) for unit, group in _MULTIPLES.items() for written, factor in group.items()}
"""Unit as written -> unit of the trace, and the factor to it."""
DERIVED: dict[str, Callable[[Trace], Column]] = {
    "time_gap_s": margins.time_gap_s,
    "time_to_collision_s": margins.time_to_collision_s,
    "time_to_crossing_s": margins.time_to_crossing_s,
    "lane_edge_distance_m": margins.lane_edge_distance_m,
    "elapsed_s": lambda trace: trace["t_s"] - trace["t_s"][0],
}
EVENT_COLUMNS = ("fault", "disturbance", "traffic")  # fault.glare, ...: 0 while inactive
COUNTERS = {"departure": "departures", "intervention": "interventions", "collision": "collisions"}


@dataclass(frozen=True, slots=True)
class Signal:
    """A column of the trace or a derived column, optionally as magnitude."""

    column: str
    absolute: bool = False

    @property
    def unit(self) -> str:
        """Unit of the values, "" for plain numbers."""
        return SUFFIXES.get(_suffix(self.column), "")

    @property
    def estimator(self) -> str:
        """Name of the estimator that the signal belongs to, "" for other signals."""
        name = self.column.partition(".")[0]
        return name if name in ESTIMATORS else ""

    def values(self, trace: Trace) -> Column:
        """One value per sample, NaN where absent. Raises KeyError for a column that the run lacks."""
        derived = DERIVED.get(self.column)
        values = derived(trace) if derived else trace[self.column]
        return np.abs(values) if self.absolute else values

    def __str__(self) -> str:
        return f"|{self.column}|" if self.absolute else self.column


def find_signal(name: str) -> Signal | None:
    """The signal called ``name``, with or without its unit; None when there is none."""
    column = _signal_names().get(name)
    return Signal(column) if column else None


def signal_names() -> list[str]:
    """Every way to name a signal or a label."""
    return [*_signal_names(), *LABELS]


def close_to(name: str, known: Iterable[str]) -> str:
    """``; did you mean 'this'?`` where one of ``known`` is close to ``name``; else all of them, if few."""
    known = list(known)
    hint = did_you_mean(name, known, f"there are {', '.join(known)}" if 0 < len(known) <= 20 else "")
    return f"; {hint}" if hint else ""


def fear_border(level: str) -> tuple[float, float]:
    """The lower and upper border of fear at ``level``, as in ``Decision.level``."""
    at = [-np.inf, *_level_places(), np.inf]
    index = LEVELS.index(level) + 1
    return (at[index - 1] + at[index]) / 2, (at[index] + at[index + 1]) / 2


def activity(trace: Trace, name: str) -> Column:
    """1 where the fault, disturbance, manoeuvre or section ``name`` is active, else 0."""
    active = np.zeros(len(trace))
    for prefix in EVENT_COLUMNS:
        if f"{prefix}.{name}" in trace.columns:
            active = np.maximum(active, trace[f"{prefix}.{name}"] > 0)
    if name in trace.words["section"]:
        active = np.maximum(active, trace["section"] == trace.words["section"].index(name))
    return active


@cache
def _signal_names() -> dict[str, str]:
    """Every name of a signal -> its column; earlier entries take precedence."""
    columns = [name for name in column_names(tuple(ESTIMATORS)) if name not in LABELS and name != "t_s"]
    names = {column: column for column in (*columns, *DERIVED)}
    own = [*(name for name in columns if "." not in name), *DERIVED]
    for column in (*own, *columns):
        names.setdefault(column.removesuffix(_suffix(column)), column)
    for column in columns:
        if column.startswith("decision."):
            names.setdefault(column.removeprefix("decision.").removesuffix(_suffix(column)), column)
    return names


def _suffix(column: str) -> str:
    """The part of a name that states the unit."""
    return next((suffix for suffix in SUFFIXES if column.endswith(suffix)), "")


def _level_places() -> tuple[float, ...]:
    return tuple(action.at for action in load(default_file("fear.yaml"), RuleFile).fear.all)
