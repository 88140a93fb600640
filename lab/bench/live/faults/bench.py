"""``trepid bench faults``: every fault ``--count`` times on the simulated car and through the CAN counterpart.

Real processes of real drives (``trepid drive``) are harmed while the car laps at 3 m/s. Every drive takes some
faults that it survives and one that ends it. ``--jobs`` drives run at a time. Starvation, which would reach the
drives beside it, comes last, one drive at a time. Rows are in ``runs/faults.jsonl`` at the end of their drive; the
same command continues an interrupted run. Ctrl-C ends it with the figures so far. Rows of other code do not count.
"""

import math
import threading
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import chain, islice
from typing import Any

import numpy as np

from lab.bench.chosen import known_names
from lab.bench.live.faults.catalogue import FAULTS, WIRES, Act, Fault
from lab.bench.live.faults.flow import BY_ITSELF, KEPT, NOT_AT_ALL, RENEWED, drive_faults
from sim_harness.sweep.fingerprint import fingerprint, import_closure
from sim_harness.sweep.progress import SweepProgress
from sim_harness.sweep.store import Row, Store
from trepid.config import WORK_DIR, InputError

COUNT = 100
TARGET_P99_MS, TARGET_WORST_MS = 100.0, 300.0
FAILURES = 4  # drives of one wire in a row without a result
SURVIVED = 6  # faults of one drive before the one that ends it
STORE = WORK_DIR / "runs" / "faults.jsonl"
DRIVEN = (
    *("lab.bench.live.faults.bench", "drive.cli", "drive.launcher", "sim_harness.live.course"),
    *("sim_harness.live.camera_node", "sim_harness.live.vehicle_node", "sim_harness.counterparts.ecu"),
    *("perception.node", "perception.lead.node", "supervisor.node", "controller.node"),
    *("vehicle.actuators.node", "vehicle.actuators.can.actuator", "trepid.recording.node"),
)
"""The modules of the processes; their code, and what they import, makes a row valid."""
Task = tuple[str, Fault, int]
"""Wire, fault and number of an episode."""


def bench_faults(
    count: int = COUNT, wires: tuple[str, ...] = (), faults: tuple[str, ...] = (), jobs: int = 1
) -> Row:
    """Reaction time, lane, ends, recordings by fault, for each wire."""
    chosen = [FAULTS[name] for name in known_names(faults, FAULTS, "fault") or FAULTS]
    over = known_names(wires, WIRES, "wire") or WIRES
    tasks = [
        (wire, fault, n) for n in range(count) for wire in over for fault in chosen if wire in fault.wires
    ]
    code = fingerprint(*import_closure(DRIVEN), "config")
    with Store(STORE) as store:
        with suppress(KeyboardInterrupt):
            fill(store, code, tasks, jobs)
        rows = [row for task in tasks if (row := store.get(case(task), code))]
    return {"episodes": f"{len(rows)} of {len(tasks)}", **table(rows)}


def case(task: Task) -> str:
    """The key of an episode in the store."""
    wire, fault, number = task
    return f"{wire} {fault.name} {number}"


def fill(store: Store, code: str, tasks: list[Task], jobs: int) -> None:
    """Drive until every episode has a row, ``jobs`` drives at a time. Raises InputError when drives give none."""
    left = [task for task in tasks if store.get(case(task), code) is None]
    with SweepProgress(len(left), float(len(left))) as progress:

        def keep(row: Row) -> None:
            store.add(case(task_of(row)), code, row)
            progress.step(1.0)

        drive_all([task for task in left if task[1].act is not Act.STARVE], jobs, keep)
        drive_all([task for task in left if task[1].act is Act.STARVE], 1, keep)


def task_of(row: Row) -> Task:
    """The episode of a row."""
    return row["wire"], FAULTS[row["fault"]], row["number"]


