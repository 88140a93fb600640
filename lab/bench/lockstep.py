"""Real-time factor of the closed loop, with the true lane and with rendering, and steps per second of peers.

By wall clock, as a user waits, and by the computing time of this process, which other work on the machine does not
lengthen as much. A step is one vehicle period with everything that is due in it: plant, sensors, limiter and
referee, and camera, perception, supervisor and controller at their own rates. The peers' steps are those of
``bench plants``: CommonRoad's bare models, and highway-env's lane-keeping task, in which nothing perceives
or decides.
"""

import time
from typing import Any

import cv2
import numpy as np

from lab.bench.commits.paired import against_commit
from lab.bench.plants import peers, steps_per_s
from sim_harness.lockstep.closed_loop import ClosedLoop, build_parts
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

RUNS = 3
SIGHTS = {"true_sight": {"sight": "truth"}, "rendering_and_both_estimators": {}}


def bench_lockstep(against: str = "") -> dict[str, Any]:
    """Real-time factors of a lap of the circuit, medians of runs that take turns, and steps per second.

    ``against`` a commit: the time of a simulated second with pixels beside that of the commit instead.
    """
    if against:
        return against_commit("drive", against)
    cv2.setNumThreads(1)
    scenarios = {name: load_scenario("circuit", changes) for name, changes in SIGHTS.items()}
    factors: dict[str, list[tuple[float, float]]] = {name: [] for name in scenarios}
    for seed in range(RUNS):
        for name, scenario in scenarios.items():
            factors[name].append(realtime_factors(scenario, seed=seed))
    rows: dict[str, Any] = {name: _row(runs) for name, runs in factors.items()}
    rivals = peers(load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    return rows | {name: {"steps_per_s": round(steps_per_s(advance))} for name, advance in rivals.items()}


def realtime_factors(scenario: Scenario, *, seed: int) -> tuple[float, float]:
    """Simulated time of one run over wall-clock time and over this process's computing time."""
    loop = ClosedLoop(scenario, build_parts(scenario, seed=seed), load_simulator())
    wall_s, used_s = time.perf_counter(), time.process_time()
    trace = loop.drive()
    wall_s, used_s = time.perf_counter() - wall_s, time.process_time() - used_s
    simulated_s = float(trace["t_s"][-1] - trace["t_s"][0])
    return simulated_s / wall_s, simulated_s / used_s


def _row(runs: list[tuple[float, float]]) -> dict[str, Any]:
    wall, used = np.median(runs, axis=0)
    return {
        "realtime_factor": round(float(wall), 2),
        "realtime_factor_by_computing_time": round(float(used), 2),
        "steps_per_s": round(float(used) / load_simulator().period_s),
        "runs": [f"{of_wall:.1f}/{of_used:.1f}" for of_wall, of_used in runs],
    }
