"""Start, watch and stop the processes of a drive.

Every child has its own session (Ctrl-C reaches only the launcher) and holds the reading end of a pipe. The pipe
closes when its writers have ended for any reason, and the child then ends itself (:mod:`trepid.processes.process`);
the kernel ends a command with the launcher (:mod:`trepid.processes.foreign`).

The vehicle process ends first, because it brings a moving car to a standstill before: the launcher is the only
writer of its pipe. The pipe of the others has two writers, the launcher and the vehicle process.

The log of a process is the end of what it writes to its standard output and error. It lies in memory, where no full
disk can stop the process that writes or the launcher that starts it again.
"""

import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from trepid.clock import epoch_clock
from trepid.config import BAD_INPUT, ROOT, InputError, car_folder
from trepid.processes.process import ASSIGNMENT, STOP_S, Assignment
from trepid.processes.settings import ProcessSpec, Restart, published_keys, working_folder

KEPT_BYTES = 65_536
LONGEST_BYTES = 4 * KEPT_BYTES


def new_log() -> IO[bytes]:
    """A file for the log of one process, open for appending. Raises OSError."""
    if not hasattr(os, "memfd_create"):
        return tempfile.TemporaryFile("a+b", buffering=0)
    descriptor = os.memfd_create("trepid")
    # The flag belongs to the open file and holds in the process too, which writes on at the end of a shortened log.
    fcntl.fcntl(descriptor, fcntl.F_SETFL, os.O_RDWR | os.O_APPEND)
    return os.fdopen(descriptor, "r+b", buffering=0)


def shorten(log: IO[bytes]) -> None:
    """Keep the last KEPT_BYTES of a log that is longer than LONGEST_BYTES."""
    if os.fstat(log.fileno()).st_size <= LONGEST_BYTES:
        return
    log.seek(-KEPT_BYTES, os.SEEK_END)
    end = log.read(KEPT_BYTES)
    log.truncate(0)
    log.write(end)


ABORT_GRACE_S = 0.3
FRAME = re.compile(r'  File "(.+)", line (\d+)')
WEIGH_PERIOD_S = 0.02
TERM_GRACE_S = 1.2  # SIGTERM to SIGKILL; with the kill this keeps a stop below 2 s


@dataclass(slots=True)
class Child:
    """A started process."""

    spec: ProcessSpec
    popen: subprocess.Popen[bytes]
    log: IO[bytes]
    started_s: float  # on the clock of the drive
    restarts: int = 0
    restart_at_s: float | None = None  # when it is to start again, after its end [monotonic s]
    weighed: bool = False  # its session has the niceness of its entry

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.popen.poll() is None

    def stderr_tail(self, lines: int = 12) -> str:
        """The last lines of the log of the process, joined by `` | ``; of a traceback its error and place."""
        self.log.seek(0)
        written = _without_frames(self.log.read().decode(errors="replace").splitlines())
        kept = [line.strip() for line in written if line.strip() and not line.startswith("Extension modules")]
        return " | ".join(kept[-lines:])


@dataclass(frozen=True, slots=True)
class UnexpectedExit:
    """The end of a child that the launcher did not request."""

    name: str
    pid: int
    returncode: int
    stderr_tail: str

    @property
    def from_bad_input(self) -> bool:
        """True when the process refused its input; it would refuse it again."""
        return self.returncode == BAD_INPUT

    def __str__(self) -> str:
        if self.from_bad_input:
            return f"process {self.name}: {self.stderr_tail}"
        how = f"exited with code {self.returncode}"
        if self.returncode < 0:
            how = f"was killed by {signal.Signals(-self.returncode).name}"
        tail = f": {self.stderr_tail}" if self.stderr_tail else ""
        return f"process {self.name} (pid {self.pid}) {how}{tail}"


