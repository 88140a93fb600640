"""The stop button of the page: requests are repeated until the vehicle process reports that it holds the car."""

from collections.abc import Callable

from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import StopRequest
from trepid.topics import STOP_REQUEST

REPEAT_S = 0.1
PATIENCE_S = (
    10.0  # a stop that is not acknowledged for longer is reported as not delivered, and repeated no more
)
RELEASE_S = 0.5


class StopSender:
    """Sends what was pressed last."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._send: Callable[[StopRequest], None] = bus.publisher(STOP_REQUEST)
        self._clock = clock
        self._wanted: bool | None = None
        self._pressed_s = self._sent_s = 0.0

    def press(self, stop: bool) -> None:
        """Stop the car, or release the stop."""
        self._wanted, self._pressed_s = stop, self._clock()
        self._publish()

    def turn(self, *, held: bool) -> None:
        """Repeat the request while the vehicle process does not report its effect."""
        now_s = self._clock()
        patience_s = PATIENCE_S if self._wanted else RELEASE_S
        if self._wanted is None or held is self._wanted or now_s - self._pressed_s > patience_s:
            self._wanted = None
        elif now_s - self._sent_s >= REPEAT_S:
            self._publish()

    @property
    def waiting(self) -> bool:
        """A stop or its release is sent and not acknowledged yet."""
        return self._wanted is not None

    @property
    def pending(self) -> bool:
        """A stop is sent and not acknowledged yet."""
        return self._wanted is True

    def _publish(self) -> None:
        self._sent_s = self._clock()
        self._send(StopRequest(t_s=self._sent_s, stop=bool(self._wanted)))
