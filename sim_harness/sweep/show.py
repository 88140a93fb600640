"""Output of a sweep on the command line: rows or lines, and how it ended."""

import json
from collections.abc import Iterable
from statistics import fmean

from drive.course import NOT_DRIVEN, PASSED, why_not_driven
from sim_harness.sweep.outcome import Outcome, is_complete
from sim_harness.sweep.plan import Plan, PlanStore
from sim_harness.sweep.store import Row
from sim_harness.sweep.sweep import InPlanOrder, Watch
from trepid.loudness import note


class Display(Watch):
    """Prints the rows of a sweep: as JSON in the order of the plan, else a line for each as it finishes."""

    title = "trepid sim run"

    def __init__(self, *, as_json: bool) -> None:
        """``as_json``: lines of progress go to standard error."""
        self._as_json = as_json
        self._store: PlanStore | None = None
        self._total, self._done, self._failed = 0, 0, 0
        self._cores_s: list[float] = []  # of the cases that ran to their end
        self._ordered = InPlanOrder({})

    @property
    def has_plan(self) -> bool:
        """Whether there is a plan, whose cases run."""
        return self._total > 0

    def begin(self, plan: Plan, store: PlanStore | None) -> None:
        """Say what is stored already."""
        self._total, self._store, self._ordered = len(plan), store, InPlanOrder(plan)
        if store and (store.done or store.crashed or store.outdated):
            text = f"{store.lines}: {len(store.done)} of {len(plan)} cases are stored and not run again"
            text += f"; {store.crashed} crashed" if store.crashed else ""
            text += f"; {store.outdated} were run by other code or configuration" if store.outdated else ""
            _note(text)

    def add(self, key: str, outcome: Outcome) -> None:
        """Print an outcome, and those that waited for it."""
        self._done += 1
        self._failed += outcome.row["status"] != PASSED
        if outcome.core_s:
            self._cores_s.append(outcome.core_s)
        self._print_rows(self._ordered.add(key, outcome))
        if self._store is None or key not in self._store.done:
            line = f"[{self._done}/{self._total}] {one_line(outcome.row)}"
            if self._as_json:
                note(line)
            else:
                print(line, flush=True)

    def print_rest(self) -> None:
        """Print the rows that wait for others, which will not come."""
        self._print_rows(self._ordered.rest())

    def report_end(self, problem: str = "") -> int:
        """Say how the sweep ended, before its end where there is a ``problem``; 1 where a case failed, else 0."""
        if problem:
            stored = f"stored in {self._store.lines}; --resume continues" if self._store else ""
            place = stored or "not stored (--out stores them)"
            _note(f"{problem}{self._done} of {self._total} cases are done, {place}")
        elif self._total > 1:
            rate = f"; {3600 / fmean(self._cores_s):.0f} cases per core-hour" if self._cores_s else ""
            _note(f"{self._done} cases: {self._done - self._failed} passed, {self._failed} failed{rate}")
        return 1 if self._failed else 0

    def _print_rows(self, outcomes: Iterable[tuple[str, Outcome]]) -> None:
        for _, outcome in outcomes:
            if self._as_json:
                print(json.dumps(outcome.row), flush=True)


def _note(text: str) -> None:
    note(f"trepid sim: {text}")


def one_line(row: Row) -> str:
    """A run in one line, and below it the reasons of its failure."""
    values = ", ".join(f"{name} = {value}" for name, value in row.get("parameters", {}).items())
    text = f"{row['scenario']} seed {row['seed']}{f' ({values})' if values else ''}: {row['status']}"
    if is_complete(row):
        text += (
            f", {row['distance_m']:.0f} m in {row['duration_s']:.1f} s, error max"
            f" {row['max_lateral_error_m']:.2f} m rms {row['rms_lateral_error_m']:.2f} m, departures"
            f" {row['departures']}, interventions {row['interventions']}, {row['realtime_factor']:.1f}x real time"
        )
        if row["status"] == NOT_DRIVEN:
            text += f"\n    {why_not_driven(row['waits_for'])}"
    return text + "".join(f"\n    {reason}" for reason in row["reasons"])
