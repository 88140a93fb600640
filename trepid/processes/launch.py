"""Start, watch and stop the processes of a drive.

Every child is its own ``python -m <module>`` in a session of its own (Ctrl-C reaches only the launcher) and
holds the reading end of a pipe to the launcher: when the launcher dies, by whatever cause, the pipe closes and
the child ends itself (:mod:`trepid.processes.process`).
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from typing import IO, Any

from trepid.config import ROOT
from trepid.processes.process import Assignment

ABORT_GRACE_S = 0.3
TERM_GRACE_S = 1.2  # SIGTERM to SIGKILL; with the kill this keeps a stop below 2 s


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process of a drive: ``python -m module`` with options."""

    name: str
    module: str
    options: dict[str, Any] = field(default_factory=dict)
    restart: bool = True  # start it again when it dies


@dataclass(slots=True)
class Child:
    """A started process."""

    spec: ProcessSpec
    popen: subprocess.Popen[bytes]
    log: IO[bytes]
    restarts: int = 0

    def last_words(self, lines: int = 12) -> str:
        """The end of what the process wrote to standard error."""
        self.log.seek(0)
        said = self.log.read().decode(errors="replace").splitlines()
        telling = [line.strip() for line in said if line.strip() and not line.startswith("Extension modules")]
        return " | ".join(telling[-lines:])


@dataclass(frozen=True, slots=True)
class Death:
    """A child that ended although nobody asked it to."""

    name: str
    pid: int
    returncode: int
    last_words: str

    def __str__(self) -> str:
        how = (
            f"was killed by {signal.Signals(-self.returncode).name}"
            if self.returncode < 0
            else f"exited with code {self.returncode}"
        )
        return f"process {self.name} (pid {self.pid}) {how}" + (
            f": {self.last_words}" if self.last_words else ""
        )


class Fleet:
    """The processes of one drive. Use as a context manager: leaving it leaves no process behind."""

    def __init__(
        self,
        specs: tuple[ProcessSpec, ...],
        *,
        vehicle_name: str,
        endpoint: str,
        clock_offset_ns: int,
        max_restarts: int,
    ) -> None:
        self._session = {
            "vehicle_name": vehicle_name,
            "connect": endpoint,
            "clock_offset_ns": clock_offset_ns,
        }
        self._specs = specs
        self._max_restarts = max_restarts
        self.children: dict[str, Child] = {}

    def __enter__(self) -> "Fleet":
        try:
            for spec in self._specs:
                self.children[spec.name] = self._start(spec)
        except OSError:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self, spec: ProcessSpec) -> Child:
        assignment = Assignment.model_validate({"name": spec.name, "options": spec.options, **self._session})
        log = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the child
        popen = subprocess.Popen(
            [sys.executable, "-m", spec.module, assignment.model_dump_json()],
            cwd=ROOT,  # so that `-m` finds our packages before any namesake that is installed
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
            start_new_session=True,
            # One thread per process: two cores carry seven of them.
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        return Child(spec, popen, log)

    def bury(self) -> list[Death]:
        """The children that died since the last call; each is started again while it has restarts left."""
        deaths = []
        for name, child in self.children.items():
            returncode = child.popen.poll()
            if returncode is None or child.log.closed:
                continue
            deaths.append(Death(name, child.popen.pid, returncode, child.last_words()))
            _close(child)
            if child.spec.restart and child.restarts < self._max_restarts:
                self.children[name] = self._start(child.spec)
                self.children[name].restarts = child.restarts + 1
        return deaths

    def kill(self, name: str) -> None:
        """End a process that no longer answers; :meth:`bury` then reports it.

        SIGABRT makes it say where it hangs (faulthandler); SIGKILL ends one that cannot even do that.
        """
        popen = self.children[name].popen
        popen.send_signal(signal.SIGABRT)
        try:
            popen.wait(ABORT_GRACE_S)
        except subprocess.TimeoutExpired:
            popen.kill()
            popen.wait()

    def pause(self, name: str) -> None:
        """Let a process stand still (SIGSTOP), as if it were lost; it goes on by itself when the launcher dies."""
        self.children[name].popen.send_signal(signal.SIGSTOP)

    def resume(self, name: str) -> None:
        """Let a paused process go on where it was."""
        self.children[name].popen.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End every child within 2 s: SIGTERM, then SIGKILL."""
        for child in self.children.values():
            if child.popen.poll() is None:
                child.popen.terminate()
                child.popen.send_signal(signal.SIGCONT)  # a paused one would not hear of it
        deadline_s = time.monotonic() + TERM_GRACE_S
        for child in self.children.values():
            try:
                child.popen.wait(max(0.0, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.popen.kill()
                child.popen.wait()
            _close(child)


def _close(child: Child) -> None:
    if child.popen.stdin is not None:
        child.popen.stdin.close()
    child.log.close()
