"""Processes that send no heartbeat, by the time in which the launcher listened to them."""

from collections.abc import Container, Iterator, Mapping

from trepid.clock import Clock
from trepid.messages import Diagnostic
from trepid.processes.launch import Child, Fleet

LONGEST_TURN_S = (
    0.2  # of a longer turn of the launcher no more counts: it was paused, or waited for the processor
)


class Silence:
    """For how long the processes with heartbeats have sent none.

    The time runs while the launcher listens. After a pause of the launcher (SIGSTOP, a starved machine) the
    heartbeats of the meantime are still to be read, and the pause is no silence of the processes.
    """

    def __init__(self, clock: Clock, fleet: Fleet, *, longest_s: float, longest_start_s: float) -> None:
        """A process is silent after ``longest_s``; before its first heartbeat, after ``longest_start_s``."""
        self._clock = clock
        self._fleet = fleet
        self._longest_s, self._longest_start_s = longest_s, longest_start_s
        self._turn_s = clock()
        self._listened_s = 0.0
        self._heard: dict[
            str, tuple[int, float | None]
        ] = {}  # process id and time of the newest heartbeat ...
        self._heard_at_s: dict[str, float] = {}  # ... and when they changed, of the time of listening

    def silent(
        self, beats: Mapping[str, Diagnostic], *, paused: Container[str]
    ) -> Iterator[tuple[str, float]]:
        """The silent processes and the time of their silence [s]; to be called at every turn of the launcher.

        ``beats``: the newest heartbeat of each process. ``paused``: processes that are silent on purpose.
        """
        now_s = self._clock()
        self._listened_s += min(now_s - self._turn_s, LONGEST_TURN_S)
        self._turn_s = now_s
        for name, child in self._fleet.children.items():
            if not (child.spec.heartbeat and child.alive):
                continue
            beat_s = _beat_s(child, beats.get(name))
            heard = child.popen.pid, beat_s
            if name in paused or heard != self._heard.get(name):
                self._heard[name], self._heard_at_s[name] = heard, self._listened_s
            silent_s = self._listened_s - self._heard_at_s[name]
            if silent_s > (self._longest_start_s if beat_s is None else self._longest_s):
                yield name, silent_s


def _beat_s(child: Child, beat: Diagnostic | None) -> float | None:
    """Time of the newest heartbeat of ``child``; None for one of the process that it replaces."""
    return None if beat is None or beat.t_s < child.started_s else beat.t_s
