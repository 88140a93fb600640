"""Time of an MPC step, relative to acados on the same problems in the same run.

The problems are recorded from drives of the law: an S with noise and an initial offset, at three speeds. Every
solver solves each problem in turn, starting at its own last solution. The time of the law includes the input of the
problem, linearisation, solution and check. The time of acados is that of its solve, compiled C; setting the problem
stage by stage through its Python interface takes several times as long and is not included.

Times are by wall clock and by processor time; other work on the machine lengthens the latter less.
"""

import multiprocessing
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from controller.controller import ControllerSettings
from controller.laws.lateral import LawName
from controller.laws.mpc import MpcSettings
from controller.laws.mpc_model import Grid, Problem
from controller.laws.mpc_solver import Soft, Solver
from lab.bench.control.acados_peer import CONFIGURATIONS, Acados, missing
from lab.bench.control.contestants import nominal, shipped_settings, with_law
from lab.bench.control.episode import S_DURATION_S, drive, s_curve

SPEEDS_MPS, DURATION_S = (8.0, 16.0, 30.0), S_DURATION_S
NOISE_M, START_M = 0.03, 0.4
LOADED_TICKS, TICK_S = 400, 0.02
CONVERGED = 12  # iterations


class SolveTimes(NamedTuple):
    """Times of one solve [µs]."""

    wall_us: float
    processor_us: float


Times = dict[str, list[SolveTimes]]


class SolverCall(NamedTuple):
    """One call of the solver."""

    now: Problem
    shift: float
    scale: float


def bench_mpc(seed: int) -> dict[str, Any]:
    """Times per tick [µs], their ratios to acados, and the error of the first w."""
    mpc = shipped_settings().lateral.mpc
    asked = record_calls(shipped_settings(), seed)
    times: Times = {"trepid": []}
    with tempfile.TemporaryDirectory() as folder:
        peers = _peers(Path(folder), mpc)
        first = _interleave(asked, mpc, peers, times)
    rows: dict[str, Any] = {name: _row(spent) for name, spent in times.items()}
    optimum = np.array([_optimal(one.now, mpc) for one in asked])
    for name, w in first.items():
        rows[name]["first w off the optimum, rms / all rms"] = (
            f"{_rms(np.array(w) - optimum) / _rms(optimum):.1e}"
        )
    for name in peers:
        rows[name] |= _ratios(times["trepid"], times[name])
    if reason := missing():
        rows["acados"] = reason
    rows["trepid, two other processes busy, 50 Hz"] = _row(_time_under_load(asked, mpc))
    return rows


def grid_and_soft(settings: MpcSettings) -> tuple[Grid, Soft]:
    """Arguments of the solver, built by the law."""
    return Grid(settings.stages, settings.stage, settings.quickness), Soft(*settings.soft_price)


def record_calls(settings: ControllerSettings, seed: int) -> list[SolverCall]:
    """Problems of the law on a drive."""
    calls: list[SolverCall] = []
    solve = Solver.solve

    def note_call(solver: Solver, now: Problem, *, shift: float = 0.0, scale: float = 1.0) -> Any:
        calls.append(SolverCall(now, shift, scale))
        return solve(solver, now, shift=shift, scale=scale)

    with mock.patch.object(Solver, "solve", note_call):
        for speed_mps in SPEEDS_MPS:
            episode = s_curve(speed_mps, nominal(), offset_noise_m=NOISE_M, start_m=START_M, seed=seed)
            drive(replace(episode, duration_s=DURATION_S), with_law(settings, LawName.MPC))
    return calls


def _peers(folder: Path, settings: MpcSettings) -> dict[str, Acados]:
    if missing():
        return {}
    grid, soft = grid_and_soft(settings)
    return {
        name: Acados(folder, f"lane_keeping_{i}", grid, soft, options)
        for i, (name, options) in enumerate(CONFIGURATIONS.items())
    }


def _interleave(
    asked: list[SolverCall], settings: MpcSettings, peers: dict[str, Acados], times: Times
) -> dict[str, list[float]]:
    """Every solver solves every problem; fills ``times`` [µs] and returns the first w of every solution."""
    solver = Solver(*grid_and_soft(settings))
    first: dict[str, list[float]] = {"trepid": [], **{name: [] for name in peers}}
    times.update({name: [] for name in peers})
    for tick, one in enumerate(asked):
        turns = ["trepid", *peers]
        for name in turns if tick % 2 else reversed(turns):
            if name == "trepid":
                spent, plan = _time_call(partial(solver.solve, one.now, shift=one.shift, scale=one.scale))
            else:
                peers[name].prepare(one.now, shift=one.shift, scale=one.scale)
                spent, status = _time_call(peers[name].solve)
                plan = peers[name].plan() if status == 0 else None
            times[name].append(spent)
            first[name].append(float(plan[0]) if plan is not None else np.nan)
    return first


def _time_call(call: Callable[[], Any]) -> tuple[SolveTimes, Any]:
    start_s, used_s = time.perf_counter(), time.thread_time()
    result = call()
    used_s, wall_s = time.thread_time() - used_s, time.perf_counter() - start_s
    return SolveTimes(1e6 * wall_s, 1e6 * used_s), result


def _optimal(now: Problem, settings: MpcSettings) -> float:
    """First w of the converged solution, which is that of IPOPT (tests/controller/laws/test_mpc.py)."""
    solver = Solver(*grid_and_soft(settings))
    for _ in range(CONVERGED):
        plan = solver.solve(now)
    return float(plan[0]) if plan is not None else np.nan


def _time_under_load(asked: list[SolverCall], settings: MpcSettings) -> list[SolveTimes]:
    """Times at 50 Hz on a machine with a busy process per core."""
    context = multiprocessing.get_context("spawn")
    busy = [context.Process(target=_never_rest, daemon=True) for _ in range(multiprocessing.cpu_count())]
    for process in busy:
        process.start()
    try:
        solver, times = Solver(*grid_and_soft(settings)), []
        for one in asked[:LOADED_TICKS]:
            time.sleep(TICK_S)
            spent, _ = _time_call(partial(solver.solve, one.now, shift=one.shift, scale=one.scale))
            times.append(spent)
        return times
    finally:
        for process in busy:
            process.terminate()
            process.join()


def _never_rest() -> None:
    while True:
        pass


def _row(times: list[SolveTimes]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for kind, spent in zip(SolveTimes._fields, zip(*times, strict=True), strict=True):
        p50, p99 = np.percentile(spent, [50, 99])
        row[f"{kind} p50 / p99 / max"] = f"{p50:.0f} / {p99:.0f} / {max(spent):.0f}"
    return row


def _ratios(ours: list[SolveTimes], theirs: list[SolveTimes]) -> dict[str, float]:
    ratios = np.percentile(ours, [50, 99], axis=0) / np.percentile(theirs, [50, 99], axis=0)
    names = [
        f"trepid / acados, {share}, {kind}" for share in ("p50", "p99") for kind in ("wall", "processor")
    ]
    return {name: round(float(ratio), 2) for name, ratio in zip(names, ratios.ravel(), strict=True)}


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
