"""Runs and sweeps from Python: ``trepid.run`` and ``trepid.sweep``."""

import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

from sim_harness.lockstep.closed_loop import Result, check_configuration
from sim_harness.lockstep.closed_loop import run as run_scenario
from sim_harness.lockstep.recording import recording
from sim_harness.report.page import Page
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.sampling import Method
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.plan import Plan, Selection, by_sampling, by_seeds, plan, select
from sim_harness.sweep.plan_store import PlanStore
from sim_harness.sweep.store import Row
from sim_harness.sweep.sweep import sweep as outcomes_of
from sim_harness.sweep.sweep import workforce
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
    scenarios: str | Path | Sequence[str | Path] = (),
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
    car: str | Path | None = None,
) -> list[Row]:
    """Run many cases, as ``trepid sim run S… --jobs N`` does; their rows in the order of the cases.

    ``scenarios``: names, files, or ``"all"``, with one of ``tags`` where tags are given. ``seeds``: the seeds of
    each, or their number from ``seed`` on. ``sample``: ``"grid"``, ``"random"`` or ``"lhs"`` draws ``cases`` cases
    from the ranges under ``vary`` instead. ``jobs`` processes, or the Dask ``cluster`` at this address, run them.
    ``out`` (folder, .jsonl or .parquet) stores each row as it is finished; with ``resume`` only the cases run that
    it does not hold. ``report``: the page (.html) to write. ``settings`` and ``estimators``: as of :func:`run`.

    A row is the dictionary that ``trepid sim run --json`` prints; ``pandas.DataFrame(rows)`` is a table of them.
    A case that crashes is a row with status ``failed``. Raises InputError for wrong input or configuration.
    """
    refuse("resume needs out", resume and out is None)
    refuse("cluster has its own processes: jobs cannot be given too", cluster is not None and jobs > 1)
    refuse(f"jobs {jobs}: at least 1 expected", jobs < 1)
    if report is not None and not Path(report).parent.is_dir():
        raise InputError(f"{report}: there is no folder {Path(report).parent}")
    with using_car(None if car is None else Path(car)):
        sources = [scenarios] if isinstance(scenarios, str | Path) else scenarios
        selection = select([str(one) for one in sources], tags, _changes(settings, estimators))
        planned = _planned(selection, seeds, sample, cases, seed)
        check_configuration(case.scenario for case in planned.values())
        work = workforce(jobs=min(jobs, len(planned)), cluster=cluster, detailed=report is not None)
        store = PlanStore(Path(out), planned, code=fingerprint(), resume=resume) if out else nullcontext()
        with store as kept:
            done = dict(outcomes_of(planned, work, kept))
        if report is not None:
            page = Page("trepid.sweep")
            for key, case in planned.items():
                page.add(
                    done[key].row,
                    tags=case.scenario.tags,
                    command=selection.command(case),
                    detail=done[key].detail,
                )
            page.write(Path(report))
        return [done[key].row for key in planned]


def _changes(settings: Mapping[str, object] | None, estimators: Sequence[str]) -> dict[str, str]:
    """Changes of a scenario as texts of ``--set``: JSON is YAML."""
    changes = {name: json.dumps(value) for name, value in (settings or {}).items()}
    return {**changes, **changes_of(list(estimators))}


def _planned(
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
