"""The load of every process over a drive, from its heartbeats."""

import math

from trepid.messages import Diagnostic
from trepid.processes.process import READY, Values

LOADS = ("rate_hz", "cpu_percent")
"""Values of a heartbeat: steps per second and share of a core [%]."""


class Loads:
    """Means over time of what heartbeats give for the time since the one before."""

    def __init__(self) -> None:
        self._beat_s: dict[str, float] = {}  # of the newest heartbeat, by process
        self._sums: dict[
            tuple[str, str], tuple[float, float]
        ] = {}  # time [s] and integral, by process and value

    def add(self, beat: Diagnostic) -> None:
        """Add a heartbeat; the first one of a process, and one that reports its start, only begin an interval."""
        before_s = self._beat_s.get(beat.process)
        self._beat_s[beat.process] = beat.t_s
        if before_s is None or beat.message == READY:
            return
        over_s = beat.t_s - before_s
        for key in LOADS:
            load = number(beat.values, key)
            if load is not None:
                time_s, integral = self._sums.get((beat.process, key), (0.0, 0.0))
                self._sums[beat.process, key] = time_s + over_s, integral + over_s * load

    def of(self, process: str) -> dict[str, float | None]:
        """Mean steps per second and share of a core [%] of a process; None without an interval."""
        return {key: self._mean(process, key) for key in LOADS}

    def _mean(self, process: str, key: str) -> float | None:
        time_s, integral = self._sums.get((process, key), (0.0, 0.0))
        return round(integral / time_s, 1) if time_s > 0.0 else None


def number(values: Values, key: str) -> float | None:
    """The value ``key`` of a heartbeat, which any program may send; None when it is absent or no finite number."""
    try:
        found = float(dict(values)[key])
    except (KeyError, ValueError):
        return None
    return found if math.isfinite(found) else None
