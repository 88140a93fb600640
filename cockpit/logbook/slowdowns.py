"""Slow-downs of a drive: falls of a speed, separated from noise by a zigzag filter."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trepid.types import Column

CLEAR = 0.05  # of the cruise speed: smaller swings are noise
DEEP = 0.2  # of the cruise speed: a fall within a longer one is reported from this depth on
NEAR_S = 5.0  # greatest distance in time of a slow-down from the given time


@dataclass(frozen=True, slots=True)
class SlowDown:
    """A fall of a speed, as indices into it."""

    before: int  # the last sample at the height from which it fell
    lowest: int
    end: int  # the first sample that is back at that height, else the last of all
    is_over: bool  # the speed is back at that height


def slow_downs(speed_mps: Column, clear_mps: float) -> list[SlowDown]:
    """Every fall of ``speed_mps`` by ``clear_mps`` or more that no rise of as much interrupts."""
    found = []
    for peak, trough in _falls(speed_mps, clear_mps):
        high = np.flatnonzero(speed_mps[trough:] >= speed_mps[peak] - clear_mps)
        end = trough + int(high[0]) if len(high) else len(speed_mps) - 1
        found.append(SlowDown(peak, trough, end, is_over=bool(len(high))))
    return found


def significant(found: list[SlowDown], speed_mps: Column, deep_mps: float) -> list[SlowDown]:
    """The outermost slow-downs, and of those within others the ones of ``deep_mps`` or more."""
    kept: list[SlowDown] = []
    end = -1
    for slow in found:
        outermost = slow.before >= end
        if outermost:
            end = slow.end
        if outermost or speed_mps[slow.before] - speed_mps[slow.lowest] >= deep_mps:
            kept.append(slow)
    return kept


def nearest(found: list[SlowDown], t_s: Column, at_s: float) -> SlowDown | None:
    """The slow-down at ``at_s``: the last of those that contain it, else the nearest."""
    during = [s for s in found if t_s[s.before] <= at_s + 1e-9 and (at_s <= t_s[s.end] or not s.is_over)]
    if during:
        return during[-1]
    close = [s for s in found if _distance_s(s, t_s, at_s) <= NEAR_S]
    return min(close, key=lambda s: _distance_s(s, t_s, at_s), default=None)


def _distance_s(slow: SlowDown, t_s: Column, at_s: float) -> float:
    return float(max(t_s[slow.before] - at_s, at_s - t_s[slow.end], 0.0))


def _falls(speed_mps: Column, clear_mps: float) -> Iterator[tuple[int, int]]:
    """Peak and trough of each fall. A peak is its last sample, a trough its first."""
    peak, trough, falling = 0, 0, False
    for i, speed in enumerate(speed_mps.tolist()):
        if falling:
            if speed < speed_mps[trough]:
                trough = i
            elif speed >= speed_mps[trough] + clear_mps:
                yield peak, trough
                peak, falling = i, False
        elif speed >= speed_mps[peak]:
            peak = i
        elif speed <= speed_mps[peak] - clear_mps:
            trough, falling = i, True
    if falling:
        yield peak, trough
