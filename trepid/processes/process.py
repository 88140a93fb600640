"""What every Trepid process shares: its bus, its clock, when to stop, and its heartbeat.

A process is started by `trepid.processes.launch` as ``python -m <module> '<Assignment as JSON>'`` with a pipe as
standard input. It stops on SIGTERM, and also when that pipe closes: then the launcher is gone, however it died.
"""

import ctypes
import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from pydantic import Field, ValidationError

from trepid.bus import Bus, open_bus
from trepid.clock import epoch_clock
from trepid.config import Settings
from trepid.messages import Diagnostic, Health
from trepid.topics import DIAGNOSTICS

Values = tuple[tuple[str, str], ...]

HEARTBEAT_PERIOD_S = 1.0
READY = "ready"
PR_SET_PDEATHSIG = 1  # linux/prctl.h
EXIT_GRACE_S = 1.0  # a process that is stuck when its launcher dies is ended after this long


class Assignment(Settings):
    """What the launcher tells a process."""

    name: str
    vehicle_name: str
    connect: str  # Zenoh endpoint of the launcher
    clock_offset_ns: int
    options: dict[str, Any] = Field(default_factory=dict)


class Process:
    """One running Trepid process."""

    def __init__(self, assignment: Assignment, bus: Bus, stop: threading.Event) -> None:
        self.name = assignment.name
        self.options = assignment.options
        self.bus = bus
        self.now_s = epoch_clock(assignment.clock_offset_ns)
        self._stop = stop
        self._send = bus.publisher(DIAGNOSTICS)
        self._further: Callable[[], Values] = tuple
        self._steps = 0
        self._said = (Health.OK, "")
        self._beat_s = time.monotonic()
        self._beat_cpu_s = time.process_time()

    def running(self) -> bool:
        """False once the process shall end."""
        return not self._stop.is_set()

    def ready(self, *, values: Callable[[], Values] = tuple) -> None:
        """Say that everything is built and the first step may come; the launcher waits for it.

        ``values`` is asked at every heartbeat for further values to go with it.
        """
        self._further = values
        self.beat(Health.OK, READY)

    def stepped(self, health: Health = Health.OK, message: str = "") -> None:
        """Count one step; publish the heartbeat once a second and at every change."""
        self._steps += 1
        self.alive(health, message)

    def alive(self, health: Health = Health.OK, message: str = "") -> None:
        """Publish the heartbeat if it is due or says something new."""
        if (health, message) != self._said or time.monotonic() - self._beat_s >= HEARTBEAT_PERIOD_S:
            self.beat(health, message)

    def beat(self, health: Health, message: str) -> None:
        """Publish the heartbeat: health, steps per second and share of a core since the last one."""
        wall_s = max(time.monotonic() - self._beat_s, 1e-3)
        cpu_s = time.process_time() - self._beat_cpu_s
        values = (
            ("pid", str(os.getpid())),
            ("rate_hz", f"{self._steps / wall_s:.1f}"),
            ("cpu_percent", f"{100 * cpu_s / wall_s:.1f}"),
            *self._further(),
        )
        self._send(
            Diagnostic(t_s=self.now_s(), process=self.name, health=health, message=message, values=values)
        )
        self._said = (health, message)
        self._steps = 0
        self._beat_s += wall_s
        self._beat_cpu_s += cpu_s


class Ticker:
    """Steps at a fixed rate on an absolute schedule: late steps are skipped, never made up for."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1 / rate_hz
        self._next_s = time.monotonic()

    def remaining_s(self) -> float:
        """Time until the next step is due; 0 when it is due now."""
        return max(0.0, self._next_s - time.monotonic())

    def due(self) -> bool:
        """True when a step is due; the next one is then one period on."""
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        missed = int((now_s - self._next_s) / self._period_s)
        self._next_s += (missed + 1) * self._period_s
        return True

    def sleep(self) -> None:
        """Sleep until the next step is due."""
        time.sleep(self.remaining_s())


@contextmanager
def process() -> Iterator[Process]:
    """This process as the launcher assigned it on the command line; the bus closes on leaving."""
    try:
        assignment = Assignment.model_validate_json(sys.argv[1])
    except (IndexError, ValidationError):
        sys.exit(f"{sys.argv[0]}: is started by `trepid drive`, not by hand")
    faulthandler.enable()  # a crash, or an abort by the launcher, leaves a stack in the log
    _go_on_when_the_launcher_dies()
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the launcher, which ends its processes
    threading.Thread(target=_stop_with_launcher, args=(stop,), daemon=True).start()
    clock = epoch_clock(assignment.clock_offset_ns)
    with open_bus(assignment.vehicle_name, clock, connect=assignment.connect) as bus:
        yield Process(assignment, bus, stop)


def _go_on_when_the_launcher_dies() -> None:
    """On Linux: SIGCONT when the parent dies, so that a paused process wakes up and finds its pipe closed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGCONT)


def _stop_with_launcher(stop: threading.Event) -> None:
    """Wait for the pipe from the launcher to close, then stop; do not wait for a stuck main thread."""
    sys.stdin.buffer.read()
    stop.set()
    time.sleep(EXIT_GRACE_S)
    os._exit(1)
