"""Detection of late messages: the next message of a sender has not come when it usually does.

A message is late ``periods`` usual periods after the one before it, at the earliest after ``least_s``. The usual
period is the median of the last intervals between the stamps of a sender, so that a slow sender, or a machine that
drops messages, has a longer one. A sender without a usual period so far is not late. A sender whose message came
late stays late until RECOVERED messages in a row have come in time, for INTERVALS messages at most: one that is
late now and then for longer is usually so.
"""

import math
from collections import deque
from collections.abc import Mapping
from statistics import median
from types import MappingProxyType

from trepid.bounds import at_most
from trepid.config import Settings
from trepid.types import Positive

INTERVALS = 8  # of which the median is the usual period
FEWEST = 3  # intervals that make a usual period
RECOVERED = 3  # messages in time in a row, after one that was late


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
        self._since_late, self._in_time = 0, 0  # messages since the first late one; in time in a row
        self.late_at_s = math.inf

    def step(self, stamp_s: float, *, came_s: float) -> None:
        """Take a message that came at ``came_s``; one with the stamp of the last changes nothing."""
        if not self._stamp_s < stamp_s < math.inf:
            return
        was_late = came_s >= self.late_at_s
        self._in_time = 0 if was_late else self._in_time + 1
        if self._in_time >= RECOVERED:
            self._since_late = 0
        elif was_late or self._since_late:
            self._since_late += 1
        if math.isfinite(self._stamp_s):
            self._intervals_s.append(stamp_s - self._stamp_s)
        self._stamp_s = stamp_s
        self.late_at_s = math.inf
        if len(self._intervals_s) >= FEWEST:
            usual_s = median(self._intervals_s)
            self.late_at_s = came_s + max(self._limits.periods * usual_s, self._limits.least_s)

    def is_late(self, now_s: float) -> bool:
        """Whether the next message has not come in time, or the last ones did not."""
        return 0 < self._since_late <= INTERVALS or self.late_at_s <= now_s


class Lateness:
    """Watches several senders."""

    def __init__(self, limits: LatenessLimits) -> None:
        self._limits = limits
        self._senders: dict[str, _Sender] = {}
        self._now_s = -math.inf

    def step(
        self,
        stamps_s: Mapping[str, float],
        *,
        now_s: float,
        came_s: Mapping[str, float] = MappingProxyType({}),
    ) -> frozenset[str]:
        """Names of the senders whose next message is late at ``now_s``.

        ``stamps_s``: time in the newest message of each, which increases from message to message, without senders
        that have sent none and without impossible times. ``came_s``: when messages came that lay unread until this
        step; the others come with it, and none later.
        """
        self._now_s = now_s
        for name, stamp_s in stamps_s.items():
            sender = self._senders.setdefault(name, _Sender(self._limits))
            sender.step(stamp_s, came_s=at_most(came_s.get(name, now_s), now_s))
        return frozenset(name for name, sender in self._senders.items() if sender.is_late(now_s))

    @property
    def next_s(self) -> float:
        """When the next message becomes late that is not late yet; inf: none."""
        times_s = (sender.late_at_s for sender in self._senders.values())
        return min((late_s for late_s in times_s if late_s > self._now_s), default=math.inf)
