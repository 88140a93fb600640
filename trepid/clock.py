"""The one clock: seconds since the Unix epoch that never jump.

CLOCK_MONOTONIC is shared by all processes of a machine and immune to clock steps; the launcher adds one fixed
offset so that stamps read as ROS time.
"""

import time
from collections.abc import Callable

Clock = Callable[[], float]

NANO = 1_000_000_000


def epoch_offset_ns() -> int:
    """Offset from the monotonic clock to the Unix epoch, to be measured once per drive [ns]."""
    return time.time_ns() - time.monotonic_ns()


def epoch_clock(offset_ns: int) -> Clock:
    """Clock that returns the monotonic time plus ``offset_ns`` [s]."""

    def now_s() -> float:
        return seconds(time.monotonic_ns() + offset_ns)

    return now_s


def seconds(stamp_ns: int) -> float:
    """Float seconds of an integer stamp [ns]; exact inverse of :func:`nanoseconds` on its own results."""
    whole, rest = divmod(stamp_ns, NANO)
    return whole + rest / NANO


def nanoseconds(t_s: float) -> int:
    """Integer stamp [ns] of float seconds."""
    whole = int(t_s // 1)
    return whole * NANO + round((t_s - whole) * NANO)
