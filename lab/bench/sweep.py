"""Sweeps: one trace hash for any process and load, and the speed-up of two processes."""

import multiprocessing
import os
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.plan import Plan, by_seeds, plan
from sim_harness.sweep.sweep import in_this_process, on_processes

RUNS_HERE, RUNS_ELSEWHERE, JOBS = 50, 50, 2
SIMULATED_S = 5.0
CASES = 16  # an even number of equal length
CASE_S = 20.0  # long enough for the start of a worker, 1 to 2 s, to be a small part
ROUNDS = 2
SUMS = 6000  # of the peer, some 10 s


def bench_determinism(here: int = RUNS_HERE, elsewhere: int = RUNS_ELSEWHERE) -> dict[str, Any]:
    """Distinct trace hashes of one case, run in this process and on two others while every core is busy.

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


def bench_sweep(cases: int = CASES, case_s: float = CASE_S, sums: int = SUMS) -> dict[str, Any]:
    """Two jobs and one on the same cases in turn, start of the workers included.

    ``speed_up`` is of wall-clock time and requires two free cores; ``speed_up_by_cpu`` is twice the ratio of the
    processor times, which depends less on other work on the machine. ``cases_per_core_hour`` is of the processor
    time of one job. The peer measures the limit of the machine:
    independent processes that only add numbers.
    """
    planned = plan(by_seeds([_moving("s_curve", case_s)], range(cases)))
    hashes = set()

    def ours(jobs: int) -> None:
        rows = {key: outcome.row["trace_sha256"] for key, outcome in on_processes(planned, jobs)}
        hashes.add(tuple(rows[key] for key in planned))

    sweep, bare = _Turns(), _Turns()
    for jobs in (1, JOBS) * ROUNDS:
        sweep.take(jobs, ours)
        bare.take(jobs, partial(_add_numbers, sums))
    return {
        "cases": f"{cases} of {case_s:g} s, {ROUNDS} times",
        **(times := sweep.result()),
        "cases_per_core_hour": round(3600 * cases * ROUNDS / times["one_job_cpu_s"]),
        **{f"bare_processes_{name}": value for name, value in bare.result().items()},
        "same_rows": len(hashes) == 1,
    }


class _Turns:
    """Wall-clock and processor time of a job on one and on two processes."""

    def __init__(self) -> None:
        self._wall_s = dict.fromkeys((1, JOBS), 0.0)
        self._cpu_s = dict.fromkeys((1, JOBS), 0.0)

    def take(self, jobs: int, work: Callable[[int], None]) -> None:
        """Add the times of ``work`` with ``jobs`` processes, which have ended afterwards."""
        wall_s, cpu_s = time.perf_counter(), _children_s()
        work(jobs)
        self._wall_s[jobs] += time.perf_counter() - wall_s
        self._cpu_s[jobs] += _children_s() - cpu_s

    def result(self) -> dict[str, float]:
        """Times, and the speed-up of two jobs."""
        return {
            "one_job_s": round(self._wall_s[1], 1),
            "two_jobs_s": round(self._wall_s[JOBS], 1),
            "one_job_cpu_s": round(self._cpu_s[1], 1),
            "two_jobs_cpu_s": round(self._cpu_s[JOBS], 1),
            "speed_up": round(self._wall_s[1] / self._wall_s[JOBS], 2),
            "speed_up_by_cpu": round(JOBS * self._cpu_s[1] / self._cpu_s[JOBS], 2),
        }


def _add_numbers(sums: int, jobs: int) -> None:
    """``sums`` sums on ``jobs`` bare processes."""
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_sum, args=(sums // jobs,), daemon=True) for _ in range(jobs)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()


def _sum(times: int) -> None:
    for _ in range(times):
        sum(range(100_000))


def _moving(name: str, duration_s: float) -> Scenario:
    """The scenario ``name``, cut off after ``duration_s``, with a car that moves from the start."""
    scenario = load_scenario(name, {"start.speed_mps": "5"}).shorten(duration_s)
    return scenario.model_copy(update={"name": f"{name}, {duration_s:g} s"})


def _again(case: Case, times: int) -> Plan:
    """A plan with the same case many times."""
    return {f"{number}": case for number in range(times)}


@contextmanager
def _busy_cores() -> Iterator[None]:
    """A busy process on every core."""
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
