"""Recordings for the benchmark of the logbook: random lock-step runs, parts of them, and a long one."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.faults import BlackFrames, FrozenCamera
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenario
from trepid.clock import NANO, seconds
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording

STAMP = struct.Struct(
    "<iI"
)  # seconds and nanoseconds in the header of a message, after 4 bytes of encapsulation
ENCAPSULATION = 4
OF_IMAGES = (BlackFrames, FrozenCamera)  # faults that a drive without images cannot have
SHORTEST_S, LONGEST_S = 4.0, 15.0
KINDS = ("whole", "part", "cut")
"""A whole recording, one that begins in the middle of a drive, and one that was cut short at any byte."""


def random_recordings(folder: Path, count: int, rng: np.random.Generator) -> Iterator[tuple[str, Path]]:
    """``count`` recordings of random scenarios with the true lane, each with its kind."""
    names = [
        scenario.name
        for scenario in list_scenarios()
        if not any(isinstance(fault, OF_IMAGES) for fault in scenario.faults)
    ]
    for number in range(count):
        changes = {"sight": "truth", "duration_s": f"{rng.uniform(SHORTEST_S, LONGEST_S):.1f}"}
        scenario = load_scenario(str(rng.choice(names)), changes)
        path = record_run(scenario, folder / f"{number}.mcap", seed=int(rng.integers(1000)))
        kind = KINDS[number % len(KINDS)]
        yield kind, _as(kind, path, rng)


def record_run(scenario: Scenario, path: Path, *, seed: int, raw_images: bool = False) -> Path:
    """The recording of a lock-step run."""
    with recording(path, scenario, raw_images=raw_images) as witness:
        run(scenario, seed=seed, witness=witness)
    return path


def _as(kind: str, path: Path, rng: np.random.Generator) -> Path:
    """``path`` as a recording of ``kind``; of a cut one at least the first half stays."""
    other = path.with_stem(f"{path.stem}-{kind}")
    if kind == "cut":
        data = path.read_bytes()
        other.write_bytes(data[: int(rng.uniform(0.5, 1.0) * len(data))])
        return other
    if kind == "part":
        held = read_recording(path)
        from_s = rng.uniform(held.first_s, (held.first_s + held.last_s) / 2)
        with Recording(other, held.files, held.notes) as file:
            for log_ns, key, data in in_order(path):
                if seconds(log_ns) >= from_s:
                    file.add(key, data, at_s=seconds(log_ns))
        return other
    return path


def prolong(path: Path, out: Path, duration_s: float) -> Path:
    """A recording of ``duration_s`` that repeats the messages of ``path`` with later and later stamps."""
    held = read_recording(path)
    with Recording(out, held.files, held.notes) as file:
        for key, data, at_s in endless(path):
            if at_s > held.first_s + duration_s:
                break
            file.add(key, data, at_s=at_s)
    return out


def endless(path: Path) -> Iterator[tuple[str, bytes, float]]:
    """Key, bytes and time of the messages of ``path`` over and over, each time with later stamps."""
    rows = [(key, data, log_ns) for log_ns, key, data in in_order(path)]
    span_ns = rows[-1][2] - rows[0][2] + NANO // 100
    later_ns = 0
    while True:
        for key, data, log_ns in rows:
            yield key, _restamp(data, later_ns), seconds(log_ns + later_ns)
        later_ns += span_ns


def _restamp(data: bytes, later_ns: int) -> bytes:
    """The bytes of a message with a later stamp; a message without a stamp stays without one."""
    sec, nanosec = STAMP.unpack_from(data, ENCAPSULATION)
    if sec == nanosec == 0:
        return data
    sec, nanosec = divmod(sec * NANO + nanosec + later_ns, NANO)
    return data[:ENCAPSULATION] + STAMP.pack(sec, nanosec) + data[ENCAPSULATION + STAMP.size :]
