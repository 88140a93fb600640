"""The one clock: seconds since the Unix epoch that never jump.

CLOCK_MONOTONIC is shared by all processes of a machine and immune to clock steps; the launcher adds one fixed
offset so that stamps read as ROS time.

Every message carries a :class:`Stamp` beside its CDR bytes, in the layout of ROS 2's rmw_zenoh, 33 bytes,
little-endian::

    int64 sequence_number    of this publisher, from 1
    int64 source_timestamp   time of publication [ns]
    uint8 16                 length of ...
    uint8[16] source_gid     ... the random identity of the publisher

It serves measurement, and the detection of losses, of repetitions and of clocks that step.
"""

import itertools
import math
import os
import struct
import time
from collections.abc import Callable
from typing import NamedTuple

Clock = Callable[[], float]

NANO = 1_000_000_000
LAYOUT = struct.Struct("<qqB16s")
GID_BYTES = 16


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


class Stamp(NamedTuple):
    """Identity, time and number of a publication."""

    sequence: int  # of its publisher, from 1; 0: none
    published_s: float  # time of publication [s]; NaN: none
    publisher: bytes  # random identity

    def repeats(self, newest: "Stamp", *, now_s: float) -> bool:
        """Whether a message with this stamp is no newer than the one with ``newest``: replayed or out of order.

        A stamp from the future, later than ``now_s``, makes no other message old.
        """
        if 0 < self.sequence <= newest.sequence and self.publisher == newest.publisher:
            return True
        return self.published_s < newest.published_s <= now_s

    def steps_back(self, newest: "Stamp") -> bool:
        """Whether the clock of the publisher has stepped back since ``newest``: a later number, an earlier time."""
        later = self.publisher == newest.publisher and self.sequence > newest.sequence > 0
        return later and self.published_s < newest.published_s


UNSTAMPED = Stamp(0, math.nan, b"")
"""The stamp of a message without one, or with one of another layout."""


def stamper(clock: Clock) -> Callable[[], bytes]:
    """A function that returns the attachment of the next message of one new publisher."""
    numbers, gid = itertools.count(1), os.urandom(GID_BYTES)

    def stamp() -> bytes:
        return LAYOUT.pack(next(numbers), nanoseconds(clock()), GID_BYTES, gid)

    return stamp


def stamp_of(attachment: bytes | None) -> Stamp:
    """The stamp in an attachment; UNSTAMPED where there is none."""
    if attachment is None or len(attachment) != LAYOUT.size:
        return UNSTAMPED
    sequence, published_ns, length, gid = LAYOUT.unpack(attachment)
    return Stamp(sequence, seconds(published_ns), gid) if length == GID_BYTES else UNSTAMPED
