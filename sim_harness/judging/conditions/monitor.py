"""A condition watched while a run goes on."""

import math
from collections.abc import Mapping

import numpy as np

from sim_harness.judging.conditions.conditions import Condition
from sim_harness.judging.trace import LABELS, Trace
from trepid.types import Column

FIRST_ROOM = 1024  # samples; doubled whenever it is full


class Monitor:
    """The robustness of a condition so far, sample by sample, as though the run ended now.

    What is to come about within a time counts as failed until it has; what must always hold, as passed until it has
    not. At the last sample the robustness is that of the whole trace, by construction: every step judges all
    samples so far, in time proportional to their number (0.1 ms for a minute at 100 Hz).
    """

    def __init__(self, condition: Condition) -> None:
        self._condition = condition
        self._columns: dict[str, Column] = {}
        self._codes: dict[str, dict[str, int]] = {label: {} for label in LABELS}
        self._count = 0

    def step(self, sample: Mapping[str, float | str | None], *, now_s: float) -> float:
        """Take in the columns and labels of one sample, None where absent; the same names in every step.

        Raises ValueError when time does not go on.
        """
        if self._count and now_s <= self._columns["t_s"][self._count - 1]:
            raise ValueError(f"a sample of {now_s} s after one of {self._columns['t_s'][self._count - 1]} s")
        for name, value in {**sample, "t_s": now_s}.items():
            column = self._columns.setdefault(name, np.full(FIRST_ROOM, np.nan))
            if self._count == len(column):
                column = self._columns[name] = np.append(column, np.full(len(column), np.nan))
            column[self._count] = self._number(name, value)
        self._count += 1
        return self._condition.robustness(self.trace())

    def trace(self) -> Trace:
        """The samples so far."""
        columns = {name: column[: self._count] for name, column in self._columns.items()}
        return Trace(columns, {label: tuple(codes) for label, codes in self._codes.items()})

    def _number(self, name: str, value: float | str | None) -> float:
        """``value`` as a column holds it: a label as its code."""
        if name in LABELS:
            codes = self._codes[name]
            return -1.0 if value is None else float(codes.setdefault(str(value), len(codes)))
        return math.nan if value is None else float(value)
