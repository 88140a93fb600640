"""Output of a sweep on the command line: rows or lines, progress, and a report at the end."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from sim_harness.report.page import Page
from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.outcome import ClusterLost, Outcome, is_complete
from sim_harness.sweep.plan import Plan
from sim_harness.sweep.plan_store import PlanStore
from sim_harness.sweep.store import Row
from sim_harness.sweep.sweep import Workforce, sweep
from trepid.config import INTERRUPTED
from trepid.speech.loudness import note


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A report page, its file, and the command that repeats a case."""

    path: Path
    page: Page
    command: Callable[[Case], str]


def show(
    plan: Plan, work: Workforce, *, store: PlanStore | None, report: Report | None, as_json: bool
) -> int:
    """Run a plan and print its progress and results; return 1 when a case failed, 130 after an interrupt.

    Raises InputError for a case that cannot be run; the rows finished before it are stored and printed.
    """

    def publish(outcomes: Iterable[tuple[str, Outcome]]) -> None:
        """Print outcomes as JSON and add them to the report, in the order of the plan."""
        for key, outcome in outcomes:
            if as_json:
                print(json.dumps(outcome.row), flush=True)
            if report is not None:
                tags = plan[key].scenario.tags
                command = report.command(plan[key])
                report.page.add(outcome.row, tags=tags, command=command, detail=outcome.detail)

    stored = store.done if store else {}
    if store and (stored or store.crashed or store.outdated):
        text = f"{store.lines}: {len(stored)} of {len(plan)} cases are stored and not run again"
        text += f"; {store.crashed} crashed" if store.crashed else ""
        text += f"; {store.outdated} were run by other code or configuration" if store.outdated else ""
        _note(text)
    place = f"stored in {store.lines}; --resume continues" if store else "not stored (--out stores them)"
    ordered, done, failed = InPlanOrder(plan), 0, 0
    try:
        for key, outcome in sweep(plan, work, store):
            done += 1
            failed += outcome.row["status"] == "failed"
            publish(ordered.add(key, outcome))
            if key not in stored:
                line = f"[{done}/{len(plan)}] {one_line(outcome.row)}"
                if as_json:
                    note(line)
                else:
                    print(line, flush=True)
    except KeyboardInterrupt:
        _note(f"interrupted: {done} of {len(plan)} cases are done, {place}")
        return INTERRUPTED
    except ClusterLost as error:
        _note(f"{error}; {done} of {len(plan)} cases are done, {place}")
        return 1
    finally:
        publish(ordered.rest())
        if report is not None:
            report.page.write(report.path)
    if len(plan) > 1:
        _note(f"{done} cases: {done - failed} passed, {failed} failed")
    return 1 if failed else 0


def _note(text: str) -> None:
    note(f"trepid sim: {text}")


class InPlanOrder:
    """Puts outcomes that finish in any order into the order of the plan."""

    def __init__(self, plan: Plan) -> None:
        self._awaited = iter(plan)
        self._next = next(self._awaited, None)
        self._early: dict[str, Outcome] = {}

    def add(self, key: str, outcome: Outcome) -> Iterator[tuple[str, Outcome]]:
        """Add an outcome; yields all outcomes that have no unfinished predecessor."""
        self._early[key] = outcome
        while self._next in self._early:
            yield self._next, self._early.pop(self._next)
            self._next = next(self._awaited, None)

    def rest(self) -> Iterator[tuple[str, Outcome]]:
        """The outcomes behind unfinished ones, after the end of the sweep."""
        for key in [key for key in self._awaited if key in self._early]:
            yield key, self._early.pop(key)


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
