"""The common part of all Trepid processes: bus, clock, end, heartbeat.

`trepid.processes.launch` starts a process as ``python -m <module> '<Assignment as JSON>'`` with a pipe as standard
input; a command finds the assignment in the environment variable TREPID_ASSIGNMENT. The process stops on SIGTERM,
and when that pipe closes: for the vehicle process when the launcher has ended, for the others when launcher and
vehicle process have ended, so that the last stop of the car is steered.
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
from trepid.config import BAD_INPUT, InputError, Settings
from trepid.loudness import warn
from trepid.messages import Diagnostic, Health
from trepid.processes.realtime import OPTION, prefer
from trepid.security import session_settings
from trepid.topics import DIAGNOSTICS, VEHICLE_STATE, Topic

Values = tuple[tuple[str, str], ...]

HEARTBEAT_PERIOD_S = 1.0
READY = "ready"
MALFORMED = "malformed "  # beginning of the names of values, followed by the key of a topic
PR_SET_PDEATHSIG = 1  # linux/prctl.h
ASSIGNMENT = "TREPID_ASSIGNMENT"  # environment variable with the assignment of a command
EXIT_GRACE_S = 1.0  # from the close of the pipe to the end of a process whose main thread is stuck
STOP_S = 10.0  # longest time in which the vehicle process brings a moving car to a standstill before it ends


class Assignment(Settings):
    """Parameters that the launcher passes to a process."""

    name: str
    vehicle_name: str
    connect: str  # Zenoh endpoint of the launcher
    clock_offset_ns: int
    publishes: dict[str, tuple[str, ...]] = Field(
        default_factory=dict
    )  # topics of every process of the drive
    options: dict[str, Any] = Field(default_factory=dict)
    restarts: int = 0  # of this process in the drive, with this one


class Process:
    """One running Trepid process."""

    def __init__(self, assignment: Assignment, bus: Bus, stop: threading.Event) -> None:
        self.name = assignment.name
        self.options = assignment.options
        self.restarts = assignment.restarts
        self.bus = bus
        self.now_s = epoch_clock(assignment.clock_offset_ns)
        self._publishers = {key: name for name, keys in assignment.publishes.items() for key in keys}
        self._stop = stop
        self._send = bus.publisher(DIAGNOSTICS)
        self._further: Callable[[], Values] = tuple
        self._steps = 0
        self._refused = ""  # why it has no real-time class
        self._reported = (Health.OK, "")
        self._malformed: dict[str, int] = {}  # counts at the last heartbeat
        self._warned = False  # the last heartbeat reported malformed messages
        self._beat_s = time.monotonic()
        self._beat_cpu_s = time.process_time()

    def has_publisher(self, topic: Topic[Any]) -> bool:
        """Whether a process of this drive publishes ``topic``, by its entry in ``processes.yaml``."""
        return topic.key in self._publishers

    def publisher(self, topic: Topic[Any]) -> str | None:
        """Name of the process of this drive that publishes ``topic``; None without one."""
        return self._publishers.get(topic.key)

    def running(self) -> bool:
        """False after a request to end."""
        return not self._stop.is_set()

    def ready(self, *, values: Callable[[], Values] = tuple, realtime: int | None = None) -> None:
        """Publish that the process is set up; the launcher waits for this heartbeat of every process.

        ``values`` is called at every heartbeat and returns further values to publish with it. The threads of the
        process get the real-time class from here on, with the priority ``realtime``, or else that of its option;
        every heartbeat says why the system refuses it.
        """
        self._further = values
        self.beat(Health.OK, READY)
        self._refused = prefer(self.options.get(OPTION) if realtime is None else realtime)
        if self._refused:
            self.beat(Health.WARN, "")

    def count_step(self, health: Health = Health.OK, message: str = "") -> None:
        """Count one step; publish the heartbeat once a second and at every change."""
        self._steps += 1
        self.alive(health, message)

    def alive(self, health: Health = Health.OK, message: str = "") -> None:
        """Publish the heartbeat if it is due, if health or message changed, or at malformed messages."""
        changed = (health, message) != self._reported
        newly_malformed = not self._warned and self.bus.malformed_counts() != self._malformed
        if changed or newly_malformed or time.monotonic() - self._beat_s >= HEARTBEAT_PERIOD_S:
            self.beat(health, message)

    def beat(self, health: Health, message: str) -> None:
        """Publish the heartbeat: health, steps per second and share of a core since the last one.

        Health is at least WARN when messages read since the last heartbeat were malformed. The values give the
        number of malformed messages so far by topic as ``malformed <key>``.
        """
        self._reported = (health, message)
        malformed = self.bus.malformed_counts()
        new = [key for key, count in malformed.items() if count != self._malformed.get(key)]
        self._malformed, self._warned = malformed, bool(new)
        if new:
            health = Health.WARN if health is Health.OK else health
        malformed_on = f"malformed messages on {', '.join(new)}" if new else ""
        message = "; ".join(filter(None, (message, malformed_on, self._refused)))
        wall_s = max(time.monotonic() - self._beat_s, 1e-3)
        cpu_s = time.process_time() - self._beat_cpu_s
        values = (
            ("pid", str(os.getpid())),
            ("rate_hz", f"{self._steps / wall_s:.1f}"),
            ("cpu_percent", f"{100 * cpu_s / wall_s:.1f}"),
            *((f"{MALFORMED}{key}", str(count)) for key, count in malformed.items()),
            *self._further(),
        )
        now_s = self.now_s()
        self._send(Diagnostic(t_s=now_s, process=self.name, health=health, message=message, values=values))
        self._steps = 0
        self._beat_s += wall_s
        self._beat_cpu_s += cpu_s


class Ticker:
    """Steps at a fixed rate on an absolute schedule; missed steps are skipped."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1 / rate_hz
        self._next_s = time.monotonic()

    def remaining_s(self) -> float:
        """Time until the next step is due; 0 when it is due now."""
        return max(0.0, self._next_s - time.monotonic())

    def due(self) -> bool:
        """True when a step is due; schedules the next step."""
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
    """The process that the assignment on the command line describes; closes the bus on leaving.

    An InputError in the body becomes one line on standard error and exit code 2.
    """
    try:
        assignment = Assignment.model_validate_json(os.environ.get(ASSIGNMENT) or sys.argv[1])
    except (IndexError, ValidationError):
        sys.exit(f"{sys.argv[0]}: is started by `trepid drive`, not by hand")
    faulthandler.enable()  # writes the stack to the log at a crash and at an abort by the launcher
    if sys.platform == "linux":  # a paused process resumes at the end of its parent and reads its closed pipe
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGCONT)
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the launcher handles Ctrl-C and ends its processes
    is_vehicle = VEHICLE_STATE.key in assignment.publishes.get(assignment.name, ())
    grace_s = EXIT_GRACE_S + (STOP_S if is_vehicle else 0.0)
    threading.Thread(target=_stop_with_pipe, args=(stop, grace_s), daemon=True).start()
    clock = epoch_clock(assignment.clock_offset_ns)
    try:
        secured = session_settings(
            assignment.name, publishes=assignment.publishes, connect=assignment.connect
        )
        with open_bus(assignment.vehicle_name, clock, connect=assignment.connect, further=secured) as bus:
            yield Process(assignment, bus, stop)
    except InputError as error:
        warn(*str(error).split())
        sys.exit(BAD_INPUT)


def _stop_with_pipe(stop: threading.Event, grace_s: float) -> None:
    """Stop when the pipe closes; after ``grace_s`` end a stuck main thread too."""
    while os.read(sys.stdin.fileno(), 1):  # sys.stdin.buffer would hold a lock at the end of the interpreter
        pass
    stop.set()
    time.sleep(grace_s)
    os._exit(1)
