"""One real ``trepid drive`` as the program that is harmed: its start, its events, its end.

The drive records to a disk of its own, a tmpfs in a mount namespace that ends with it, so that the disk can be full
without harm to the system. Needs ``unshare`` of util-linux and, without root, user namespaces.
"""

import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lab.bench.live.faults.catalogue import LAUNCHER
from lab.bench.live.faults.course import FIRST, write_car
from lab.bench.live.faults.episode import STANDING_MPS, Events, Place
from lab.bench.live.faults.inside import APPLIED, FRAME_MARK, MARKS, Order
from lab.bench.live.program import DriveProgram, kill
from trepid.bus import Bus, Tap, open_bus
from trepid.clock import epoch_clock
from trepid.config import InputError
from trepid.messages import Command, Diagnostic, SimTruth
from trepid.processes.launch import set_niceness
from trepid.processes.process import STOP_S
from trepid.recording.reader import read_recording
from trepid.recording.writer import BEGAN
from trepid.topics import CAMERA_IMAGE, DIAGNOSTICS, SIM_TRUTH, VEHICLE_STATE
from trepid.wire import from_cdr

DISK_MB = 64
END_S = 20.0  # from the request, or from the last fault, to the end of the drive
GONE_S = 2.5  # from the end of the launcher to the end of all processes
POLL_S = 0.02
HEARD = (
    *("controller/command", "supervisor/decision", "perception/**", "vehicle/state", "sim/truth"),
    *("diagnostics", "bench/**"),
)
IN_NAMESPACE = 'mount -t tmpfs -o size={size}m trepid "$0" && exec "$@"'


class DriveEnded(Exception):
    """The drive has ended."""


class BenchInterrupted(Exception):
    """The benchmark is to end before the drive does."""


