"""The Zenoh bus: the only module that imports Zenoh.

Latest wins: a subscription keeps the newest message and nothing else (the Deep Steer paper's lag above
10 Hz was its queue). All traffic stays on the loopback interface of this machine, multicast scouting is off,
and every drive has its own port, so two drives on one machine do not receive each other's messages.

Only a message that triggers a step wakes a process: its arrival is noted by a short callback on a thread of Zenoh.
All others lie in a ring of Zenoh until they are read, and cost no Python before.
"""

import json
import os
import socket
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Generic, NamedTuple, TypeVar

import zenoh

from trepid.clock import UNSTAMPED, Clock, Stamp, stamp_of, stamper
from trepid.security import refuse_open_endpoints
from trepid.topics import CAMERA_IMAGE, Topic
from trepid.wire import WireError, from_cdr, to_cdr

TX_QUEUE = 16  # messages or fragments of 64 kB; the most that Zenoh allows
KEPT = 4096  # messages that a stream or tap keeps until it is drained: seconds of all topics together
KEPT_IMAGES = 128  # raw images that a tap keeps: seconds
OLDEST_S = 10.0  # older stamps of publication do not date a message
SWITCH_S = 5e-4  # the step of a process lets the callback of an arriving message in after this long
RUNTIME = "(rx: (worker_threads: 1), app: (worker_threads: 1))"
"""Threads of Zenoh in one process: processes share few cores. ZENOH_RUNTIME in the environment overrides it."""
ZenohError = zenoh.ZError
"""Raised by :func:`open_bus` where no endpoint answers or can be opened."""
M = TypeVar("M")
L = TypeVar("L", bound="Latest[Any]")


def free_endpoint() -> str:
    """A free TCP endpoint on the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Arrival(NamedTuple):
    """A message that has arrived: a sample of Zenoh, or the object that a node of this process published."""

    sample: Any
    at_s: float


class Bell:
    """Wakes the one thread that waits: a lock that is released to ring, without the second lock of an Event."""

    def __init__(self) -> None:
        self._silent = threading.Lock()
        self._silent.acquire()

    def ring(self) -> None:
        """End the wait under way, or the next one."""
        with suppress(RuntimeError):  # it has rung since the last wait
            self._silent.release()

    def wait(self, timeout_s: float) -> bool:
        """True when it rings or has rung since the last call; False after ``timeout_s``."""
        return self._silent.acquire(timeout=timeout_s)


class Mailbox:
    """The newest arrival, kept by a short callback on a thread of Zenoh that also wakes the process.

    The nodes of one process that read the same key share a callback (:meth:`beside`). With a callback for each, the
    process would wake at the first and hold the interpreter, for which the others would wait.
    """

    def __init__(self, bell: Bell, clock: Clock) -> None:
        self._bell = bell
        self._clock = clock
        self._queue: deque[Arrival] = deque(maxlen=1)
        self._queues = [self._queue]  # of all mailboxes of the callback
        self.handler: Any = zenoh.handlers.Callback(self._deliver, indirect=False)
        """indirect=False: Zenoh's own thread makes the call; the default spawns a thread that outlives main."""

    def beside(self) -> "Mailbox":
        """Another mailbox for the samples of this one; it needs no subscriber."""
        another = Mailbox(self._bell, self._clock)
        self._queues.append(another._queue)
        return another

    def put(self, message: Any) -> None:
        """Keep a message of this process."""
        self._queue.append(Arrival(message, self._clock()))
        self._bell.ring()

    def pop(self) -> Arrival | None:
        """The arrival that is kept, or None."""
        return self._queue.popleft() if self._queue else None

    def _deliver(self, sample: Any) -> None:
        """Keep a sample as it is: bytes are copied and decoded by the reader."""
        arrival = Arrival(sample, self._clock())
        for queue in self._queues:
            queue.append(arrival)
        self._bell.ring()


