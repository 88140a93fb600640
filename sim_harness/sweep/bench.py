"""What sweeps promise: one hash whatever runs where and beside what, and twice the work on two cores."""

import multiprocessing
import os
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.plan import Plan, by_seeds, plan
from sim_harness.sweep.processes import in_this_process, on_processes

RUNS_HERE, RUNS_ELSEWHERE, JOBS = 50, 50, 2
SIMULATED_S = 5.0
CASES = 16  # an even number, of equal length: what is measured is the machinery, not how cases happen to fit
CASE_S = 20.0  # long enough for the start of a worker, 1 to 2 s, to be a small part
ROUNDS = 2


def bench_determinism(here: int = RUNS_HERE, elsewhere: int = RUNS_ELSEWHERE) -> dict[str, Any]:
    """Distinct trace hashes of one case, run in this process and on two others while every core is kept busy.

    5 s through a bend from 5 m/s on, with rendering and both estimators.
    """
    case = Case(scenario=_moving("s_curve", SIMULATED_S), index=0, seed=0, parameters={})
    with _busy_cores():
        outcomes = [outcome for _, outcome in in_this_process(_again(case, here))]
        outcomes += [outcome for _, outcome in on_processes(_again(case, elsewhere), JOBS)]
        load = os.getloadavg()[0]
    hashes = {outcome.row["trace_sha256"] for outcome in outcomes}
    return {
        "runs_in_process": here,
        f"runs_on_{JOBS}_processes": elsewhere,
        "distinct_hashes": len(hashes),
        "trace_sha256": min(map(str, hashes)),
        "load_average_while_running": round(load, 1),
    }


def bench_sweep(cases: int = CASES, case_s: float = CASE_S) -> dict[str, Any]:
    """Two jobs against one on the same cases, start of the workers included; the two take turns.

    ``speed_up`` is of wall-clock time and needs two free cores; ``speed_up_by_cpu`` is what the processor time that
    both took leaves of a factor of two, whoever else is on the machine.
    """
    planned = plan(by_seeds([_moving("s_curve", case_s)], range(cases)))
    times = {jobs: [0.0, 0.0] for jobs in (1, JOBS)}
    hashes = set()
    for jobs in [*times] * ROUNDS:
        wall_s, cpu_s = time.perf_counter(), _children_s()
        rows = {key: outcome.row["trace_sha256"] for key, outcome in on_processes(planned, jobs)}
        times[jobs][0] += time.perf_counter() - wall_s
        times[jobs][1] += _children_s() - cpu_s
        hashes.add(tuple(rows[key] for key in planned))
    (one_s, one_cpu_s), (two_s, two_cpu_s) = times[1], times[JOBS]
    return {
        "cases": f"{cases} of {case_s:g} s, {ROUNDS} times",
        "one_job_s": round(one_s, 1),
        "two_jobs_s": round(two_s, 1),
        "speed_up": round(one_s / two_s, 2),
        "one_job_cpu_s": round(one_cpu_s, 1),
        "two_jobs_cpu_s": round(two_cpu_s, 1),
        "speed_up_by_cpu": round(JOBS * one_cpu_s / two_cpu_s, 2),
        "same_rows": len(hashes) == 1,
    }


def _moving(name: str, duration_s: float) -> Scenario:
    """The scenario ``name``, cut off after ``duration_s``, with a car that rolls from the beginning."""
    scenario = load_scenario(name, {"start.speed_mps": "5"}).shortened(duration_s)
    return scenario.model_copy(update={"name": f"{name}, {duration_s:g} s"})


def _again(case: Case, times: int) -> Plan:
    """The same case many times: what no other plan has."""
    return {f"{number}": case for number in range(times)}


@contextmanager
def _busy_cores() -> Iterator[None]:
    """Every core has something else to do as well."""
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_spin, daemon=True) for _ in range(os.cpu_count() or 1)]
    try:
        for process in processes:
            process.start()
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _spin() -> None:
    parent = os.getppid()
    while os.getppid() == parent:
        sum(range(100_000))


def _children_s() -> float:
    """Processor time of the children that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
