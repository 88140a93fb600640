"""Output of a sweep on the command line: rows or lines, progress, and a report at the end."""

import json
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from sim_harness.report.page import Page
from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.outcome import ClusterLost, Outcome, is_complete
from sim_harness.sweep.plan import Plan
from sim_harness.sweep.plan_store import PlanStore
from sim_harness.sweep.store import Row
from sim_harness.sweep.sweep import InPlanOrder, Workforce, watched

INTERRUPTED = 130  # 128 + SIGINT, as in shells


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A report page, its file, and the command that repeats a case."""

    path: Path
    page: Page
    command: Callable[[Case], str]

    def add(self, case: Case, outcome: Outcome) -> None:
        """Add the outcome of ``case``."""
        tags = [tag.value for tag in case.scenario.tags]
        self.page.add(outcome.row, tags=tags, command=self.command(case), detail=outcome.detail)


class Show:
    """Runs a plan and prints its progress and results."""

    def __init__(
        self, plan: Plan, work: Workforce, *, store: PlanStore | None, report: Report | None, as_json: bool
    ) -> None:
        self._plan, self._work, self._store, self._report = plan, work, store, report
        self._as_json = as_json
        self._ordered = InPlanOrder(plan)
        self._done, self._failed = 0, 0

    def run(self) -> int:
        """Run the plan; return the exit code: 1 when a case failed, 130 after an interrupt."""
        self._print_stored()
        try:
            self._run()
        except KeyboardInterrupt:
            self._print(f"interrupted: {self._done} of {len(self._plan)} cases are done, {self._storage()}")
            return INTERRUPTED
        except ClusterLost as error:
            self._print(f"{error}; {self._done} of {len(self._plan)} cases are done, {self._storage()}")
            return 1
        finally:
            self._publish(self._ordered.rest())
            if self._report is not None:
                self._report.page.write(self._report.path)
        if len(self._plan) > 1:
            self._print(f"{self._done} cases: {self._done - self._failed} passed, {self._failed} failed")
        return 1 if self._failed else 0

    def _run(self) -> None:
        done = self._store.done if self._store else {}
        for key, outcome in watched(self._plan, self._work, self._store):
            self._done += 1
            self._failed += outcome.row["status"] == "failed"
            self._publish(self._ordered.add(key, outcome))
            if key not in done:
                line = f"[{self._done}/{len(self._plan)}] {one_line(outcome.row)}"
                print(line, file=sys.stderr if self._as_json else sys.stdout, flush=True)

    def _publish(self, outcomes: Iterable[tuple[str, Outcome]]) -> None:
        """Print outcomes as JSON and add them to the report, in the order of the plan."""
        for key, outcome in outcomes:
            if self._as_json:
                print(json.dumps(outcome.row), flush=True)
            if self._report is not None:
                self._report.add(self._plan[key], outcome)

    def _print_stored(self) -> None:
        store = self._store
        if store is None or not (store.done or store.crashed or store.outdated):
            return
        text = f"{store.lines}: {len(store.done)} of {len(self._plan)} cases are stored and not run again"
        text += f"; {store.crashed} crashed" if store.crashed else ""
        text += f"; {store.outdated} were run by other code or configuration" if store.outdated else ""
        self._print(text)

    def _storage(self) -> str:
        """Where the finished cases are stored."""
        if self._store is None:
            return "not stored (--out stores them)"
        return f"stored in {self._store.lines}; --resume continues"

    def _print(self, text: str) -> None:
        print(f"trepid sim: {text}", file=sys.stderr, flush=True)


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
    return text + "".join(f"\n    {reason}" for reason in row["reasons"])
