"""Rules that change during a drive: a bad file never replaces a good one, and no step waits for a file.

A thread watches the file. When its text has changed, another process reads and verifies it, :func:`main`, at low
priority: reading YAML takes as long as a few hundred steps and would block the interpreter of the steps. Only
verified rules are returned, compiled; the node adopts them between two steps.
"""

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import watchfiles

from supervisor.rules.inference import FearRules
from supervisor.rules.verify import load_verified
from trepid.config import ROOT, InputError, read_text
from trepid.messages import Health
from trepid.processes.process import Values

TIMEOUT_S = 60.0  # greatest time to read a file: usually about a second, ten on a busy computer
SETTLE_MS = 100  # an editor writes a file in several steps
POLL_MS = 1000  # for file systems that report no changes
NICENESS = 5
FROM_S, TEXT = "rules_from_s", "rules"  # values of the diagnostics that announce changed rules


class News(NamedTuple):
    """The result of reading a changed file."""

    rules: FearRules | None  # None: the file is refused
    complaint: str  # the error; "" for a good file
    text: str = ""  # of the rules


class RuleWatch:
    """Watches a rule file in a thread. Use as a context manager."""

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        self._news: deque[News] = deque(maxlen=1)  # the latest counts
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="rule-watch", daemon=True)

    def __enter__(self) -> "RuleWatch":
        self._text = _text(self._path)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(TIMEOUT_S)

    def take(self) -> News | None:
        """The result of the last change, once; None without a change."""
        return self._news.popleft() if self._news else None

    def _watch(self) -> None:
        try:
            for _ in watchfiles.watch(
                self._path.parent,
                watch_filter=lambda _, path: Path(path).name == self._path.name,
                stop_event=self._stop,
                debounce=SETTLE_MS,
                rust_timeout=POLL_MS,
                yield_on_timeout=True,
                recursive=False,
            ):
                self._poll()
        except (OSError, RuntimeError) as error:  # the limit of watches is reached, or the folder is gone
            self._news.append(News(None, f"{self._path.parent} cannot be watched: {error}"))

    def _poll(self) -> None:
        text = _text(self._path)
        if text != self._text:
            self._text = text
            self._news.append(reread(self._path))


def _text(path: Path) -> str | None:
    try:
        return read_text(path)
    except InputError:
        return None  # missing at the moment, or unreadable: reread reports the error


def reread(path: Path) -> News:
    """The rules in the file at ``path``, read and verified by another process."""
    command = [sys.executable, "-m", "supervisor.rules.reload", str(path)]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return News(None, f"{path}: takes longer than {TIMEOUT_S:.0f} s to read")
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        return News(None, lines[-1] if lines else f"{path}: reading it ended with code {done.returncode}")
    rules, text = pickle.loads(done.stdout)
    return News(rules, "", text)


class Announcement:
    """Adopted rules, reported once: the next heartbeat carries their text into the recording."""

    def __init__(self) -> None:
        self._values: Values = ()

    def of(self, news: News, *, from_s: float) -> None:
        """Decisions after ``from_s`` use the rules in ``news``."""
        self._values = ((FROM_S, repr(from_s)), (TEXT, news.text))

    def values(self) -> Values:
        """The values of the next heartbeat; empty afterwards."""
        values, self._values = self._values, ()
        return values


def taken_over(news: News, adopt: Callable[[FearRules], None]) -> tuple[Health, str]:
    """Pass good rules to ``adopt``; return health and message for the diagnostics topic."""
    complaint = news.complaint
    if news.rules is not None:
        try:
            adopt(news.rules)
        except InputError as error:
            complaint = str(error)
    return (
        (Health.WARN, f"old rules kept: {complaint}") if complaint else (Health.OK, "drives by changed rules")
    )


def main() -> int:
    """``python -m supervisor.rules.reload FILE``: verified rules and text, pickled; or the error, exit 2."""
    os.nice(NICENESS)
    try:
        text = read_text(Path(sys.argv[1]))
        rules = load_verified(Path(sys.argv[1]))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    sys.stdout.buffer.write(pickle.dumps((rules, text)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
