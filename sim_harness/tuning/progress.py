"""The progress of a search in lines."""

import time
from collections.abc import Callable
from typing import Any


def is_invalid(trial: Any) -> bool:
    """True for a candidate that failed a check and was not evaluated."""
    return bool(trial.state.name == "PRUNED")


class TrialProgress:
    """Says a line for each finished trial, with the time left."""

    def __init__(self, wanted: int, say: Callable[[str], None]) -> None:
        self._wanted, self._say = wanted, say
        self._began_s = time.monotonic()
        self._had: int | None = None  # trials of earlier sessions

    def report(self, trials: list[Any]) -> None:
        """Say the state of the search."""
        complete = [trial for trial in trials if trial.state.name == "COMPLETE"]
        values = [trial.value for trial in complete]
        start = [trial.value for trial in complete if "start" in trial.user_attrs]
        invalid = sum(map(is_invalid, trials))
        self._had = len(values) if self._had is None else self._had
        new, left = len(values) - self._had, self._wanted - len(values)
        spent_s = time.monotonic() - self._began_s
        eta = f", about {spent_s / new * left:.0f} s left" if new and left > 0 else ""
        best = f", best cost {min(values):.4g}" if values else ""
        best += f" (start {start[0]:.4g})" if start else ""
        self._say(f"{len(values)} of {self._wanted} trials, {invalid} invalid{best}{eta}")
