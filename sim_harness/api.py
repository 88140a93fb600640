"""Runs and sweeps from Python: ``trepid.run`` and ``trepid.sweep``."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from functools import partial
from pathlib import Path

from sim_harness.lockstep.closed_loop import Result, check_configuration
from sim_harness.lockstep.closed_loop import run as run_scenario
from sim_harness.lockstep.recording import recording
from sim_harness.report.page import Page
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.sampling import Method
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.outcome import Outcome
from sim_harness.sweep.plan import Plan, PlanStore, Selection, by_sampling, by_seeds, plan, select
from sim_harness.sweep.store import Row
from sim_harness.sweep.sweep import InPlanOrder, RunFiles, Watch, Workforce, saving, workforce
from sim_harness.sweep.sweep import sweep as outcomes_of
from trepid.config import InputError, refuse, using_car
from trepid.recording.writer import check_recording


def run(
    scenario: str | Path | Scenario,
    *,
    seed: int = 0,
    settings: Mapping[str, object] | None = None,
    estimators: Sequence[str] = (),
    car: str | Path | None = None,
    record: str | Path | None = None,
    raw_images: bool = False,
) -> Result:
    """Drive a scenario once in lock-step and judge it, as ``trepid sim run`` does.

    ``scenario``: a name, a file or a :class:`Scenario`; ``settings``: other values of its fields by dotted name,
    such as ``{"duration_s": 20}``; ``estimators``: names, or files of driving networks, instead of its own (neither
    with a :class:`Scenario`, which holds its own); ``record``: the recording (.mcap) to write.

    The result has ``row()``, the dictionary that ``trepid sim run --json`` prints, ``reasons`` (empty when
    passed), ``metrics`` and ``trace``, whose columns are arrays of shape (n,): ``trace["lateral_offset_m"]``.
    The same scenario and seed give the same trace, bit for bit. Raises InputError for wrong input.
    """
    refuse("raw_images needs record", raw_images and record is None)
    changed = bool(settings or estimators)
    refuse("settings and estimators are not for a Scenario", changed and isinstance(scenario, Scenario))
    with using_car(None if car is None else Path(car)):
        if not isinstance(scenario, Scenario):
            scenario = load_scenario(str(scenario), _changes(settings, estimators))
        scenario.check()
        check_configuration([scenario])
        if record is None:
            return run_scenario(scenario, seed=seed)
        check_recording(Path(record))
        with recording(Path(record), scenario, raw_images=raw_images) as witness:
            return run_scenario(scenario, seed=seed, witness=witness)


def sweep(
    scenarios: str | Path | Sequence[str | Path] | Selection = (),
    *,
    tags: Sequence[str] = (),
    seeds: int | Sequence[int] = 1,
    sample: str | None = None,
    cases: int | None = None,
    seed: int = 0,
    settings: Mapping[str, object] | None = None,
    estimators: Sequence[str] = (),
    jobs: int = 1,
    cluster: str | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    report: str | Path | None = None,
    files: RunFiles | None = None,
    car: str | Path | None = None,
    watch: Watch | None = None,
) -> list[Row]:
    """Run many cases, as ``trepid sim run S… --jobs N`` does; their rows in the order of the cases.

    ``scenarios``: names, files, or ``"all"``, with one of ``tags`` where tags are given; or what
    :func:`sim_harness.sweep.plan.select` chose of them, without tags, settings and estimators.
    ``seeds``: the seeds of each, or their number from ``seed`` on. ``sample``: ``"grid"``, ``"random"`` or
    ``"lhs"`` draws ``cases`` cases from the ranges under ``vary`` instead. ``jobs`` processes, or the Dask
    ``cluster`` at this address, run them.
    ``out`` (folder, .jsonl or .parquet) stores each row as it is finished; with ``resume`` only the cases run that
    it does not hold. ``report``: the page (.html) to write; ``files``: those of a single run. ``settings`` and
    ``estimators``: as of :func:`run`. ``watch`` gets each row as it is finished.

    A row is the dictionary that ``trepid sim run --json`` prints; ``pandas.DataFrame(rows)`` is a table of them.
    A case that crashes is a row with status ``failed``. Raises InputError for wrong input or configuration.
    """
    refuse("resume needs out", resume and out is None)
    refuse("cluster has its own processes: jobs cannot be given too", cluster is not None and jobs > 1)
    refuse(f"jobs {jobs}: at least 1 expected", jobs < 1)
    files, watch, page_at = files or RunFiles(), watch or Watch(), None if report is None else Path(report)
    with using_car(None if car is None else Path(car)):
        selection = _selection(scenarios, tags, _changes(settings, estimators))
        planned = _plan_runs(selection, seeds, sample, cases, seed)
        check_configuration(case.scenario for case in planned.values())
        _check_files(planned, page_at, files.paths)
        work: Workforce = partial(saving, files=files, detailed=page_at is not None)
        if not files.paths:
            work = workforce(jobs=min(jobs, len(planned)), cluster=cluster, detailed=page_at is not None)
        store = PlanStore(Path(out), planned, code=fingerprint(), resume=resume) if out else nullcontext()
        with store as kept:
            watch.begin(planned, kept)
            found = outcomes_of(planned, work, kept)
            if page_at is not None:
                found = _write_page(found, selection, planned, Page(watch.title), page_at)
            rows = {}
            with closing(found):  # type: ignore[type-var]
                for key, outcome in found:
                    rows[key] = outcome.row
                    watch.add(key, outcome)
        return [rows[key] for key in planned]


def _selection(
    scenarios: str | Path | Sequence[str | Path] | Selection, tags: Sequence[str], changes: Mapping[str, str]
) -> Selection:
    if isinstance(scenarios, Selection):
        refuse("tags, settings and estimators are not for a Selection", bool(tags or changes))
        return scenarios
    sources = [scenarios] if isinstance(scenarios, str | Path) else scenarios
    return select([str(one) for one in sources], tags, changes)


def _check_files(planned: Plan, report: Path | None, single: Sequence[Path]) -> None:
    """Raise InputError when a file of one run is given for more, or when the folder of a file does not exist."""
    for file in single:
        if len(planned) > 1:
            raise InputError(f"{file}: can hold one run, not {len(planned)}")
    for file in (*([report] if report else []), *single):
        if not file.parent.is_dir():
            raise InputError(f"{file}: there is no folder {file.parent}")


def _write_page(
    found: Iterator[tuple[str, Outcome]], selection: Selection, planned: Plan, page: Page, path: Path
) -> Iterator[tuple[str, Outcome]]:
    """``found``, and at its end, also by an error, the ``page`` of what is finished, in the order of the plan."""
    ordered = InPlanOrder(planned)

    def add(outcomes: Iterable[tuple[str, Outcome]]) -> None:
        for key, outcome in outcomes:
            case = planned[key]
            command, tags = selection.command(case), case.scenario.tags
            page.add(outcome.row, tags=tags, command=command, detail=outcome.detail)

    try:
        for key, outcome in found:
            add(ordered.add(key, outcome))
            yield key, outcome
    finally:
        add(ordered.rest())
        page.write(path)


def _changes(settings: Mapping[str, object] | None, estimators: Sequence[str]) -> dict[str, str]:
    """Changes of a scenario as texts of ``--set``: JSON is YAML."""
    changes = {name: json.dumps(value) for name, value in (settings or {}).items()}
    return {**changes, **changes_of(list(estimators))}


def _plan_runs(
    selection: Selection, seeds: int | Sequence[int], sample: str | None, cases: int | None, seed: int
) -> Plan:
    chosen = range(seed, seed + seeds) if isinstance(seeds, int) else seeds
    refuse(f"seeds {seeds}: at least one expected", not chosen)
    refuse("cases needs sample", cases is not None and sample is None)
    if sample is None:
        return plan(by_seeds(selection.scenarios, chosen))
    refuse("sample draws the seeds itself: seeds cannot be given too", seeds != 1)
    if sample not in [*Method]:
        raise InputError(f"sample {sample!r}: expected {', '.join(Method)}")
    return plan(by_sampling(selection.scenarios, Method(sample), cases, seed=seed))
