"""``trepid bench live``: live drives beside lock-step runs of the same scenarios, on a quiet and a loaded machine.

A live drive is judged from its first motion: the distance that its row scores over that of all poses which the
simulated vehicle published is 1. Verdict, distance, causes and modes are those of the lock-step run of the same
seed, unless the machine is too slow for the camera of the scenario; the rate of the camera is the proof of that.

Every drive is one line in ``runs/live_<seed>.jsonl``: an interrupted benchmark continues. A row keeps the load
average from before the drive, because other programs of the machine slow a drive down as much as the load does.
"""

import functools
import multiprocessing
import os
import random
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from lab.bench.live.program import DriveProgram
from lab.bench.runs import trepid
from sim_harness.live.course import has_begun, lockstep_only
from sim_harness.scenarios.scenario import Scenario, list_scenarios
from sim_harness.sweep.store import stored_rows
from trepid.bus import open_bus
from trepid.clock import epoch_clock
from trepid.config import WORK_DIR
from trepid.topics import SIM_TRUTH

COUNT = 20  # scenarios
LOADS = (0, 8)  # processes that compute beside the drive
SLOW = 0.9  # of the rate of the camera: a machine that renders fewer frames is too slow
NEAR_M, NEAR = 1.0, 0.02  # distances agree within this, or within this share
AGREE = ("distance agrees", "causes agree", "modes agree")
HELD_S = 0.5  # a cause or mode of a shorter time need not occur in both
Row = dict[str, Any]


class Pairing(NamedTuple):
    """A live drive that is compared with its lock-step run."""

    scenario: Scenario
    seed: int
    load: int
    """Processes that compute beside the drive."""


def bench_live(seed: int, count: int = COUNT) -> Row:
    """Shares and agreements by load, and one row for each drive."""
    scenarios = choose_scenarios(seed, count)
    pairings = {
        name_of(scenario, load): Pairing(scenario, seed, load) for scenario in scenarios for load in LOADS
    }
    rows = stored_rows(WORK_DIR / "runs" / f"live_{seed}.jsonl", compare_drive, pairings, jobs=1)
    drives = dict(zip(pairings, rows, strict=True))
    return {"loads": {f"load {load}": summary(drives, load) for load in LOADS}, "drives": drives}


def name_of(scenario: Scenario, load: int) -> str:
    """The name of a drive in the results."""
    return f"{scenario.name}, load {load}"


def compare_drive(pairing: Pairing) -> Row:
    """The row of one live drive beside its lock-step run."""
    scenario, seed, load = pairing
    alone = lockstep_row(scenario.name, seed)
    before = os.getloadavg()[0]
    with busy(load):
        row = beside(alone, *driven_live(scenario, seed), scenario)
    return {**row, "load average before": round(before, 1)}


@functools.lru_cache(maxsize=1)
def lockstep_row(name: str, seed: int) -> Row:
    """The row of the lock-step run of a scenario, which the drives at all loads are compared with."""
    (row,) = trepid("sim", "run", name, "--seed", str(seed))
    return row


def choose_scenarios(seed: int, count: int) -> list[Scenario]:
    """``count`` random scenarios that a live drive can simulate, among them one of every tag."""
    live = [scenario for scenario in list_scenarios() if not any(lockstep_only(scenario))]
    random.Random(seed).shuffle(live)
    found: list[Scenario] = []
    for tag in sorted({tag for scenario in live for tag in scenario.tags}):
        if not any(tag in scenario.tags for scenario in found):
            found.append(next(scenario for scenario in live if tag in scenario.tags))
    return (found + [scenario for scenario in live if scenario not in found])[:count]


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes compute meanwhile, as a loaded machine has them."""
    workers = [
        multiprocessing.get_context("spawn").Process(target=compute, daemon=True) for _ in range(processes)
    ]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.join()


def compute() -> None:
    """Compute until the end of the process."""
    value = 0.5
    while True:
        value = 3.9 * value * (1.0 - value)


def driven_live(scenario: Scenario, seed: int) -> tuple[Row, float]:
    """The row of a live drive, and the distance of all poses of the simulated vehicle after a run-up [m]."""
    with tempfile.TemporaryDirectory(prefix="trepid-live-") as folder:
        program = DriveProgram(Path(folder), ["--scenario", scenario.name, "--seed", str(seed)])
        try:
            running = program.running
            stations_m: list[float] = []
            clock = epoch_clock(running.clock_offset_ns)
            with open_bus(running.vehicle_name, clock, connect=running.endpoint) as bus:
                truth = bus.stream(SIM_TRUTH)
                while program.popen.poll() is None:
                    bus.wait(0.1)
                    stations_m += [one.station_m for one, _ in truth.drain() if has_begun(one)]
                    time.sleep(0.05)
            row = program.row()
        finally:
            program.close()
    return row, max(stations_m, default=0.0) - min(stations_m, default=0.0)


def beside(alone: Row, live: Row, moved_m: float, scenario: Scenario) -> Row:
    """The live drive beside the lock-step run."""
    rate_hz = (live.get("processes") or {}).get("camera", {}).get("rate_hz") or 0.0
    apart_m = abs((live["distance_m"] or 0.0) - alone["distance_m"])
    return {
        "verdict": live["status"],
        "verdict in lock-step": alone["status"],
        "reasons": "; ".join(live["reasons"]),
        "too slow": rate_hz < SLOW * scenario.camera.rate_hz,
        "camera [1/s]": rate_hz,
        "scored share": round((live["distance_m"] or 0.0) / moved_m, 4) if moved_m else None,
        "distance [m]": live["distance_m"],
        "distance agrees": apart_m <= max(NEAR_M, NEAR * alone["distance_m"]),
        "distance in lock-step [m]": alone["distance_m"],
        "causes agree": lasting(live["causes"]) == lasting(alone["causes"]),
        "modes agree": lasting(live["modes"]) == lasting(alone["modes"]),
        "only live": " ".join(sorted(words(live) - words(alone))),
        "only in lock-step": " ".join(sorted(words(alone) - words(live))),
    }


def words(row: Row) -> set[str]:
    """The lasting causes and modes of a drive."""
    return lasting(row["causes"]) | lasting(row["modes"])


def lasting(seconds: dict[str, float]) -> set[str]:
    """The words that held for HELD_S."""
    return {word for word, held_s in seconds.items() if held_s >= HELD_S}


def summary(drives: dict[str, Row], load: int) -> Row:
    """The counts of the drives beside ``load`` processes."""
    rows = [row for name, row in drives.items() if name.endswith(f", load {load}")]
    shares = [row["scored share"] for row in rows if row["scored share"] is not None]
    return {
        "drives": len(rows),
        "same verdict": count_of(rows, lambda row: row["verdict"] == row["verdict in lock-step"]),
        "other verdict, machine too slow": count_of(
            rows, lambda row: row["verdict"] != row["verdict in lock-step"] and row["too slow"]
        ),
        "too slow": count_of(rows, lambda row: row["too slow"]),
        "least scored share": min(shares, default=None),
        **{name: count_of(rows, lambda row, name=name: row[name]) for name in AGREE},
    }


def count_of(rows: Sequence[Row], holds: Any) -> int:
    """How many of ``rows`` it holds for."""
    return sum(bool(holds(row)) for row in rows)
