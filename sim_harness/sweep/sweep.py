"""A sweep: runs the cases of a plan, stores their rows and yields outcomes as they finish."""

from collections.abc import Callable, Iterator
from contextlib import closing, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sim_harness.lockstep.recording import recording
from sim_harness.sweep.outcome import Outcome, crash_outcome, execute, perform
from sim_harness.sweep.plan import Plan, PlanStore
from sim_harness.sweep.pool import Lost, imap_unordered
from sim_harness.sweep.progress import SweepProgress
from trepid.config import InputError

Workforce = Callable[[Plan], Iterator[tuple[str, Outcome]]]
"""Runs cases and yields their outcomes by key as they finish; closing the iterator ends it at once."""


class Watch:
    """Follows a sweep; this one does nothing."""

    title = "trepid.sweep"
    """Of the report."""

    def begin(self, plan: Plan, store: PlanStore | None) -> None:
        """The cases of ``plan`` are about to run, but for those that ``store`` holds."""

    def add(self, key: str, outcome: Outcome) -> None:
        """The case ``key`` is finished, or was stored."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFiles:
    """The files of a single run: trace (.npz), picture (.png) and recording (.mcap)."""

    trace: Path | None = None
    picture: Path | None = None
    record: Path | None = None
    raw_images: bool = False  # in the recording

    @property
    def paths(self) -> list[Path]:
        """The files to write."""
        return [path for path in (self.trace, self.picture, self.record) if path is not None]


def in_this_process(plan: Plan, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases one after the other in this process."""
    for key, case in plan.items():
        yield key, execute(case, detailed=detailed)


def on_processes(plan: Plan, jobs: int, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases on ``jobs`` processes. The case of a worker that is killed has crashed; the others go on."""
    with closing(imap_unordered(partial(execute, detailed=detailed), plan, jobs)) as results:
        for key, result in results:
            if isinstance(result, Lost):
                yield key, crash_outcome(plan[key], f"crashed: its process {result.reason}")
            else:
                yield key, result


def workforce(*, jobs: int = 1, cluster: str | None = None, detailed: bool = False) -> Workforce:
    """A function that runs cases on a cluster, on ``jobs`` processes or here. Raises InputError without Dask."""
    if cluster is not None:
        try:
            from sim_harness.sweep.cluster import on_cluster
        except ModuleNotFoundError as error:
            raise InputError("--cluster needs Dask: pip install 'trepid[cluster]'") from error
        return partial(on_cluster, address=cluster, detailed=detailed)
    if jobs > 1:
        return partial(on_processes, jobs=jobs, detailed=detailed)
    return partial(in_this_process, detailed=detailed)


def sweep(plan: Plan, work: Workforce, store: PlanStore | None = None) -> Iterator[tuple[str, Outcome]]:
    """The outcome of every case of ``plan``: first the stored ones, then the others as they finish.

    Every outcome is stored before it is yielded. Progress is shown on standard error.
    """
    done = store.done if store else {}
    for key, row in done.items():
        yield key, Outcome(row=row, code="")
    left = {key: case for key, case in plan.items() if key not in done}
    if not left:
        return
    simulated_s = sum(case.scenario.duration_s for case in left.values())
    with (
        SweepProgress(len(left), simulated_s) as progress,
        closing(work(left)) as outcomes,  # type: ignore[type-var]
    ):
        for key, outcome in outcomes:
            if store:
                store.add(key, outcome.row)
            yield key, outcome
            progress.step(plan[key].scenario.duration_s)


def saving(plan: Plan, files: RunFiles, *, detailed: bool) -> Iterator[tuple[str, Outcome]]:
    """Run the cases in this process and save ``files`` of each. Raises what a run raises."""
    from sim_harness.report.picture import draw

    for key, case in plan.items():
        record = files.record
        recorder = recording(record, case.scenario, raw_images=files.raw_images) if record else nullcontext()
        with recorder as witness:
            result, outcome = perform(case, detailed=detailed, witness=witness)
        if files.trace is not None:
            result.trace.save(files.trace)
        if files.picture is not None:
            draw(case.scenario, result.trace, files.picture, seed=case.seed)
        yield key, outcome
