"""Detection of late messages: the next message of a sender has not come when it usually does.

A message is late ``periods`` usual periods after the one before it, at the earliest after ``least_s``. The usual
period is the median of the last intervals between the stamps of a sender, so that a slow sender, or a machine that
drops messages, has a longer one. A sender without a usual period so far is not late.
"""

import math
from collections import deque
from collections.abc import Mapping
from statistics import median

from trepid.config import Settings
from trepid.types import Positive

INTERVALS = 8  # of which the median is the usual period
FEWEST = 3  # intervals that make a usual period


class LatenessLimits(Settings):
    """When a message is late."""

    periods: Positive  # after so many usual periods ...
    least_s: Positive  # ... at the earliest after this time


class _Sender:
    """The usual period of one sender, and when its next message becomes late."""

    def __init__(self, limits: LatenessLimits) -> None:
        self._limits = limits
        self._intervals_s: deque[float] = deque(maxlen=INTERVALS)
        self._stamp_s = -math.inf
        self.late_at_s = math.inf

    def step(self, stamp_s: float, *, now_s: float) -> None:
        """Take a message that is there at ``now_s``; one with the stamp of the last changes nothing."""
        if not self._stamp_s < stamp_s < math.inf:
            return
        if math.isfinite(self._stamp_s):
            self._intervals_s.append(stamp_s - self._stamp_s)
        self._stamp_s = stamp_s
        self.late_at_s = math.inf
        if len(self._intervals_s) >= FEWEST:
            usual_s = median(self._intervals_s)
            self.late_at_s = now_s + max(self._limits.periods * usual_s, self._limits.least_s)


class Lateness:
    """Watches several senders."""

    def __init__(self, limits: LatenessLimits) -> None:
        self._limits = limits
        self._senders: dict[str, _Sender] = {}
        self._now_s = -math.inf

    def step(self, stamps_s: Mapping[str, float], *, now_s: float) -> frozenset[str]:
        """Names of the senders whose next message is late at ``now_s``.

        ``stamps_s``: time in the newest message of each, which increases from message to message, without senders
        that have sent none and without impossible times.
        """
        self._now_s = now_s
        for name, stamp_s in stamps_s.items():
            self._senders.setdefault(name, _Sender(self._limits)).step(stamp_s, now_s=now_s)
        return frozenset(name for name, sender in self._senders.items() if sender.late_at_s <= now_s)

    @property
    def next_s(self) -> float:
        """When the next message becomes late that is not late yet; inf: none."""
        times_s = (sender.late_at_s for sender in self._senders.values())
        return min((late_s for late_s in times_s if late_s > self._now_s), default=math.inf)
