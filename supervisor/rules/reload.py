"""Rules that change during a drive: a bad file never replaces a good one, and no step waits for a file.

A thread watches the file, and the place of its edited copy. When a text has changed, another process reads and
verifies it, :func:`main`, at low priority: reading YAML takes as long as a few hundred steps and would block the
interpreter of the steps. Only verified rules are returned, compiled; the node adopts them between two steps.
"""

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from supervisor.rules.inference import FearRules
from supervisor.rules.verify import load_verified
from trepid.config import ROOT, InputError, read_text
from trepid.messages import Health
from trepid.processes.process import Values
from trepid.processes.realtime import leave
from trepid.recording.notes import RULES, RULES_FROM_S

TIMEOUT_S = 60.0  # greatest time to read a file: usually about a second, ten on a busy computer
SETTLE_MS = 100  # an editor writes a file in several steps
POLL_MS = 1000  # for file systems that report no changes
NICENESS = 5


class RuleChange(NamedTuple):
    """A changed rule file after reading and verification."""

    rules: FearRules | None  # None: the file is refused
    error: str  # "" for a good file
    text: str = ""  # of the rules

    def values(self, *, from_s: float) -> Values:
        """For a heartbeat, which carries the text into the recording: decisions after ``from_s`` use the rules."""
        return ((RULES_FROM_S, repr(from_s)), (RULES, self.text))

    def apply(self, adopt: Callable[[FearRules], None]) -> tuple[Health, str]:
        """Pass good rules to ``adopt``; return health and message for the diagnostics topic."""
        error = self.error
        if self.rules is not None:
            try:
                adopt(self.rules)
            except InputError as refusal:
                error = str(refusal)
        return (Health.WARN, f"old rules kept: {error}") if error else (Health.OK, "drives by changed rules")


class RuleWatch:
    """Watches rule files in a thread; the one that changed last counts. Use as a context manager."""

    def __init__(self, path: Path, *edited: Path) -> None:
        """``edited``: places of edited copies of the file ``path``, which need not exist yet."""
        self._paths = tuple(dict.fromkeys(place.resolve() for place in (path, *edited)))
        self._changes: deque[RuleChange] = deque(maxlen=1)  # the latest counts
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="rule-watch", daemon=True)

    def __enter__(self) -> "RuleWatch":
        self._texts = {path: _text(path) for path in self._paths}
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(TIMEOUT_S)

    def take(self) -> RuleChange | None:
        """The result of the last change, once; None without a change."""
        return self._changes.popleft() if self._changes else None

    def _watch(self) -> None:
        import watchfiles  # in this thread, because the import takes 20 ms

        try:
            for _ in watchfiles.watch(
                *{path.parent for path in self._paths},
                watch_filter=lambda _, path: Path(path) in self._paths,
                stop_event=self._stop,
                debounce=SETTLE_MS,
                rust_timeout=POLL_MS,
                yield_on_timeout=True,
                recursive=False,
            ):
                self._poll()
        except (OSError, RuntimeError) as error:  # the limit of watches is reached, or the folder is gone
            where = ", ".join(str(path) for path in self._paths)
            self._changes.append(RuleChange(None, f"{where} cannot be watched: {error}"))

    def _poll(self) -> None:
        for path, before in self._texts.items():
            text = _text(path)
            if text != before:
                self._texts[path] = text
                self._changes.append(reread(path))


def _text(path: Path) -> str | None:
    try:
        return read_text(path)
    except InputError:
        return None  # missing at the moment, or unreadable: reread reports the error


def reread(path: Path) -> RuleChange:
    """The rules in the file at ``path``, read and verified by another process.

    It computes for about a second: this thread leaves the real-time class of its process, so that it has none.
    """
    leave()
    command = [sys.executable, "-m", "supervisor.rules.reload", str(path)]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return RuleChange(None, f"{path}: takes longer than {TIMEOUT_S:.0f} s to read")
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        return RuleChange(
            None, lines[-1] if lines else f"{path}: reading it ended with code {done.returncode}"
        )
    rules, text = pickle.loads(done.stdout)
    return RuleChange(rules, "", text)


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
