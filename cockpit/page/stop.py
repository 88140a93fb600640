"""The stop button of the page: requests are repeated until the vehicle process reports that it holds the car."""

from collections.abc import Callable
from typing import NamedTuple

from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import StopRequest
from trepid.topics import STOP_REQUEST

REPEAT_S = 0.1
UNDELIVERED_S = 1.5  # a stop that is not acknowledged for longer; heartbeats come every second
RELEASE_S = 0.5


class Hold(NamedTuple):
    """What the vehicle process reports of the stop button."""

    t_s: float  # of its heartbeat
    held: bool


class StopSender:
    """Sends what was pressed last: a stop until it is acknowledged, a release for RELEASE_S at most."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._send: Callable[[StopRequest], None] = bus.publisher(STOP_REQUEST)
        self._clock = clock
        self._wanted: bool | None = None
        self._pressed_s = self._sent_s = 0.0

    def press(self, stop: bool) -> None:
        """Stop the car, or release the stop."""
        if not (stop and self.pending):  # a further press does not make an unacknowledged stop a new one
            self._wanted, self._pressed_s = stop, self._clock()
        self._publish()

    def turn(self, hold: Hold | None) -> None:
        """Repeat the request while the vehicle process has not reported its effect since it was pressed."""
        now_s = self._clock()
        acknowledged = hold is not None and hold.held is self._wanted and hold.t_s > self._pressed_s
        given_up = self._wanted is False and now_s - self._pressed_s > RELEASE_S
        if acknowledged or given_up:
            self._wanted = None
        elif self.waiting and now_s - self._sent_s >= REPEAT_S:
            self._publish()

    @property
    def waiting(self) -> bool:
        """A stop or its release is sent and not acknowledged yet."""
        return self._wanted is not None

    @property
    def pending(self) -> bool:
        """A stop is sent and not acknowledged yet."""
        return self._wanted is True

    @property
    def is_undelivered(self) -> bool:
        """A stop is pending for so long that the vehicle process has probably not received it."""
        return self.pending and self._clock() - self._pressed_s > UNDELIVERED_S

    def _publish(self) -> None:
        self._sent_s = self._clock()
        self._send(StopRequest(t_s=self._sent_s, stop=bool(self._wanted)))
