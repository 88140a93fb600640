"""What the loss of a process means: stop, slow, nothing. The launcher tells the supervisor."""

from collections.abc import Iterable

from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import Losses
from trepid.processes.launch import Fleet
from trepid.processes.settings import LAUNCHER, Loss
from trepid.topics import LOSSES

PERIOD_S = 0.2


class LossReport:
    """Publishes which processes are missing and what that means, at every change and while one is missing.

    A lost process whose loss means a stop stays in the report: the stop is final. One that slows the car leaves it
    with its first heartbeat after the restart.
    """

    def __init__(self, bus: Bus, clock: Clock, fleet: Fleet) -> None:
        self._send = bus.publisher(LOSSES)
        self._clock = clock
        self._fleet = fleet
        self._stop: set[str] = set()
        self._slow: dict[str, float] = {}  # name -> time of the loss
        self._reported: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._sent_s = clock()

    def lose(self, name: str) -> Loss:
        """Note the loss of the process ``name``; what it means."""
        loss = self._fleet.children[name].spec.loss
        if loss is Loss.STOP:
            self._stop.add(name)
        elif loss is Loss.SLOW:
            self._slow[name] = self._clock()
        return loss

    def request_stop(self) -> None:
        """Stop the car, because the drive is to end."""
        self._stop.add(LAUNCHER)

    def publish(self, beats_s: Iterable[tuple[str, float]]) -> None:
        """Publish when it is due. ``beats_s``: time of the newest heartbeat of the processes."""
        for name, beat_s in beats_s:
            if beat_s > self._slow.get(name, beat_s):
                del self._slow[name]
        now = tuple(sorted(self._stop)), tuple(sorted(self._slow))
        due = any(now) and self._clock() - self._sent_s >= PERIOD_S
        if now != self._reported or due:
            self._reported, self._sent_s = now, self._clock()
            self._send(Losses(t_s=self._clock(), stop=now[0], slow=now[1]))
