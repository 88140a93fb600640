"""The load of every process over a drive, from its heartbeats."""

from trepid.messages import Diagnostic
from trepid.processes.process import READY


class Loads:
    """Means over time of what heartbeats give for the time since the one before."""

    def __init__(self) -> None:
        self._beat_s: dict[str, float] = {}  # of the newest heartbeat, by process
        self._sums: dict[
            str, tuple[float, float, float]
        ] = {}  # time [s], steps, processor time [% of a core · s]

    def add(self, beat: Diagnostic) -> None:
        """Add a heartbeat; the first one of a process, and one that reports its start, only begin an interval."""
        before_s = self._beat_s.get(beat.process)
        self._beat_s[beat.process] = beat.t_s
        if before_s is None or beat.message == READY:
            return
        over_s, values = beat.t_s - before_s, dict(beat.values)
        time_s, steps, cpu = self._sums.get(beat.process, (0.0, 0.0, 0.0))
        self._sums[beat.process] = (
            time_s + over_s,
            steps + over_s * float(values["rate_hz"]),
            cpu + over_s * float(values["cpu_percent"]),
        )

    def of(self, process: str) -> dict[str, float | None]:
        """Mean steps per second and share of a core [%] of a process; None without an interval."""
        time_s, steps, cpu = self._sums.get(process, (0.0, 0.0, 0.0))
        return {
            "rate_hz": round(steps / time_s, 1) if time_s > 0.0 else None,
            "cpu_percent": round(cpu / time_s, 1) if time_s > 0.0 else None,
        }
