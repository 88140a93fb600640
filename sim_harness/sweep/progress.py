"""Progress of a sweep on standard error: a bar in a terminal, else a line every few seconds."""

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINE_EVERY_S = 5.0
_WHOLE_SWEEP_S = 1e6  # average the speed over the whole sweep, because cases differ


class SweepProgress:
    """Counts cases and estimates the time left from the simulated seconds left. Use as a context manager."""

    def __init__(self, cases: int, simulated_s: float) -> None:
        self._cases, self._simulated_s = cases, simulated_s
        self._done, self._done_s = 0, 0.0
        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            redirect_stdout=sys.stdout.isatty(),
            speed_estimate_period=_WHOLE_SWEEP_S,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task(self._counted(), total=simulated_s)
        self._started_s = self._line_s = time.monotonic()

    def step(self, simulated_s: float) -> None:
        """Count a finished case of at most ``simulated_s``."""
        self._done += 1
        self._done_s += simulated_s
        self._bar.update(self._task, advance=simulated_s, description=self._counted())
        now_s = time.monotonic()
        if self._bar.disable and self._done < self._cases and now_s - self._line_s >= LINE_EVERY_S:
            self._line_s = now_s
            print(f"{self._counted()}, about {self._left_s(now_s):.0f} s left", file=sys.stderr, flush=True)

    def _left_s(self, now_s: float) -> float:
        return (now_s - self._started_s) * (self._simulated_s / self._done_s - 1.0)

    def _counted(self) -> str:
        return f"{self._done} of {self._cases} cases"

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()
