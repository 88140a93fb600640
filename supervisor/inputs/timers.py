"""Timers of conditions, for hysteresis. Time is an argument: no timer reads a clock."""

import math

from trepid.bounds import at_least, at_most


class Stopwatch:
    """Measures for how long a condition has held without a break."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def step(self, condition: bool, *, now_s: float) -> float:
        """Seconds since ``condition`` began to hold; 0 while it does not."""
        if not condition:
            self._since_s = None
            return 0.0
        if self._since_s is None:
            self._since_s = now_s
        return at_least(now_s - self._since_s, 0.0)


class HoldTimer:
    """Compares the time for which a condition has held without a break with a limit."""

    def __init__(self) -> None:
        self._watch = Stopwatch()

    def lasts(self, condition: bool, wanted_s: float | None, *, now_s: float, pause: bool = False) -> bool:
        """Whether ``condition`` has held for ``wanted_s``, None for never. ``pause`` has no effect."""
        held_s = self._watch.step(condition, now_s=now_s)
        return condition and wanted_s is not None and held_s >= wanted_s


class Patience:
    """Integrates the time of a condition: grows while it holds, shrinks at the same rate while it does not.

    A condition that changes from frame to frame neither resets the time nor increases it in the mean. ``pause``
    holds the time constant.
    """

    def __init__(self) -> None:
        self._borne_s = 0.0
        self._last_s: float | None = None

    def lasts(self, condition: bool, wanted_s: float | None, *, now_s: float, pause: bool = False) -> bool:
        """Whether ``condition`` holds and its time has reached ``wanted_s``, the upper limit; None for never."""
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        step_s = dt_s if condition else 0.0 if pause else -dt_s
        limit_s = math.inf if wanted_s is None else wanted_s
        self._borne_s = at_most(at_least(self._borne_s + step_s, 0.0), limit_s)
        return condition and self._borne_s >= limit_s
