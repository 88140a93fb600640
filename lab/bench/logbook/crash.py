"""Recordings of a process that is killed: the share of what it had written that is readable.

A process writes the messages of a drive as fast as it can, with the code of the recorder, and counts them in shared
memory. After a random time it gets SIGKILL. What the recorder had been given and the file does not hold is the
loss; it is at most the chunk in memory, so that its share falls with the length of the drive.
"""

import multiprocessing
import signal
import time
from multiprocessing.sharedctypes import SynchronizedArray
from pathlib import Path
from typing import Any

import numpy as np

from lab.bench.logbook.drives import endless
from trepid.config import InputError
from trepid.recording.reader import read_head, read_recording, times_of
from trepid.recording.scan import HEAD, MAGIC
from trepid.recording.writer import Recording

SOONEST_S, LATEST_S = 1.0, 4.0  # after its first message the process is killed
SHORTEST = 0.05  # share of a recording that a cut leaves at least
PATIENCE_S = 60.0  # for its first message


def kill_writers(drive: Path, folder: Path, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Figures of ``count`` processes that are killed while they write the messages of ``drive`` again and again.

    Of a recording that is not readable all messages are lost; the lengths are those of the others.
    """
    shares, losses_s, sizes, lengths_s, unreadable = [], [], [], [], 0
    for number in range(count):
        path = folder / f"killed-{number}.mcap"
        given, last_s = _killed_while_writing(drive, path, float(rng.uniform(SOONEST_S, LATEST_S)))
        times_s = _readable(path)
        unreadable += times_s is None
        shares.append(0.0 if times_s is None else 100.0 * len(times_s) / given)
        sizes.append(0.0 if times_s is None else 100.0 * readable_bytes(path) / path.stat().st_size)
        if times_s is not None:
            losses_s.append(last_s - max(times_s))
            lengths_s.append(last_s - min(times_s))
        path.unlink()
    return {
        "recordings": count,
        "not readable": unreadable,
        "length of the drive, median [s]": round(float(np.median(lengths_s)), 1) if lengths_s else None,
        "bytes of the file readable, least [%]": round(min(sizes), 3),
        "messages readable of those written, mean [%]": round(float(np.mean(shares)), 3),
        "messages readable of those written, least [%]": round(min(shares), 3),
        "end of the drive that is lost, mean [s]": round(float(np.mean(losses_s)), 3) if losses_s else None,
        "end of the drive that is lost, most [s]": round(max(losses_s), 3) if losses_s else None,
    }


def cut(path: Path, folder: Path, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Figures of ``count`` copies of a recording that end at a random byte, as after a loss of power."""
    data, shares, unreadable = path.read_bytes(), [], 0
    short = folder / "cut.mcap"
    for length in rng.uniform(SHORTEST * len(data), len(data), count).astype(int).tolist():
        short.write_bytes(data[:length])
        readable = _readable(short) is not None
        unreadable += not readable
        shares.append(100.0 * readable_bytes(short) / length if readable else 0.0)
    short.unlink()
    return {
        "recordings": count,
        "size [MB]": round(len(data) / 1e6, 1),
        "not readable": unreadable,
        "bytes readable, mean [%]": round(float(np.mean(shares)), 3),
        "bytes readable, least [%]": round(min(shares), 3),
    }


def _readable(path: Path) -> list[float] | None:
    """Times of arrival [s] of the messages; None where the recording, its messages or its files cannot be read."""
    try:
        times_s = [at_s for found in times_of(path).values() for at_s in found]
        files = read_head(path).files
    except InputError:
        return None
    return times_s if times_s and files else None


def readable_bytes(path: Path) -> int:
    """Length of the file up to the end of its last whole record."""
    data = path.read_bytes()
    place = len(MAGIC)
    while place + HEAD.size <= len(data):
        _, length = HEAD.unpack_from(data, place)
        if place + HEAD.size + length > len(data):
            break
        place += HEAD.size + length
    return place


def _killed_while_writing(drive: Path, path: Path, after_s: float) -> tuple[int, float]:
    """Number of messages that the killed process had written, and the time of the last one [s]."""
    spawn = multiprocessing.get_context("spawn")
    written = spawn.Array("d", 2)  # number and time of the last message
    process = spawn.Process(target=_write, args=(drive, path, written), daemon=True)
    process.start()
    until_s = time.monotonic() + PATIENCE_S
    while written[0] == 0.0 and process.is_alive() and time.monotonic() < until_s:
        time.sleep(0.01)
    time.sleep(after_s)
    process.kill()
    process.join()
    if process.exitcode != -signal.SIGKILL or written[0] == 0.0:
        raise RuntimeError(f"the writing process ended with exit code {process.exitcode}")
    return int(written[0]), written[1]


def _write(drive: Path, path: Path, written: "SynchronizedArray[float]") -> None:
    """Write the messages of ``drive`` again and again, and note each one in ``written`` after it."""
    count, values = 0, written.get_obj()
    held = read_recording(drive)
    with Recording(path, held.files, held.notes) as recording:
        for key, data, at_s in endless(drive):
            recording.add(key, data, at_s=at_s)
            count += 1
            values[1] = at_s
            values[0] = count
