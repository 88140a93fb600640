"""Recorder process: every topic of the drive into MCAP files.

With the option ``record`` it records the whole drive into one file. Without it, it records the last minutes
(:mod:`trepid.recording.keeper`), and the record button of the driver input starts a recording, which its next press
ends.

A recording never touches the drive. A disk that is full or refuses to be written is reported once, as the health of
this process; the process then runs on without writing.
"""

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from trepid.bus import Stream
from trepid.config import InputError
from trepid.messages import Diagnostic, Health
from trepid.processes.process import Process, process
from trepid.processes.settings import LAUNCHER
from trepid.recording.keeper import Keeper
from trepid.recording.notes import drive_notes
from trepid.recording.ring import free_path, ring_settings
from trepid.recording.writer import BEGAN, BusRecorder, attach_adopted, attachments
from trepid.topics import DIAGNOSTICS, DRIVER_INPUT

PERIOD_S = 0.05  # between two writes; much shorter than the ring of the tap lasts
NAME = "drive-%Y-%m-%d-%H-%M-%S.mcap"  # of a recording by the button, with the local time of its start
Wanted = Callable[[], bool]
"""True as long as the recording is to go on."""


class RecordingStart:
    """The start of the drive and the files of a recording that begins now, by the heartbeats so far."""

    def __init__(self, beats: Stream[Diagnostic], files: Mapping[str, bytes]) -> None:
        """``files``: as they were when the recorder started."""
        self._beats = beats
        self.files = dict(files)
        """Files to attach, by name; rules that the supervisor has adopted since are among them."""
        self.began_ns: int | None = None
        """Start of the drive; None until the launcher has reported it."""

    def refresh(self) -> None:
        """Take the heartbeats since the last call."""
        for beat, _ in self._beats.drain():
            began_ns = dict(beat.values).get(BEGAN)
            if beat.process == LAUNCHER and began_ns is not None:
                self.began_ns = int(began_ns)
            attach_adopted(self.files, beat)


def run(me: Process) -> None:
    """Record until the process is to stop.

    Options: ``record``, the file; without it ``record_folder``, the folder of the recordings by the button, made at
    the first one; ``ring``, the name of the ring of the last minutes; ``raw_images``, to record them too.
    """
    heard = RecordingStart(me.bus.stream(DIAGNOSTICS), attached_files(me))
    if "record" in me.options:
        record(me, free_path(Path(me.options["record"])), heard, me.running, opened=me.ready)
    else:
        record_by_button(me, heard)


def record_by_button(me: Process, heard: RecordingStart) -> None:
    """Record the last minutes, and while the driver input says so, each time into a file of its own."""
    driver = me.bus.latest(DRIVER_INPUT, wakes=False)
    ring = me.options.get("ring")
    keeper = Keeper(me, ring, ring_settings(), heard.files, notes(me)) if ring else None

    def running() -> bool:
        """Whether the drive goes on; writes the last minutes meanwhile."""
        if keeper is not None:
            keeper.turn()
        return me.running()

    def is_wanted() -> bool:
        newest = driver.refresh()
        return running() and newest is not None and newest.record

    folder = Path(me.options["record_folder"])
    said = f"not recording; the record button starts a recording in {folder}"
    me.ready()
    begun = False
    while running():
        heard.refresh()
        if keeper is not None and not begun and heard.began_ns is not None:
            begun = True
            keeper.began_ns(heard.began_ns)
        if is_wanted():
            path = free_path(folder / datetime.fromtimestamp(me.now_s()).strftime(NAME))
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                idle(me, f"{folder}: cannot be made: {error.strerror}", is_wanted)
                continue
            record(me, path, heard, is_wanted, said=f"recording {path}")
            said = f"not recording; the last recording is {path}"
        troubled = keeper is not None and keeper.problem
        me.count_step(*((Health.ERROR, keeper.problem) if keeper and troubled else (Health.OK, said)))
        me.bus.wait(timeout_s=PERIOD_S)
    if keeper is not None:
        keeper.close()


def record(
    me: Process,
    path: Path,
    heard: RecordingStart,
    wanted: Wanted,
    *,
    said: str = "",
    opened: Callable[[], object] = lambda: None,
) -> None:
    """Record to ``path`` while ``wanted``, with ``said`` in the heartbeat; report why the disk refuses it."""
    try:
        raw_images = bool(me.options.get("raw_images"))
        recorder = BusRecorder(path, me.bus, heard.files, notes(me), raw_images=raw_images)
    except InputError as error:
        opened()
        idle(me, str(error), wanted)
        return
    try:
        with recorder:
            opened()
            write(me, recorder, heard, wanted, said)
    except InputError as error:
        idle(me, f"the recording ends here: {error}", wanted)


def write(me: Process, recorder: BusRecorder, heard: RecordingStart, wanted: Wanted, said: str) -> None:
    """Write the messages of the bus while ``wanted``. Raises InputError when the disk refuses them."""
    begun = False
    while wanted():
        me.bus.wait(timeout_s=PERIOD_S)
        recorder.write()
        heard.refresh()
        if not begun and heard.began_ns is not None:
            recorder.began_ns(heard.began_ns)
            begun = True
        me.count_step(Health.OK, said)


def attached_files(me: Process) -> dict[str, bytes]:
    """The files that a recording of the drive keeps from its beginning. Raises InputError."""
    return attachments(Path(me.options["rules"])) if "rules" in me.options else {}


def notes(me: Process) -> dict[str, str]:
    """What the nodes of the drive were built with, as far as their settings do not state it."""
    scenario, speed_mps = me.options.get("scenario"), me.options.get("cruise_speed_mps")
    return drive_notes(
        what=scenario["name"] if scenario else "",
        estimators=me.options.get("estimators", ()),
        cruise_speed_mps=speed_mps,
        networks=me.options.get("networks"),
    )


def idle(me: Process, problem: str, wanted: Wanted) -> None:
    """Report ``problem`` as long as a recording is ``wanted``."""
    while wanted():
        me.alive(Health.ERROR, problem)
        me.bus.wait(timeout_s=0.2)


if __name__ == "__main__":
    with process() as me:
        run(me)
