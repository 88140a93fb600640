"""Start, watch and stop the processes of a drive.

Every child is a ``python -m <module>`` in its own session (Ctrl-C reaches only the launcher) and holds the reading
end of a pipe to the launcher. The pipe closes when the launcher ends for any reason, and the child then ends itself
(:mod:`trepid.processes.process`).
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
from trepid.processes.process import BAD_INPUT, Assignment

ABORT_GRACE_S = 0.3
TERM_GRACE_S = 1.2  # SIGTERM to SIGKILL; with the kill this keeps a stop below 2 s


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process of a drive: ``python -m module`` with options."""

    name: str
    module: str
    options: dict[str, Any] = field(default_factory=dict)
    restart: bool = True  # start it again after an unexpected end


@dataclass(slots=True)
class Child:
    """A started process."""

    spec: ProcessSpec
    popen: subprocess.Popen[bytes]
    log: IO[bytes]
    restarts: int = 0

    def stderr_tail(self, lines: int = 12) -> str:
        """The last lines that the process wrote to its log, joined by `` | ``."""
        self.log.seek(0)
        written = self.log.read().decode(errors="replace").splitlines()
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
        max_restarts: int,
    ) -> None:
        self._session = dict(vehicle_name=vehicle_name, connect=endpoint, clock_offset_ns=clock_offset_ns)
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
            cwd=ROOT,  # `-m` then prefers the packages of this checkout to installed ones of the same name
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
            start_new_session=True,
            # One thread per process: seven processes share two cores.
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        return Child(spec, popen, log)

    def collect_exits(self) -> list[UnexpectedExit]:
        """The children that ended since the last call; each is started again while it has restarts left.

        A process that refused its input is not started again.
        """
        exits = []
        for name, child in self.children.items():
            returncode = child.popen.poll()
            if returncode is None or child.log.closed:
                continue
            ended = UnexpectedExit(name, child.popen.pid, returncode, child.stderr_tail())
            exits.append(ended)
            _close(child)
            if child.spec.restart and not ended.from_bad_input and child.restarts < self._max_restarts:
                self.children[name] = self._start(child.spec)
                self.children[name].restarts = child.restarts + 1
        return exits

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
        """End every child within 2 s: SIGTERM, then SIGKILL."""
        for child in self.children.values():
            if child.popen.poll() is None:
                child.popen.terminate()
                child.popen.send_signal(signal.SIGCONT)  # a paused process handles SIGTERM only after it
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
