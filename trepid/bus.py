"""The Zenoh bus: the only module that imports Zenoh.

Latest wins: a subscription keeps the newest message and nothing else (the Deep Steer paper's lag above
10 Hz was its queue). All traffic stays on the loopback interface of this machine, multicast scouting is off,
and every drive has its own port, so two drives on one machine do not receive each other's messages.
"""

import json
import socket
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

import zenoh

from trepid.clock import Clock
from trepid.topics import Topic
from trepid.wire import WireError, from_cdr, to_cdr

TX_QUEUE = 16  # messages or fragments of 64 kB; the most that Zenoh allows
M = TypeVar("M")
L = TypeVar("L", bound="Latest[Any]")


def free_endpoint() -> str:
    """A free TCP endpoint on the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Latest(Generic[M]):
    """The newest message of one topic."""

    KEPT: int | None = 1  # payloads that wait to be read; None: all

    def __init__(self, topic: Topic[M], arrived: threading.Event, clock: Clock) -> None:
        self.topic = topic
        self._arrived = arrived
        self._clock = clock
        self._queue: deque[tuple[bytes, float]] = deque(maxlen=self.KEPT)
        self.message: M | None = None
        """The newest message taken so far; None before the first."""
        self.received_s: float | None = None
        """Arrival of ``message`` on the clock of this process [s]."""
        self.malformed = 0
        """Number of payloads that could not be decoded; they count as not received."""
        self.broken = False
        """True while the newest payload read is a malformed one: the input is broken, ``message`` is older."""

    def put(self, sample: zenoh.Sample) -> None:
        """Keep a sample; called by Zenoh on its own thread."""
        self._queue.append((sample.payload.to_bytes(), self._clock()))
        self._arrived.set()

    def take(self) -> M | None:
        """The message if one arrived since the last call, else None; malformed payloads count as none."""
        if not self._queue:
            return None
        data, received_s = self._queue.popleft()
        message = self._decoded(data)
        if message is not None:
            self.message, self.received_s = message, received_s
        return message

    def refresh(self) -> M | None:
        """The newest message, new or not; None before the first."""
        self.take()
        return self.message

    def _decoded(self, data: bytes) -> M | None:
        try:
            message = from_cdr(data, self.topic.type)
        except WireError:
            message = None
            self.malformed += 1
        self.broken = message is None
        return message


class Stream(Latest[M]):
    """Every message of one topic in order, for referees and recorders that need all of them."""

    KEPT = None

    def drain(self) -> list[tuple[M, float]]:
        """All messages since the last call with their times of arrival [s], oldest first."""
        arrived = [self._queue.popleft() for _ in range(len(self._queue))]
        decoded = ((self._decoded(data), received_s) for data, received_s in arrived)
        return [(message, received_s) for message, received_s in decoded if message is not None]


class Tap:
    """All messages on some keys as bytes, for recorders."""

    def __init__(self, prefix: str, clock: Clock) -> None:
        self._prefix = prefix
        self._clock = clock
        self._queue: deque[tuple[str, bytes, float]] = deque()

    def put(self, sample: zenoh.Sample) -> None:
        """Keep a sample; called by Zenoh on its own thread."""
        key = str(sample.key_expr).removeprefix(self._prefix + "/")
        self._queue.append((key, sample.payload.to_bytes(), self._clock()))

    def drain(self) -> list[tuple[str, bytes, float]]:
        """Key, CDR bytes and time of arrival [s] of all messages since the last call."""
        return [self._queue.popleft() for _ in range(len(self._queue))]


class Bus:
    """Publish and subscribe below ``trepid/<vehicle-name>/``."""

    def __init__(self, session: zenoh.Session, vehicle_name: str, clock: Clock) -> None:
        self._session = session
        self._clock = clock
        self._prefix = f"trepid/{vehicle_name}"
        self._arrived = threading.Event()
        self._subscribers: list[zenoh.Subscriber[None]] = []
        self._subscriptions: list[Latest[Any]] = []

    def publisher(self, topic: Topic[M]) -> Callable[[M], None]:
        """A function that publishes one message of ``topic``."""
        publisher = self._session.declare_publisher(
            f"{self._prefix}/{topic.key}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME if topic.urgent else zenoh.Priority.DATA,
            express=True,
        )

        def send(message: M) -> None:
            if not isinstance(message, topic.type):
                raise TypeError(f"{topic.key!r} carries {topic.type.__name__}, got {type(message).__name__}")
            publisher.put(to_cdr(message))  # type: ignore[arg-type]

        return send

    def latest(self, topic: Topic[M]) -> Latest[M]:
        """Subscription that keeps the newest message of ``topic``."""
        return self._subscribe(topic, Latest(topic, self._arrived, self._clock))

    def stream(self, topic: Topic[M]) -> Stream[M]:
        """Subscription that keeps every message of ``topic`` until it is drained."""
        return self._subscribe(topic, Stream(topic, self._arrived, self._clock))

    def tap(self, *keys: str) -> Tap:
        """Subscription that keeps the bytes of all messages on ``keys``, which may hold ``**``, until drained."""
        tap = Tap(self._prefix, self._clock)
        for key in keys:
            self._declare(key, tap.put)
        return tap

    def _subscribe(self, topic: Topic[M], latest: L) -> L:
        self._declare(topic.key, latest.put)
        self._subscriptions.append(latest)
        return latest

    def malformed(self) -> dict[str, int]:
        """Number of malformed messages read so far by topic key; only topics that had one."""
        counts: Counter[str] = Counter()
        for subscription in self._subscriptions:
            counts[subscription.topic.key] += subscription.malformed
        return dict(+counts)

    def _declare(self, key: str, put: Callable[[zenoh.Sample], None]) -> None:
        # indirect=False: Zenoh's own thread calls put; the default spawns a Python thread that outlives main.
        handler = zenoh.handlers.Callback(put, indirect=False)
        self._subscribers.append(self._session.declare_subscriber(f"{self._prefix}/{key}", handler))

    def wait(self, timeout_s: float) -> bool:
        """Wait until a message arrives on any subscription; False after ``timeout_s`` without one."""
        arrived = self._arrived.wait(timeout_s)
        self._arrived.clear()
        return arrived


@contextmanager
def open_bus(
    vehicle_name: str, clock: Clock, *, connect: str | None = None, listen: str | None = None
) -> Iterator[Bus]:
    """A bus that listens as the router of a drive, or connects to the router at ``connect``.

    A peer without a listen endpoint receives nothing, so every peer also listens on its own port; connected
    peers exchange messages directly, also after the router has ended.
    """
    config = zenoh.Config()
    settings = {
        "mode": "router" if listen else "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "listen/endpoints": [listen or "tcp/127.0.0.1:0"],
        "connect/endpoints": [connect] if connect else [],
        # The default of 2 loses the third of three messages that are sent at once.
        "transport/link/tx/queue/size/real_time": TX_QUEUE,
        "transport/link/tx/queue/size/data": TX_QUEUE,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield Bus(session, vehicle_name, clock)