class Fleet:
    """The processes of one drive. Use as a context manager, which ends all of them on leaving."""

    def __init__(
        self,
        specs: tuple[ProcessSpec, ...],
        *,
        vehicle_name: str,
        endpoint: str,
        clock_offset_ns: int,
        context: Mapping[str, Any] | None = None,
        started: Callable[[Child], None] = lambda _: None,
    ) -> None:
        """``context`` describes the drive to every process: options that the own ones of a process override.

        ``started`` is called after the start of each process, before that of the next.
        """
        self._session: dict[str, Any] = dict(
            vehicle_name=vehicle_name,
            connect=endpoint,
            clock_offset_ns=clock_offset_ns,
            publishes=published_keys(specs),
        )
        self._now_s = epoch_clock(clock_offset_ns)
        self._specs = specs
        self._context = dict(context or {})
        self._started = started
        self.children: dict[str, Child] = {}
        self._read_end = self._write_end = -1  # of the pipe of all but the vehicle process

    def __enter__(self) -> "Fleet":
        self._read_end, self._write_end = os.pipe()
        try:
            for spec in self._specs:
                self.children[spec.name] = self._start(spec)
                self._started(self.children[spec.name])
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self, spec: ProcessSpec, restarts: int = 0) -> Child:
        """Start the process. Raises InputError when the system refuses it."""
        options = {**self._context, **spec.options}
        assignment = Assignment.model_validate(
            {"name": spec.name, "options": options, "restarts": restarts, **self._session}
        )
        text = assignment.model_dump_json()
        log = new_log()
        started_s = self._now_s()
        try:
            popen = subprocess.Popen(
                _arguments(spec, text),
                cwd=working_folder()
                if spec.command
                else ROOT,  # `-m` then prefers the packages of this checkout
                stdin=subprocess.PIPE if spec.is_vehicle else self._read_end,
                pass_fds=(self._write_end,) if spec.is_vehicle else (),
                stdout=log,
                stderr=log,
                start_new_session=True,
                env=_environment(spec, text),
            )
        except OSError as error:
            log.close()
            raise InputError(f"{_place(spec)}: cannot be started: {error.strerror}") from error
        child = Child(spec, popen, log, started_s, restarts)
        try:
            _schedule(spec, popen.pid)
        except BaseException:
            _end(child, deadline_s=time.monotonic())
            raise
        child.weighed = not spec.nice
        if _weighs_at_once(spec):
            _weigh(child)
        return child

    def weigh(self, begun: Collection[str]) -> None:
        """Set the niceness of the sessions of those processes that have ``begun``: a heartbeat of them has come.

        The start of Python and of its libraries takes seconds of processor time. With the weight of niceness 10 it
        would last half a minute beside other work, and the process would be missing for as long.
        """
        for name, child in self.children.items():
            if name in begun or _weighs_at_once(child.spec):
                _weigh(child)

    def collect_exits(self) -> list[UnexpectedExit]:
        """The children that ended since the last call; starts those again whose restart is due.

        A process is started again as its entry says, at a later call, so that the caller can report its end before;
        and never after it has refused its input.
        """
        exits = []
        for name, child in self.children.items():
            if child.restart_at_s is not None and time.monotonic() >= child.restart_at_s:
                self._start_again(child)
                continue
            if not child.log.closed:
                shorten(child.log)
            returncode = child.popen.poll()
            if returncode is None or child.log.closed:
                continue
            ended = UnexpectedExit(name, child.popen.pid, returncode, child.stderr_tail())
            exits.append(ended)
            _close(child)
            if self._restarts(child, ended):
                child.restart_at_s = time.monotonic() + child.spec.backoff_after_s(child.restarts)
        return exits

    def _start_again(self, child: Child) -> None:
        """Start ``child`` again; what the system refuses is tried once more after the next back-off."""
        restarts, child.restart_at_s = child.restarts + 1, None
        try:
            self.children[child.spec.name] = self._start(child.spec, restarts)
        except (InputError, OSError):
            child.restarts = restarts
            if restarts < child.spec.max_restarts:
                child.restart_at_s = time.monotonic() + child.spec.backoff_after_s(restarts)

    def _restarts(self, child: Child, ended: UnexpectedExit) -> bool:
        return (
            child.spec.restart is Restart.ON_FAILURE
            and ended.returncode != 0
            and not ended.from_bad_input
            and child.restarts < child.spec.max_restarts
        )

    def kill(self, name: str) -> None:
        """End a process that no longer responds; :meth:`collect_exits` then reports it.

        SIGABRT writes the stack of the process to its log (faulthandler); SIGKILL follows after a grace time.
        """
        popen = self.children[name].popen
        popen.send_signal(signal.SIGABRT)
        try:
            popen.wait(ABORT_GRACE_S)
        except subprocess.TimeoutExpired:
            popen.kill()
            popen.wait()

    def pause(self, name: str) -> None:
        """Pause a process (SIGSTOP) to simulate its loss; it resumes and ends itself if the launcher ends."""
        self.children[name].popen.send_signal(signal.SIGSTOP)

    def resume(self, name: str) -> None:
        """Resume a paused process (SIGCONT)."""
        self.children[name].popen.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End every child: SIGTERM, then SIGKILL; first the vehicle process, then the others within 2 s.

        The vehicle process of a moving car ends at standstill, or after STOP_S.
        """
        vehicle = [child for child in self.children.values() if child.spec.is_vehicle]
        _end_all(vehicle, grace_s=TERM_GRACE_S + STOP_S * any(not child.spec.simulates for child in vehicle))
        _end_all(self.children.values(), grace_s=TERM_GRACE_S)
        for end in (self._read_end, self._write_end):
            os.close(end)


def _without_frames(lines: list[str]) -> list[str]:
    """``lines`` with ``error (file:line)`` in place of each Python traceback."""
    kept: list[str] = []
    place = ""
    for line in lines:
        frame = FRAME.match(line)
        if line.startswith("Traceback ("):
            place = "unknown place"
        elif place and frame:
            place = f"{frame[1]}:{frame[2]}"
        elif place and not line.startswith(" "):
            kept.append(f"{line} ({place})" if line else "")
            place = "" if line else place
        elif not place:
            kept.append(line)
    return kept


def _place(spec: ProcessSpec) -> str:
    return f"{spec.place}: process {spec.name}" if spec.place else f"process {spec.name}"


def _arguments(spec: ProcessSpec, assignment: str) -> list[str]:
    """The command line of the process."""
    if spec.command:
        return [sys.executable, "-m", "trepid.processes.foreign", *spec.command]
    if spec.entry_point:
        return [sys.executable, "-m", "trepid.processes.entry", assignment, spec.entry_point]
    return [sys.executable, "-m", spec.module, assignment]


def _environment(spec: ProcessSpec, assignment: str) -> dict[str, str]:
    # One thread per process: many processes share few cores.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    paths = [str(ROOT)] if spec.command else []
    paths += [*filter(None, [os.environ.get("PYTHONPATH")]), *map(str, filter(None, [car_folder()]))]
    if paths:
        environment["PYTHONPATH"] = os.pathsep.join(paths)
    return environment | ({ASSIGNMENT: assignment} if spec.command else {})


def set_niceness(pid: int, nice: int) -> None:
    """Set the niceness of a process with a session of its own, and that of its session.

    Raises PermissionError, ProcessLookupError.
    """
    os.setpriority(os.PRIO_PROCESS, pid, nice)
    while not weigh_session(pid, nice):
        time.sleep(WEIGH_PERIOD_S)


def weigh_session(pid: int, nice: int) -> bool:
    """Set the niceness of the session of ``pid``, by which Linux weighs sessions, where it does and permits it.

    False: to be tried again, because without CAP_SYS_ADMIN Linux accepts one change in 0.1 s on the whole machine.
    """
    try:
        Path(f"/proc/{pid}/autogroup").write_text(str(nice))
    except BlockingIOError:
        return False
    except OSError:  # Linux has no such groups, or refuses the change, or the process has ended
        return True
    return True


def _weighs_at_once(spec: ProcessSpec) -> bool:
    """True for a process that comes before others, and for one that reports nothing."""
    return spec.nice < 0 or not spec.heartbeat


def _weigh(child: Child) -> None:
    """Set the niceness of the session of ``child``, unless it is set or the child has ended."""
    if not child.weighed and child.alive:
        child.weighed = weigh_session(child.popen.pid, child.spec.nice)


def _schedule(spec: ProcessSpec, pid: int) -> None:
    """Set cores and niceness of a process that has just started; its threads inherit them. Raises InputError."""
    with suppress(ProcessLookupError):  # it has already ended, which is reported as such
        if spec.cores:
            os.sched_setaffinity(pid, spec.cores)
        if spec.nice:
            try:
                os.setpriority(os.PRIO_PROCESS, pid, spec.nice)
            except PermissionError as error:
                remedy = "give at least 0, or the right CAP_SYS_NICE (LimitNICE= of a systemd unit)"
                raise InputError(f"{_place(spec)}: nice: {spec.nice} is refused; {remedy}") from error


def _end_all(children: Iterable[Child], *, grace_s: float) -> None:
    """End ``children`` that run: SIGTERM, and SIGKILL after ``grace_s``."""
    running = [child for child in children if not child.log.closed]
    for child in running:
        if child.alive:
            child.popen.terminate()
            child.popen.send_signal(signal.SIGCONT)  # a paused process handles SIGTERM only after it
    deadline_s = time.monotonic() + grace_s
    for child in running:
        # with its own weight it would end late beside other work
        while child.spec.nice > 0 and child.alive and time.monotonic() < deadline_s:
            if weigh_session(child.popen.pid, 0):
                break
            time.sleep(WEIGH_PERIOD_S)
    for child in running:
        _end(child, deadline_s=deadline_s)


def _end(child: Child, *, deadline_s: float) -> None:
    """Wait for the end of the process until ``deadline_s``, then kill it; a command with all that it started."""
    try:
        child.popen.wait(max(0.0, deadline_s - time.monotonic()))
    except subprocess.TimeoutExpired:
        child.popen.kill()
        child.popen.wait()
    _close(child)


def _close(child: Child) -> None:
    """Close the pipe and the log, once: later the number of an ended group may be that of another program."""
    if child.log.closed:
        return
    if child.spec.command:
        with suppress(ProcessLookupError):
            os.killpg(child.popen.pid, signal.SIGKILL)
    if child.popen.stdin is not None:
        child.popen.stdin.close()
    child.log.close()
