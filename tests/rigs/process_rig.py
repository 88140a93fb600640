"""Observation of real processes in tests."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from trepid.config import ROOT


def alive(pid: int) -> bool:
    """True while a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it may also end between opening and reading
        return False


def until(condition: Callable[[], object], *, patience_s: float) -> bool:
    """Wait up to ``patience_s`` for the condition; True when it holds in time."""
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        if condition():
            return True
        time.sleep(0.02)
    return bool(condition())


def ends_with_its_launcher(program: str, *, patience_s: float) -> bool:
    """Run ``program`` until it prints the pid of a process, and kill it; True when that process ends in time."""
    launcher = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert launcher.stdout is not None
    with launcher, launcher.stdout:
        pid = int(launcher.stdout.readline())
        assert alive(pid)
        launcher.kill()
        return until(lambda: not alive(pid), patience_s=patience_s)
