"""``trepid bench rc``: the RC car on a small computer, 20 frames a second, alone and beside other work.

The estimators of the RC car have to answer every frame although other programs take their share of the processor:
the row has the time in which the supervisor missed an estimator, the latencies, the share of a core of each
process, and the processor time of each estimator for a frame.
"""

import os
import tempfile
from pathlib import Path
from typing import Any

from cockpit.car.init import Like, write_car
from lab.bench.live.agreement import busy
from lab.bench.live.program import DriveProgram
from trepid.causes import Cause

LOADS = (0, 4)
RATE_HZ = 20.0
DRIVE_S = 30.0
Row = dict[str, Any]


def bench_rc() -> Row:
    """A row for each load, and the share of a core of each process [%]."""
    with tempfile.TemporaryDirectory(prefix="trepid-rc-") as folder:
        car = Path(folder) / "car"
        write_car(car, Like.RC_CAR)
        drives = {f"load {load}": _drive(car, Path(folder), load) for load in LOADS}
    return {
        "drives": {name: drive_row(row, before) for name, (row, before) in drives.items()},
        "share of a core [%]": {name: shares(row) for name, (row, _) in drives.items()},
    }


def _drive(car: Path, folder: Path, load: int) -> tuple[Row, float]:
    """The row of a drive beside ``load`` processes that compute, and the load average before."""
    words = [*("--car", str(car)), *("--scenario", "circuit"), *("--set", f"camera.rate_hz={RATE_HZ:g}")]
    words += [*("--set", f"duration_s={DRIVE_S:g}"), *("--set", "expect={}"), "--no-page"]
    before = os.getloadavg()[0]
    with busy(load):
        program = DriveProgram(folder, words)
        try:
            return program.row(), before
        finally:
            program.close()


def drive_row(row: Row, before: float) -> Row:
    """The columns of one drive from its row; ``before``: load average before it."""
    command_ms = row["latency_ms"]["frame_to_command"] or {"p50": None, "p99": None}
    return {
        "status": row["status"],
        "lost estimator [s]": round(row["causes"].get(Cause.LOST_ESTIMATOR.value, 0.0), 2),
        "engaged [%]": row["engaged_percent"],
        "distance [m]": round(row["distance_m"], 1),
        "frame to command, p50 [ms]": command_ms["p50"],
        "frame to command, p99 [ms]": command_ms["p99"],
        **{f"processor time of {name} [ms/frame]": ms for name, ms in frame_times(row).items()},
        "load average before": round(before, 1),
    }


def frame_times(row: Row) -> dict[str, float | None]:
    """Processor time of each estimator for a frame [ms]; None where it answered none."""
    names = (stage.removeprefix("frame_to_") for stage in row["latency_ms"])
    processes = {name: row["processes"][name] for name in names if name in row["processes"]}
    return {
        name: round(10.0 * one["cpu_percent"] / one["rate_hz"], 1) if one["rate_hz"] else None
        for name, one in processes.items()
    }


def shares(row: Row) -> dict[str, float | None]:
    """Share of a core of each process [%]."""
    return {name: one["cpu_percent"] for name, one in row["processes"].items()}