def command_in_namespace(disk: Path, command: list[str]) -> list[str]:
    """``command`` with a small file system of its own at ``disk``."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    script = IN_NAMESPACE.format(size=DISK_MB)
    return ["unshare", *user, "--mount", "sh", "-c", script, str(disk), *command]


class FaultDrive(DriveProgram):
    """A drive on the wire ``wire`` in ``folder``. Use :func:`driving`."""

    def __init__(self, folder: Path, wire: str, interrupted: threading.Event) -> None:
        self._interrupted = interrupted
        self.wire, self._folder, self._disk = wire, folder, folder / "disk"
        self._disk.mkdir(parents=True)
        words = ["--car", str(write_car(folder, wire)), "--record", str(self._disk / "drive.mcap")]
        super().__init__(folder, words, wrapped=lambda command: command_in_namespace(self._disk, command))
        self.events = Events()
        self._disk_fd: int | None = None
        self._renewals = 0
        self.killed_launcher = False
        self.began = False
        """The launcher has heard every process; before, the end of one is a failed start."""

    def listen(self, bus: Bus) -> None:
        """Take the events of the drive from ``bus`` on, and hold its disk."""
        self._disk_fd = os.open(f"/proc/{self.popen.pid}/root{self._disk}", os.O_RDONLY | os.O_DIRECTORY)
        self._tap: Tap = bus.tap(*HEARD)
        self.now_s = epoch_clock(self.running.clock_offset_ns)

    def prefer(self) -> None:
        """Give all threads of the drive the niceness FIRST, but for processes with a niceness of their own."""
        if not FIRST:
            return
        for pid in (self.popen.pid, *self.pids().values()):
            with suppress(ProcessLookupError):
                if os.getpriority(os.PRIO_PROCESS, pid):
                    continue
                for task in Path(f"/proc/{pid}/task").glob("*"):
                    os.setpriority(os.PRIO_PROCESS, int(task.name), FIRST)
                set_niceness(pid, FIRST)

    def forget(self) -> None:
        """Drop the events so far, but for the last place."""
        self.events = Events(places=self.events.places[-1:])

    def poll(self) -> None:
        """Take what was published meanwhile. Raises Ended, Interrupted."""
        if self._interrupted.is_set():
            raise BenchInterrupted
        time.sleep(POLL_S)
        events = self.events
        for key, data, t_s in self._tap.drain():
            if key == APPLIED.key:
                events.applied.append((t_s, from_cdr(data, Command).accel_mps2))
            elif key == SIM_TRUTH.key:
                truth = from_cdr(data, SimTruth)
                events.places.append(Place(t_s, truth.speed_mps or 0.0, truth.departures))
            elif key == MARKS:
                text = data.decode()
                events.marks_s[text].append(t_s)
                if text == FRAME_MARK:
                    events.published_s[CAMERA_IMAGE.key].append(t_s)
            elif key == DIAGNOSTICS.key:
                beat = from_cdr(data, Diagnostic)
                self.began = self.began or (beat.process == LAUNCHER and BEGAN in dict(beat.values))
            else:
                events.published_s[key].append(t_s)
        if self.popen.poll() is not None:
            raise DriveEnded

    def pid(self, name: str) -> int:
        """The process ``name``, or the launcher. Raises Ended when it does not run."""
        if name == LAUNCHER:
            return self.popen.pid
        found = self.pids()
        if name not in found:
            raise DriveEnded
        return found[name]

    def order(self, name: str, order: Order) -> None:
        """Give a process an order (:mod:`lab.bench.live.faults.inside`)."""
        file = self._folder / "control" / f"{name}.json"
        new = file.with_suffix(".new")
        new.write_text(order.model_dump_json(), encoding="utf-8")
        new.rename(file)
        os.kill(self.pid(name), signal.SIGUSR1)

    def renew_supervisor(self) -> None:
        """Let the supervisor start anew, as in a new drive: it may drive again after a final stop."""
        self._renewals += 1
        self.order("supervisor", Order(renewals=self._renewals))

    @property
    def disk(self) -> Path:
        """The file system of the recording, also after the end of the drive."""
        return Path(f"/proc/self/fd/{self._disk_fd}")

    def fill_disk(self) -> None:
        """Leave no free byte."""
        with (self.disk / "ballast").open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(2**16))

    def free_disk(self) -> None:
        """Undo :meth:`fill_disk`."""
        (self.disk / "ballast").unlink(missing_ok=True)

    def ending(self) -> dict[str, Any]:
        """The end of the drive: whether it hung, processes that were left, and the state of the recording.

        Call it after a fault that ends the drive, or after :meth:`interrupt`.
        """
        began_s = time.monotonic()
        with suppress(DriveEnded):
            while time.monotonic() - began_s < END_S:
                self.poll()
        hung = self.popen.poll() is None
        if hung:
            self.popen.kill()
        self.popen.wait()
        left = self._left()
        kill(left.values())
        return {
            "hung": hung,
            "orphans": sorted(left),
            "exit_code": self.popen.returncode,
            "recording": recording_state(self.disk),
        }

    def _left(self) -> Mapping[str, int]:
        """Processes that run GONE_S after the launcher; after its kill they may stop the car before."""
        until_s = time.monotonic() + GONE_S + (STOP_S if self.killed_launcher else 0.0)
        while (left := self.pids()) and time.monotonic() < until_s:
            with suppress(DriveEnded):
                self.poll()
        return left

    @property
    def stands(self) -> bool:
        """The car stands now."""
        return bool(self.events.places) and self.events.places[-1].speed_mps < STANDING_MPS

    def close(self) -> None:
        """Kill whatever still runs, and let go of the disk."""
        super().close()
        if self._disk_fd is not None:
            os.close(self._disk_fd)


def recording_state(folder: Path) -> str:
    """``complete``, ``cut short`` (readable up to its end), or what makes a recording in ``folder`` unreadable."""
    files = sorted(folder.glob("*.mcap"))
    if not files:
        return "none"
    complete = True
    for file in files:
        try:
            recorded = read_recording(file, VEHICLE_STATE.key)
        except InputError as error:
            return str(error).rpartition("/")[2]
        complete = complete and recorded.complete
    return "complete" if complete else "cut short"


@contextmanager
def driving(folder: Path, wire: str, interrupted: threading.Event) -> Iterator[FaultDrive]:
    """A drive that has started, and its events; everything of it ends with the body, or once ``interrupted``."""
    drive = FaultDrive(folder, wire, interrupted)
    try:
        running = drive.running
        clock = epoch_clock(running.clock_offset_ns)
        with open_bus(running.vehicle_name, clock, connect=running.endpoint) as bus:
            drive.listen(bus)
            yield drive
    finally:
        drive.close()
