"""How long a contradiction is remembered, and which values stand still."""

import math
from collections import deque

from vehicle.measurement.settings import DoubtSettings, StandsSettings

FADE = 0.9  # a second, of the usual repetition
FINE = 8.0  # a sensor is fine where its resolution is so much finer than the change that it must show


class Doubt:
    """Whether one quantity is doubted: from a contradiction until none has been seen for ``trust_after_s``.

    A contradiction shorter than ``spike_s`` ends at once, so that a single wrong value takes nothing but itself,
    unless another one has been seen within ``trust_after_s`` before it.
    """

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._since_s = self._seen_s = self._ended_s = -math.inf
        self.reason = ""
        """Why the quantity is doubted; "" while it is not."""

    def step(self, reason: str, *, now_s: float) -> bool:
        """Whether the quantity is doubted now; ``reason``: what contradicts its newest value, "" for nothing."""
        limits = self._settings
        if reason:
            if not self.reason:
                again = now_s - self._ended_s <= limits.trust_after_s
                self._since_s = -math.inf if again else now_s
                self.reason = reason
            self._seen_s = now_s
        elif self.reason:
            lasted_s = self._seen_s - self._since_s
            if now_s - self._seen_s >= (0.0 if lasted_s < limits.spike_s else limits.trust_after_s):
                self.reason, self._ended_s = "", now_s
        return bool(self.reason)


class Standing:
    """For how long a value has repeated itself to the last bit, and whether that is too long.

    It is too long when the value by the other quantities has changed meanwhile by ``change``, or when the value of
    a sensor of fine resolution has never stood for long before while the car moved, and the command has changed.
    """

    def __init__(self, settings: StandsSettings, change: float) -> None:
        self._settings, self._change = settings, change
        self._value: float | None = None
        self._began_s = self._then_s = math.nan
        self._low = self._high = 0.0  # of the expected value, while the value stands
        self._usual_s = 0.0
        self._stuck = 0.0  # the change that the value did not show; it stays until the value changes
        self._moved_s = 0.0  # for which changes were observed
        self._step = math.inf  # the least change so far

    def step(self, value: float, expected: float, *, moving: bool, now_s: float) -> float:
        """The change of ``expected`` [its unit] while ``value`` stands for too long; 0 while it does not.

        A value that has stood for too long does so until it changes, also when the car stands.
        """
        if value != self._value:
            self._stuck = 0.0
            if self._value is not None and moving:
                self._usual_s = max(self._usual_s, now_s - self._began_s)
                self._step = min(self._step, abs(value - self._value))
            self._value, self._began_s = value, now_s
            self._low = self._high = expected
        elif self._stuck:
            return self._stuck
        elif not moving:
            self._began_s = now_s
            self._low = self._high = expected
        dt_s = 0.0 if math.isnan(self._then_s) else now_s - self._then_s
        self._then_s = now_s
        if moving:
            self._moved_s += dt_s
            self._usual_s *= FADE**dt_s
        self._low, self._high = min(self._low, expected), max(self._high, expected)
        stood_s, changed = now_s - self._began_s, self._high - self._low
        if stood_s < self._settings.after_s:
            return 0.0
        fine = self._step * FINE <= self._change and self._moved_s - stood_s > self._settings.after_s
        odd = fine and changed > 0.0 and stood_s > self._settings.usual_times * self._usual_s
        self._stuck = changed if odd or changed > self._change else 0.0
        return self._stuck


class Window:
    """Least and greatest of the values of the last ``span_s``."""

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._values: deque[float] = deque()
        self._times_s: deque[float] = deque()

    def add(self, value: float, *, now_s: float) -> None:
        """Add ``value``; the last value from before the window stays, since it held at its begin."""
        times_s, values = self._times_s, self._values
        times_s.append(now_s)
        values.append(value)
        while len(times_s) > 1 and times_s[1] <= now_s - self._span_s:
            times_s.popleft()
            values.popleft()

    def clear(self) -> None:
        """Forget all values."""
        self._times_s.clear()
        self._values.clear()

    @property
    def ends(self) -> tuple[float, float] | None:
        """The least and the greatest value; None without any."""
        return (min(self._values), max(self._values)) if self._values else None

    @property
    def first(self) -> tuple[float, float] | None:
        """Time and value of the oldest entry; None without any."""
        return (self._times_s[0], self._values[0]) if self._values else None

    def beyond(self, value: float) -> float:
        """Distance of ``value`` from the range of the window, signed; 0 within it and for an empty window."""
        if not self._values:
            return 0.0
        return max(value - max(self._values), 0.0) + min(value - min(self._values), 0.0)