def drive_all(left: list[Task], jobs: int, keep: Callable[[Row], None]) -> None:
    """Drive until every episode of ``left`` has a row.

    Raises InputError after FAILURES drives in a row of one wire without any, and every other error of a drive as it
    is. Rows of drives that ended at the same time are kept.
    """
    interrupted, failures = threading.Event(), dict.fromkeys(WIRES, 0)
    running: dict[Future[list[Row]], list[Task]] = {}
    with ThreadPoolExecutor(jobs) as pool:
        try:
            while left or running:
                while left and len(running) < jobs:
                    batch = next_drive(left)
                    left = [task for task in left if task not in batch]
                    wire, faults = batch[0][0], [task[1:] for task in batch]
                    running[pool.submit(drive_faults, wire, faults, interrupted)] = batch
                ended = wait(running, return_when=FIRST_COMPLETED).done
                rows_of = {drive: [] if drive.exception() else drive.result() for drive in ended}
                for row in chain.from_iterable(rows_of.values()):
                    keep(row | {"jobs": jobs})
                for drive, rows in rows_of.items():
                    batch, error = running.pop(drive), drive.exception()
                    if error is not None and not isinstance(error, InputError):
                        raise error
                    wire = batch[0][0]
                    failures[wire] = 0 if rows else failures[wire] + 1
                    if failures[wire] == FAILURES:
                        why = error or "the car did not come to its speed"
                        raise InputError(
                            f"{wire}: {FAILURES} drives in a row gave no episode; the last one: {why}"
                        )
                    done = [task_of(row) for row in rows]
                    left = [task for task in batch if task not in done] + left
        finally:
            interrupted.set()


def next_drive(left: list[Task]) -> list[Task]:
    """The episodes of the next drive: of the wire and the number that come first, the one that ends it last.

    Those that it survives are spread over the drives of this number.
    """
    wire, _, number = left[0]
    same = [task for task in left if (task[0], task[2]) == (wire, number)]
    ending = [task for task in same if task[1].ends_drive]
    survived = [task for task in same if not task[1].ends_drive]
    share = math.ceil(len(survived) / len(ending)) if ending else SURVIVED
    return [*islice(survived, min(share, SURVIVED)), *ending[:1]]


def table(rows: list[Row]) -> Row:
    """The figures of the episodes: targets, all faults that have to stop the car, then by fault for each wire."""
    found: dict[str, Any] = {
        "drives at a time (p50, max)": _spread([row["jobs"] for row in rows], 50, 100),
        "target": f"p99 ≤ {TARGET_P99_MS:.0f} ms, worst ≤ {TARGET_WORST_MS:.0f} ms from observable to braking",
        "load average (p50, max)": _spread([row["load"] for row in rows], 50, 100),
    }
    groups = {wire: [row for row in rows if row["wire"] == wire] for wire in WIRES}
    stops = {w: [row for row in of_one if FAULTS[row["fault"]].stops] for w, of_one in groups.items()}
    others = {w: [row for row in of_one if not FAULTS[row["fault"]].stops] for w, of_one in groups.items()}
    found["all"] = {
        f"{wire}: {what}": figures(of_one)
        for what, by_wire in (("have to stop", stops), ("have to drive on", others))
        for wire, of_one in by_wire.items()
        if of_one
    }
    for wire, of_one in groups.items():
        names = [name for name in FAULTS if any(row["fault"] == name for row in of_one)]
        found |= (
            {wire: {name: figures([r for r in of_one if r["fault"] == name]) for name in names}}
            if names
            else {}
        )
    return found


def figures(rows: list[Row]) -> Row:
    """The figures of some episodes; reaction times are those of the cars that braked."""
    reactions_ms = [row["reaction_ms"] for row in rows if row["reaction_ms"] is not None]
    p50, p99, worst = _spread(reactions_ms, 50, 99, 100)
    return {
        "count": len(rows),
        "braked": sum(row["braked_ms"] is not None for row in rows),
        "p50 [ms]": p50,
        "p99 [ms]": p99,
        "worst [ms]": worst,
        "stood": sum(row["stood_s"] is not None for row in rows),
        "in lane [%]": round(100 * sum(row["departures"] == 0 for row in rows) / len(rows), 1),
        "hung": sum(row["hung"] for row in rows),
        "orphans": sum(len(row["orphans"]) for row in rows),
        "recordings not readable": sum(row["recording"] not in ("complete", "cut short") for row in rows),
        "drove on": _drove_on(rows),
    }


def _drove_on(rows: list[Row]) -> str:
    """How often the car drove on once the cause was gone: by itself, after a new start, not at all."""
    counts = {
        how: sum(row["resumed"] == how for row in rows) for how in (KEPT, BY_ITSELF, RENEWED, NOT_AT_ALL)
    }
    return ", ".join(f"{how} {count}" for how, count in counts.items() if count) or "drive ends"


def _spread(values: list[float], *percents: float) -> list[float | None]:
    """Percentiles, in tenths; None without values."""
    return [round(float(np.percentile(values, percent)), 1) if values else None for percent in percents]