class Ring:
    """The newest arrivals, kept by Zenoh without Python; they wake nothing."""

    def __init__(self, kept: int, clock: Clock) -> None:
        self._clock = clock
        self._own: deque[Arrival] = deque(maxlen=kept)  # published by this process
        self._try_recv: Callable[[], Any] = lambda: None
        self.handler: Any = zenoh.handlers.RingChannel(kept)

    def read_from(self, subscriber: Any) -> None:
        """Read the samples of ``subscriber``, which was declared with ``handler``."""
        self._try_recv = subscriber.try_recv

    def put(self, sample: Any) -> None:
        """Keep a message of this process."""
        self._own.append(Arrival(sample, self._clock()))

    def pop(self) -> Arrival | None:
        """The oldest arrival that is kept, or None; the time is that of the call."""
        sample = self._try_recv()
        if sample is not None:
            return Arrival(sample, self._clock())
        return self._own.popleft() if self._own else None


class Latest(Generic[M]):
    """The newest message of one topic."""

    def __init__(self, topic: Topic[M], kept: Mailbox | Ring) -> None:
        self.topic = topic
        self._kept = kept
        self.message: M | None = None
        """The newest message taken so far; None before the first."""
        self.received_s: float | None = None
        """Arrival of ``message`` on the clock of this process [s]; its first reading where it lay in a ring."""
        self.stamp: Stamp = UNSTAMPED
        """Publisher, time of publication and number of ``message``."""
        self.malformed = 0
        """Number of messages malformed, or of a clock that stepped back; they count as not received."""
        self.overtaken = 0
        """Number of messages older than ``message``: replayed, or out of order; they count as not received."""
        self.broken = False
        """The newest payload read is malformed, or of a clock that stepped back: ``message`` is an older one."""

    def put(self, message: M) -> None:
        """Keep a message that a node of this process has published."""
        self._kept.put(message)

    def take(self) -> M | None:
        """The message if one arrived since the last call, else None; malformed and replayed ones count as none."""
        arrival = self._kept.pop()
        if arrival is None:
            return None
        stamp = _stamp(arrival)
        if stamp.repeats(self.stamp, now_s=arrival.at_s):
            if stamp.steps_back(self.stamp):
                self.malformed += 1
                self.broken = True
            else:
                self.overtaken += 1
            return None
        message = self._decode(arrival)
        if message is not None:
            self.message, self.received_s, self.stamp = message, arrival.at_s, stamp
        return message

    def refresh(self) -> M | None:
        """The newest message, new or not; None before the first."""
        self.take()
        return self.message

    def _decode(self, arrival: Arrival) -> M | None:
        if isinstance(arrival.sample, self.topic.type):
            message: M | None = arrival.sample
        else:
            try:
                message = from_cdr(arrival.sample.payload.to_bytes(), self.topic.type)
            except WireError:
                message = None
                self.malformed += 1
        self.broken = message is None
        return message


class Stream(Latest[M]):
    """Every message of one topic in order, for referees and recorders that need all of them."""

    def drain(self) -> list[tuple[M, float]]:
        """All messages since the last call with their times of publication [s], oldest first."""
        arrived = list(iter(self._kept.pop, None))
        decoded = ((self._decode(arrival), _publication_time_s(arrival)) for arrival in arrived)
        return [(message, at_s) for message, at_s in decoded if message is not None]


