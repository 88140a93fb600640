"""``trepid bench soak``: a long recorded drive in real time, and what its processes use over it.

Laps of the circuit with every process and the recorder. Memory, open files and threads of each process are sampled.
Growth is that of the median of the last quarter over that of the second: the first holds the start. The simulated
drive keeps the trace of its evaluation, so that the memory of the launcher grows with the duration; a drive of a
real car keeps none.

The recorder loses nothing when, between two messages of a topic that the benchmark hears, the file holds as many
messages as their numbers count.
"""

import statistics
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lab.bench.live.program import DriveProgram
from trepid.bus import Bus, Latest, open_bus
from trepid.clock import Stamp, epoch_clock
from trepid.config import InputError
from trepid.recording.reader import times_of
from trepid.topics import (
    CAMERA_COMPRESSED,
    COMMAND,
    DECISION,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    SIM_TRUTH,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)

DURATION_S = 1800.0
SAMPLES = 180  # over the drive
BEGIN_S = 60.0  # greatest time to the first messages
SETTLE_S = 2.0
LAST_S = 3.0  # before the end: the last messages that are counted, when the recorder still writes
TOPICS: tuple[Topic[Any], ...] = (
    *map(estimate_topic, ("cv", "cnn")),
    *(IMAGE_STATISTICS, LEAD_VEHICLE, DECISION, COMMAND, VEHICLE_STATE, SIM_TRUTH, CAMERA_COMPRESSED),
)
"""Recorded topics with one publisher each."""
Row = dict[str, Any]


class Usage(NamedTuple):
    """What one process uses."""

    memory_mb: float  # resident
    files: int
    threads: int


def bench_soak(duration: float = DURATION_S) -> Row:
    """Scores of the drive, messages lost by the recorder, and by process memory, files, threads and growth."""
    with tempfile.TemporaryDirectory(prefix="trepid-soak-") as folder:
        recording = Path(folder) / "soak.mcap"
        words = ["--scenario", "circuit", "--record", str(recording), "--set", f"duration_s={duration}"]
        words += ["--set", "distance_m=1000000", "--set", "expect={}"]
        program = DriveProgram(Path(folder), words)
        try:
            first, last, samples = _watch(program, duration)
            row = program.row()
            left = program.pids()
        finally:
            program.close()
        recorder = count_recorded(recording, first, last)
        size_mb = recording.stat().st_size / 2**20
    return {
        "status": "; ".join(row["reasons"]) or row["status"],
        **{name: row[name] for name in ("duration_s", "distance_m", "departures", "interventions")},
        "restarts": sum(process["restarts"] for process in row["processes"].values()),
        "malformed messages": sum(process["malformed"] for process in row["processes"].values()),
        "processes left": len(left),
        "recording [MB]": round(size_mb, 1),
        "messages lost by the recorder": sum(topic["lost"] or 0 for topic in recorder.values()),
        "processes": {name: usage(found) for name, found in samples.items()},
        "recorder": recorder,
    }


def _watch(
    program: DriveProgram, duration_s: float
) -> tuple[dict[str, Stamp], dict[str, Stamp], dict[str, list[Usage]]]:
    """First and last message of each topic, and samples of each process, over the drive."""
    running = program.running
    clock = epoch_clock(running.clock_offset_ns)
    samples: dict[str, list[Usage]] = {}
    with open_bus(running.vehicle_name, clock, connect=running.endpoint) as bus:
        heard = [bus.latest(topic, wakes=False) for topic in TOPICS]
        first = _first(program, bus, heard)
        pids = {"launcher": program.popen.pid, **program.pids()}
        began_s = time.monotonic()
        while (
            elapsed_s := time.monotonic() - began_s
        ) < duration_s - LAST_S and program.popen.poll() is None:
            for name, pid in pids.items():
                found = sample_usage(pid)
                if found is not None:
                    samples.setdefault(name, []).append(found)
            bus.wait(min(duration_s / SAMPLES, max(duration_s - LAST_S - elapsed_s, 0.1)))
        for latest in heard:
            latest.refresh()
        return first, {latest.topic.key: latest.stamp for latest in heard if latest.message}, samples


def _first(program: DriveProgram, bus: Bus, heard: Iterable[Latest[Any]]) -> dict[str, Stamp]:
    """A message of each topic once the car drives. Raises InputError when it does not begin."""
    until_s = time.monotonic() + BEGIN_S
    while time.monotonic() < until_s and program.popen.poll() is None:
        bus.wait(0.2)
        for latest in heard:
            latest.take()
        if all(latest.message for latest in heard):
            bus.wait(SETTLE_S)  # Zenoh connects this session to all processes
            for latest in heard:
                latest.take()
            return {latest.topic.key: latest.stamp for latest in heard}
    raise InputError(f"the drive did not begin: {program.errors()}")


def sample_usage(pid: int) -> Usage | None:
    """What the process uses now; None when it has ended."""
    folder = Path(f"/proc/{pid}")
    try:
        lines = dict(
            line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line
        )
        files = len(list((folder / "fd").iterdir()))
    except (FileNotFoundError, ProcessLookupError):
        return None
    if "VmRSS" not in lines:  # a zombie
        return None
    return Usage(float(lines["VmRSS"].split()[0]) / 1024, files, int(lines["Threads"]))


def usage(samples: list[Usage]) -> Row:
    """Medians of the second and of the last quarter of the samples, and their difference."""
    quarter = max(len(samples) // 4, 1)
    early, late = samples[quarter : 2 * quarter] or samples[-1:], samples[-quarter:]

    def median(part: list[Usage], field: int) -> float:
        return statistics.median(one[field] for one in part)

    return {
        "memory [MB]": round(median(late, 0), 1),
        "growth [MB]": round(median(late, 0) - median(early, 0), 1),
        "files": int(median(late, 1)),
        "growth of files": int(median(late, 1) - median(early, 1)),
        "threads": int(median(late, 2)),
        "growth of threads": int(median(late, 2) - median(early, 2)),
    }


def count_recorded(recording: Path, first: Mapping[str, Stamp], last: Mapping[str, Stamp]) -> dict[str, Row]:
    """By topic: messages from ``first`` to ``last`` by their numbers, and how many of them the file lacks.

    None for a topic whose publisher was started anew.
    """
    times = times_of(recording)
    found: dict[str, Row] = {}
    for key, stamp in sorted(last.items()):
        if stamp.publisher != first[key].publisher:  # started anew, with numbers from 1
            found[key] = {"messages": None, "lost": None}
            continue
        from_s, to_s = first[key].published_s, stamp.published_s
        sent = stamp.sequence - first[key].sequence + 1
        held = sum(from_s <= at_s <= to_s for at_s in times.get(key, ()))
        found[key] = {"messages": sent, "lost": sent - held}
    return found
