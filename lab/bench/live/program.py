"""A ``trepid drive`` as a program of its own: its start, the processes that belong to it, its end."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from trepid.config import ROOT, InputError
from trepid.processes.register import Running

START_S = 45.0
ASSIGNMENT = 3  # of the arguments of a process: python -m MODULE ASSIGNMENT


class DriveProgram:
    """A drive with the options ``words``; its output and its register are in ``folder``."""

    def __init__(
        self,
        folder: Path,
        words: list[str],
        *,
        wrapped: Callable[[list[str]], list[str]] = lambda command: command,
    ) -> None:
        """``wrapped`` makes the command that becomes ``trepid drive``."""
        self._folder = folder
        command = [sys.executable, "-m", "trepid", "drive", *words, "--no-dashboard", "--json"]
        with (folder / "stderr").open("wb") as errors, (folder / "row.json").open("wb") as row:
            self.popen = subprocess.Popen(
                wrapped(command),
                cwd=ROOT,
                stdout=row,
                stderr=errors,
                start_new_session=True,
                env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
            )
        self._running: Running | None = None

    @property
    def running(self) -> Running:
        """Name, endpoint and clock of the drive. Waits until it is registered; raises InputError otherwise."""
        path = self._folder / "trepid" / f"{self.popen.pid}.json"
        until_s = time.monotonic() + START_S
        while self._running is None:
            if path.exists() and path.stat().st_size:
                self._running = Running.model_validate_json(path.read_text(encoding="utf-8"))
            elif self.popen.poll() is not None or time.monotonic() > until_s:
                raise InputError(f"the drive did not start: {self.errors()}")
            else:
                time.sleep(0.1)
        return self._running

    def errors(self) -> str:
        """The last lines on standard error."""
        return " | ".join((self._folder / "stderr").read_text(errors="replace").splitlines()[-3:])

    def row(self) -> dict[str, Any]:
        """The result of the drive after its end. Raises InputError when there is none."""
        self.popen.wait()
        try:
            row: dict[str, Any] = json.loads((self._folder / "row.json").read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"the drive gave no result: {self.errors()}") from error
        return row

    def pids(self) -> dict[str, int]:
        """The processes of the drive that run, by name, without the launcher; also after its end."""
        found = {}
        for path in Path("/proc").glob("[0-9]*"):
            try:
                arguments = (path / "cmdline").read_bytes().split(b"\0")
                state = (path / "stat").read_text().rsplit(")", 1)[1].split()[0]
            except (FileNotFoundError, ProcessLookupError, PermissionError):
                continue  # it ended meanwhile, or belongs to another user
            ours = len(arguments) > ASSIGNMENT and self.running.endpoint.encode() in arguments[ASSIGNMENT]
            if ours and state not in "ZX":
                found[str(json.loads(arguments[ASSIGNMENT])["name"])] = int(path.name)
        return found

    def interrupt(self) -> None:
        """Ask the drive to end."""
        with suppress(ProcessLookupError):
            self.popen.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Kill whatever still runs."""
        if self.popen.poll() is None:
            self.popen.kill()
        self.popen.wait()
        if self._running is not None:
            kill(self.pids().values())


def kill(pids: Any) -> None:
    """SIGKILL to each of the processes."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
