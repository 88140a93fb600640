"""A sweep on the command line: rows on standard output, lines and progress for people, a report at the end."""

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

INTERRUPTED = 130  # 128 + SIGINT, as shells have it


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A page, where it goes, and the command that repeats a case."""

    path: Path
    page: Page
    command: Callable[[Case], str]

    def add(self, case: Case, outcome: Outcome) -> None:
        """Add what came of ``case``."""
        tags = [tag.value for tag in case.scenario.tags]
        self.page.add(outcome.row, tags=tags, command=self.command(case), detail=outcome.detail)


class Show:
    """Runs a plan before the eyes of the user."""

    def __init__(
        self, plan: Plan, work: Workforce, *, store: PlanStore | None, report: Report | None, as_json: bool
    ) -> None:
        self._plan, self._work, self._store, self._report = plan, work, store, report
        self._as_json = as_json
        self._ordered = InPlanOrder(plan)
        self._done, self._failed = 0, 0

    def run(self) -> int:
        """Run everything; return the exit code: 1 when a case failed, 130 after an interrupt."""
        self._tell_what_is_there()
        try:
            self._run()
        except KeyboardInterrupt:
            self._say(f"interrupted: {self._done} of {len(self._plan)} cases are done, {self._fate()}")
            return INTERRUPTED
        except ClusterLost as error:
            self._say(f"{error}; {self._done} of {len(self._plan)} cases are done, {self._fate()}")
            return 1
        finally:
            self._hand_on(self._ordered.rest())
            if self._report is not None:
                self._report.page.write(self._report.path)
        if len(self._plan) > 1:
            self._say(f"{self._done} cases: {self._done - self._failed} passed, {self._failed} failed")
        return 1 if self._failed else 0

    def _run(self) -> None:
        done = self._store.done if self._store else {}
        for key, outcome in watched(self._plan, self._work, self._store):
            self._done += 1
            self._failed += outcome.row["status"] == "failed"
            self._hand_on(self._ordered.add(key, outcome))
            if key not in done:
                line = f"[{self._done}/{len(self._plan)}] {one_line(outcome.row)}"
                print(line, file=sys.stderr if self._as_json else sys.stdout, flush=True)

    def _hand_on(self, outcomes: Iterable[tuple[str, Outcome]]) -> None:
        """Give outcomes, in the order of the plan, to who wants them all."""
        for key, outcome in outcomes:
            if self._as_json:
                print(json.dumps(outcome.row), flush=True)
            if self._report is not None:
                self._report.add(self._plan[key], outcome)

    def _tell_what_is_there(self) -> None:
        store = self._store
        if store is None or not (store.done or store.crashed or store.outdated):
            return
        text = f"{store.lines}: {len(store.done)} of {len(self._plan)} cases are there and not run again"
        text += f"; {store.crashed} crashed" if store.crashed else ""
        text += f"; {store.outdated} were run by other code or configuration" if store.outdated else ""
        self._say(text)

    def _fate(self) -> str:
        """What becomes of the cases that are done."""
        if self._store is None:
            return "not kept (--out keeps them)"
        return f"kept in {self._store.lines}; --resume goes on from there"

    def _say(self, text: str) -> None:
        print(f"trepid sim: {text}", file=sys.stderr, flush=True)


def one_line(row: Row) -> str:
    """A run in a line for people, and below it the reasons why it failed."""
    values = ", ".join(f"{name} = {value}" for name, value in row.get("parameters", {}).items())
    text = f"{row['scenario']} seed {row['seed']}{f' ({values})' if values else ''}: {row['status']}"
    if is_complete(row):
        text += (
            f", {row['distance_m']:.0f} m in {row['duration_s']:.1f} s, error max"
            f" {row['max_lateral_error_m']:.2f} m rms {row['rms_lateral_error_m']:.2f} m, departures"
            f" {row['departures']}, interventions {row['interventions']}, {row['realtime_factor']:.1f}x real time"
        )
    return text + "".join(f"\n    {reason}" for reason in row["reasons"])
