"""A sweep: the cases of a plan, run by someone, kept in a store, given out as they finish."""

from collections.abc import Callable, Iterator
from contextlib import closing, nullcontext
from functools import partial
from pathlib import Path

import cv2

from sim_harness.lockstep.recording import recording
from sim_harness.sweep.outcome import Outcome, perform
from sim_harness.sweep.plan import Plan
from sim_harness.sweep.processes import in_this_process, on_processes
from sim_harness.sweep.progress import SweepProgress
from sim_harness.sweep.store import Store
from trepid.config import InputError

Workforce = Callable[[Plan], Iterator[tuple[str, Outcome]]]
"""Runs cases and gives their outcomes by key as they finish; closing the iterator ends it at once."""


def workforce(*, jobs: int = 1, cluster: str | None = None, detailed: bool = False) -> Workforce:
    """Who runs the cases: a cluster, ``jobs`` processes, or this process. Raises InputError without Dask."""
    if cluster is not None:
        try:
            from sim_harness.sweep.cluster import on_cluster
        except ModuleNotFoundError as error:
            raise InputError("--cluster needs Dask: pip install 'trepid[cluster]'") from error
        return partial(on_cluster, address=cluster, detailed=detailed)
    if jobs > 1:
        return partial(on_processes, jobs=jobs, detailed=detailed)
    return partial(in_this_process, detailed=detailed)


def sweep(plan: Plan, work: Workforce, store: Store | None = None) -> Iterator[tuple[str, Outcome]]:
    """The outcome of every case of ``plan``: first those that the store has, then the others as they finish.

    Each is in the store before it is given out.
    """
    done = store.done if store else {}
    for key, row in done.items():
        yield key, Outcome(row=row, code="")
    left = {key: case for key, case in plan.items() if key not in done}
    if not left:
        return
    with closing(work(left)) as outcomes:  # type: ignore[type-var]
        for key, outcome in outcomes:
            if store:
                store.add(key, outcome.row)
            yield key, outcome


def watched(plan: Plan, work: Workforce, store: Store | None = None) -> Iterator[tuple[str, Outcome]]:
    """``sweep``, which tells on standard error how far it is with what the store does not have."""
    done = store.done if store else {}
    left_s = [case.scenario.duration_s for key, case in plan.items() if key not in done]
    with SweepProgress(len(left_s), sum(left_s)) as progress:
        for key, outcome in sweep(plan, work, store):
            yield key, outcome
            if key not in done:
                progress.step(plan[key].scenario.duration_s)


def saving(
    plan: Plan, *, trace: Path | None, picture: Path | None, record: Path | None, detailed: bool
) -> Iterator[tuple[str, Outcome]]:
    """Run the cases here, and save trace, picture and recording of each. Raises what a run raises."""
    from sim_harness.report.picture import draw

    for key, case in plan.items():
        with recording(record, case.scenario) if record else nullcontext() as witness:
            result, outcome = perform(case, detailed=detailed, witness=witness)
        if trace is not None:
            result.trace.save(trace)
        if picture is not None and not cv2.imwrite(
            str(picture), draw(case.scenario, result.trace, seed=case.seed)
        ):
            raise InputError(f"{picture}: cannot be written as an image")
        yield key, outcome


class InPlanOrder:
    """Gives things that finish in any order in that of the plan."""

    def __init__(self, plan: Plan) -> None:
        self._awaited = iter(plan)
        self._next = next(self._awaited, None)
        self._early: dict[str, Outcome] = {}

    def add(self, key: str, outcome: Outcome) -> Iterator[tuple[str, Outcome]]:
        """Everything whose turn has come now that this is there."""
        self._early[key] = outcome
        while self._next in self._early:
            yield self._next, self._early.pop(self._next)
            self._next = next(self._awaited, None)

    def rest(self) -> Iterator[tuple[str, Outcome]]:
        """What waits for others that will not come."""
        for key in [key for key in self._awaited if key in self._early]:
            yield key, self._early.pop(key)