class Tap:
    """All messages on some keys as bytes, for recorders."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self.rings: list[Ring] = []
        self.subscribers: list[Any] = []

    def close(self) -> None:
        """End the subscription; what was not drained is lost."""
        for subscriber in self.subscribers:
            subscriber.undeclare()

    def drain(self) -> list[tuple[str, bytes, float]]:
        """Key, CDR bytes and time of publication [s] of all messages since the last call, in order of time."""
        arrived = [arrival for ring in self.rings for arrival in iter(ring.pop, None)]
        found = [
            (
                str(arrival.sample.key_expr).removeprefix(self._prefix + "/"),
                arrival.sample.payload.to_bytes(),
                _publication_time_s(arrival),
            )
            for arrival in arrived
        ]
        return sorted(found, key=lambda message: message[2])


class Newest:
    """The newest message on a key of others, as bytes."""

    def __init__(self, kept: Mailbox) -> None:
        self._kept = kept

    def take(self) -> tuple[bytes, float] | None:
        """The payload and its time of arrival [s] if one arrived since the last call, else None."""
        arrival = self._kept.pop()
        return None if arrival is None else (arrival.sample.payload.to_bytes(), arrival.at_s)


class Bus:
    """Publish and subscribe below ``trepid/<vehicle-name>/``."""

    def __init__(self, session: zenoh.Session, vehicle_name: str, clock: Clock) -> None:
        self._session = session
        self._clock = clock
        self.vehicle_name = vehicle_name
        self._prefix = f"trepid/{vehicle_name}"
        self._bell = Bell()
        self._subscribers: list[Any] = []
        self._mailboxes: dict[str, Mailbox] = {}  # the first of each key
        self._subscriptions: list[Latest[Any]] = []
        self._listeners: dict[str, list[Latest[Any]]] = {}  # subscriptions of this process by topic key

    def publisher(self, topic: Topic[M]) -> Callable[[M], None]:
        """A function that publishes one message of ``topic``.

        Subscriptions of this bus get the message itself, without the way over the wire.
        """
        publisher = self._session.declare_publisher(
            f"{self._prefix}/{topic.key}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME if topic.urgent else zenoh.Priority.DATA,
            express=True,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        stamp = stamper(self._clock)
        listeners = self._listeners.setdefault(topic.key, [])

        def send(message: M) -> None:
            if not isinstance(message, topic.type):
                raise TypeError(f"{topic.key!r} carries {topic.type.__name__}, got {type(message).__name__}")
            for listener in listeners:
                listener.put(message)
            data = to_cdr(message)  # type: ignore[arg-type]
            publisher.put(data, attachment=stamp())

        return send

    def forwarder(self, key: str) -> Callable[[bytes], None]:
        """A function that publishes the CDR bytes of a message on ``key``, such as that of a recording."""
        publisher = self._session.declare_publisher(
            f"{self._prefix}/{key}", congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        stamp = stamper(self._clock)
        return lambda data: publisher.put(data, attachment=stamp())

    def latest(self, topic: Topic[M], *, wakes: bool = True) -> Latest[M]:
        """Subscription that keeps the newest message of ``topic``; its arrival ends :meth:`wait`, if it wakes."""
        return self._subscribe(Latest(topic, self._mailbox(topic.key) if wakes else self._ring(topic.key, 1)))

    def stream(self, topic: Topic[M]) -> Stream[M]:
        """Subscription that keeps every message of ``topic`` until it is drained; it wakes nothing."""
        return self._subscribe(Stream(topic, self._ring(topic.key, KEPT)))

    def tap(self, *keys: str, kept: int = KEPT) -> Tap:
        """Subscription that keeps the bytes of all messages on ``keys``, which may hold ``**``, until drained.

        Of each key expression the newest ``kept`` stay. Messages of this process are not among them.
        """
        tap = Tap(self._prefix)
        for key in keys:
            most = KEPT_IMAGES if key == CAMERA_IMAGE.key else KEPT
            tap.rings.append(Ring(min(kept, most), self._clock))
            tap.subscribers.append(self._declare_subscriber(key, tap.rings[-1]))
        return tap

    def newest(self, key_expression: str) -> Newest:
        """Subscription on a whole key expression, outside ``trepid/<vehicle-name>/``; an arrival wakes.

        Raises ZenohError for text that is no key expression.
        """
        kept = Mailbox(self._bell, self._clock)
        self._subscribers.append(self._session.declare_subscriber(key_expression, kept.handler))
        return Newest(kept)

    def _subscribe(self, latest: L) -> L:
        self._subscriptions.append(latest)
        self._listeners.setdefault(latest.topic.key, []).append(latest)
        return latest

    def _mailbox(self, key: str) -> Mailbox:
        """A mailbox for the samples on a key."""
        if key in self._mailboxes:
            return self._mailboxes[key].beside()
        mailbox = self._mailboxes[key] = Mailbox(self._bell, self._clock)
        self._subscribers.append(self._declare_subscriber(key, mailbox))
        return mailbox

    def _ring(self, key: str, kept: int) -> Ring:
        """A ring for the newest ``kept`` samples on a key."""
        ring = Ring(kept, self._clock)
        self._subscribers.append(self._declare_subscriber(key, ring))
        return ring

    def malformed_counts(self) -> dict[str, int]:
        """Number of malformed messages read so far by topic key; only topics that had one."""
        counts: Counter[str] = Counter()
        for subscription in self._subscriptions:
            counts[subscription.topic.key] += subscription.malformed
        return dict(+counts)

    def _declare_subscriber(self, key: str, kept: Mailbox | Ring) -> Any:
        """A subscriber of ``key`` that fills ``kept`` as long as it is referenced."""
        subscriber: Any = self._session.declare_subscriber(f"{self._prefix}/{key}", kept.handler)
        if isinstance(kept, Ring):
            kept.read_from(subscriber)
        return subscriber

    def wake(self) -> None:
        """End the wait under way, or the next one; may be called by a handler of a signal."""
        self._bell.ring()

    def wait(self, timeout_s: float) -> bool:
        """Wait until a message that wakes arrives; False after ``timeout_s`` without one."""
        return self._bell.wait(timeout_s)


def _stamp(arrival: Arrival) -> Stamp:
    attachment = getattr(arrival.sample, "attachment", None)  # a message of this process has none
    if attachment is None:
        return UNSTAMPED._replace(published_s=arrival.at_s)
    return stamp_of(attachment.to_bytes())


def _publication_time_s(arrival: Arrival) -> float:
    """Time of publication by the stamp where it is plausible, else that of reading [s]."""
    published_s = _stamp(arrival).published_s
    return published_s if arrival.at_s - OLDEST_S <= published_s <= arrival.at_s else arrival.at_s


@contextmanager
def open_bus(
    vehicle_name: str,
    clock: Clock,
    *,
    connect: str | None = None,
    listen: str | None = None,
    further: Mapping[str, object] | None = None,
) -> Iterator[Bus]:
    """A bus on a session of :func:`open_session`."""
    sys.setswitchinterval(SWITCH_S)
    with open_session(connect=connect, listen=listen, further=further) as session:
        yield Bus(session, vehicle_name, clock)


def listen_to(session: zenoh.Session, key: str, put: Callable[[Any], None]) -> Any:
    """A subscriber whose samples Zenoh's own thread passes to ``put``; the default would spawn a thread for it."""
    handler: Any = zenoh.handlers.Callback(put, indirect=False)
    return session.declare_subscriber(key, handler)


