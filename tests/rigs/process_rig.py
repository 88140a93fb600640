"""Observation of real processes in tests."""

import time
from collections.abc import Callable
from pathlib import Path


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
