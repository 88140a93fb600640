"""Progress of a sweep on standard error: a bar in a terminal, else a line every few seconds."""

import sys
import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from trepid.loudness import Loudness, loudness, note

LINE_EVERY_S = 5.0
_WHOLE_SWEEP_S = 1e6  # average the speed over the whole sweep, because cases differ


class SweepProgress(Progress):
    """Counts cases and estimates the time left from the simulated seconds left. Use as a context manager."""

    def __init__(self, cases: int, simulated_s: float, *, noun: str = "cases") -> None:
        """``noun``: what is counted."""
        console = Console(stderr=True)
        super().__init__(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            redirect_stdout=sys.stdout.isatty(),
            speed_estimate_period=_WHOLE_SWEEP_S,
            disable=not console.is_terminal or loudness() is Loudness.QUIET,
        )
        self._cases, self._simulated_s, self._noun = cases, simulated_s, noun
        self._done, self._done_s = 0, 0.0
        self._bar = self.add_task(f"0 of {cases} {noun}", total=simulated_s)
        self._started_s = self._line_s = time.monotonic()

    def step(self, simulated_s: float) -> None:
        """Count a finished case of at most ``simulated_s``."""
        self._done, self._done_s, now_s = self._done + 1, self._done_s + simulated_s, time.monotonic()
        counted = f"{self._done} of {self._cases} {self._noun}"
        self.update(self._bar, advance=simulated_s, description=counted)
        if self.disable and self._done < self._cases and now_s - self._line_s >= LINE_EVERY_S:
            self._line_s = now_s
            left_s = (now_s - self._started_s) * (self._simulated_s / self._done_s - 1.0)
            note(f"{counted}, about {left_s:.0f} s left")