@contextmanager
def open_session(
    *, connect: str | None = None, listen: str | None = None, further: Mapping[str, object] | None = None
) -> Iterator[zenoh.Session]:
    """A session of Zenoh that listens as the router of a drive, or connects to the router at ``connect``.

    A peer without a listen endpoint receives nothing, so every peer also listens on its own port; connected
    peers exchange messages directly, also after the router has ended. ``further`` holds values of the
    configuration of Zenoh by key, such as ``transport/link/tls``.
    """
    os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)  # read by Zenoh at its first session
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
        **(further or {}),
    }
    refuse_open_endpoints(settings)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


class Graph:
    """Bytes on any keys in the network of another system, such as a ROS 2 graph."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[Any] = []
        self.session_id = str(session.zid())

    def token(self, key: str) -> None:
        """Declare a liveliness token that lasts as long as the session."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def publisher(self, key: str, *, cached: bool = False) -> Callable[[bytes, bytes | None], None]:
        """A function that publishes bytes with an attachment; ``cached``: late subscribers get the newest."""
        settings: dict[str, Any] = dict(congestion_control=zenoh.CongestionControl.DROP)
        publisher: Any = (
            zenoh.ext.declare_advanced_publisher(
                self._session, key, cache=zenoh.ext.CacheConfig(1), publisher_detection=True, **settings
            )
            if cached
            else self._session.declare_publisher(key, express=True, **settings)
        )
        self._declared.append(publisher)

        def send(data: bytes, attachment: bytes | None) -> None:
            publisher.put(data, attachment=attachment)

        return send

    def newest(self, key: str) -> Callable[[], bytes | None]:
        """A function that gives the newest bytes on ``key`` since its last call; None when none arrived."""
        subscriber: Any = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
        self._declared.append(subscriber)

        def take() -> bytes | None:
            sample = subscriber.try_recv()
            return None if sample is None else bytes(sample.payload.to_bytes())

        return take


@contextmanager
def open_graph(settings: Mapping[str, object]) -> Iterator[Graph]:
    """A session of its own with ``settings`` of Zenoh. Raises ConnectionError when it cannot be opened."""
    config = zenoh.Config()
    for key, value in {"scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ConnectionError(str(error).splitlines()[0]) from error
    with session:
        yield Graph(session)
