"""Recorder process: every topic of the drive into one MCAP file.

A recording never touches the drive. A disk that is full or refuses to be written is reported once, as the health of
this process; the process then runs on without writing.
"""

import itertools
from pathlib import Path

from trepid.bus import Stream
from trepid.config import InputError
from trepid.messages import Diagnostic, Health
from trepid.processes.process import Process, process
from trepid.processes.settings import LAUNCHER
from trepid.recording.writer import BEGAN, BusRecorder
from trepid.topics import DIAGNOSTICS

PERIOD_S = 0.05  # between two writes; much shorter than the ring of the tap lasts


def run(me: Process) -> None:
    """Record until the process is to stop. Options: ``record``, the file; ``attach``, files to keep in it."""
    path = free_path(Path(me.options["record"]))
    heard = me.bus.stream(DIAGNOSTICS)
    try:
        recorder = BusRecorder(path, me.bus, [Path(file) for file in me.options.get("attach", [])])
    except InputError as error:
        me.ready()
        idle(me, str(error))
        return
    try:
        with recorder:
            me.ready()
            write(me, recorder, heard)
    except InputError as error:
        idle(me, f"the recording ends here: {error}")


def write(me: Process, recorder: BusRecorder, heard: Stream[Diagnostic]) -> None:
    """Write the messages of the bus until the process is to stop. Raises InputError when the disk refuses them."""
    begun = False
    while me.running():
        me.bus.wait(timeout_s=PERIOD_S)
        recorder.write()
        for beat, _ in heard.drain():
            began_ns = dict(beat.values).get(BEGAN)
            if not begun and beat.process == LAUNCHER and began_ns is not None:
                recorder.began_ns(int(began_ns))
                begun = True
        me.stepped()


def idle(me: Process, problem: str) -> None:
    """Report ``problem`` and wait for the end of the drive."""
    while me.running():
        me.alive(Health.ERROR, problem)
        me.bus.wait(timeout_s=0.2)


def free_path(path: Path) -> Path:
    """``path``, or after a restart of this process the first of ``path-2``, ``path-3``, … that does not exist."""
    names = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(name for name in itertools.chain([path], names) if not name.exists())


if __name__ == "__main__":
    with process() as me:
        run(me)
