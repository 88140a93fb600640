"""The report of the launcher about processes that do not run: those that stop or slow the car, those awaited."""

import math
from collections.abc import Collection, Container, Iterator, Mapping

from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import Diagnostic, Losses
from trepid.processes.launch import Child, Fleet
from trepid.processes.settings import LAUNCHER, Loss
from trepid.topics import LOSSES

PERIOD_S = 0.2
RUNS_S = 1.0


class LossReport:
    """Publishes the lost processes by the effect of their loss, and the awaited ones.

    It publishes at every change, while there is any, and until the drive begins, so that a process hears it that
    starts meanwhile.

    A process whose loss stops the car stays in the report: the stop is final. A process whose loss slows the car
    leaves the report with its first heartbeat after the restart; without heartbeats, when it has run for RUNS_S.
    """

    def __init__(self, bus: Bus, clock: Clock, fleet: Fleet) -> None:
        self._send = bus.publisher(LOSSES)
        self._clock = clock
        self._fleet = fleet
        self._stop: set[str] = set()
        self._slow: dict[str, float] = {}  # name -> time of the loss
        self._awaited: tuple[str, ...] | None = tuple(fleet.children)  # None: the drive has begun
        self._reported: tuple[tuple[str, ...], ...] = ()
        self._sent_s = -math.inf

    def lose(self, name: str) -> Loss:
        """Note the loss of the process ``name``; the effect of its loss."""
        loss = self._fleet.children[name].spec.loss
        if loss is Loss.STOP:
            self._stop.add(name)
        elif loss is Loss.SLOW:
            self._slow[name] = self._clock()
        return loss

    def wait_for(self, names: Collection[str]) -> None:
        """A standing car does not start before the processes ``names``; without any the drive may begin."""
        self._awaited = tuple(sorted(names))

    def begin(self) -> None:
        """The drive has begun."""
        self._awaited = None

    def request_stop(self) -> None:
        """Stop the car, because the drive is to end."""
        self._stop.add(LAUNCHER)

    def publish(self, beats: Mapping[str, Diagnostic]) -> None:
        """Publish if the report has changed or is due. ``beats``: the newest heartbeat of the processes."""
        for name in [name for name in self._slow if self._is_back(name, beats.get(name))]:
            del self._slow[name]
        now = tuple(sorted(self._stop)), tuple(sorted(self._slow)), self._awaited or ()
        due = (any(now) or self._awaited is not None) and self._clock() - self._sent_s >= PERIOD_S
        if now != self._reported or due:
            self._reported, self._sent_s = now, self._clock()
            stop, slow, awaited = now
            self._send(Losses(t_s=self._clock(), stop=stop, slow=slow, awaited=awaited))

    def _is_back(self, name: str, beat: Diagnostic | None) -> bool:
        """True when the process runs again after its loss. ``beat``: its newest heartbeat."""
        child, lost_s = self._fleet.children[name], self._slow[name]
        if child.spec.heartbeat:
            return beat is not None and beat.t_s > lost_s
        return child.alive and child.started_s > lost_s and self._clock() - child.started_s >= RUNS_S


LONGEST_TURN_S = 0.2  # of a longer turn of the launcher no more counts: it was paused, or not scheduled


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
        # Process id and time of the newest heartbeat, and when they changed, of the time of listening.
        self._heard: dict[str, tuple[int, float | None]] = {}
        self._heard_at_s: dict[str, float] = {}

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
