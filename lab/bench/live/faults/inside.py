"""A process of a drive that can harm its own messages and its own clock.

``processes.yaml`` of the benchmark names this module in place of the real one, which it imports and runs
(:func:`main`). Between the bus and Zenoh stands :class:`FaultySession`: without a fault it passes every message on.
SIGUSR1 makes the process read its :class:`Order` from the file of its name in the control folder.

Beside the messages of the process two topics report to the benchmark, with true stamps: ``bench/marks`` names every
falsified message and every frame of the camera, ``bench/applied`` holds the commands that act on the car.
"""

import importlib
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import trepid.bus
import trepid.processes.process
from lab.bench.live.faults.catalogue import Act
from trepid.clock import GID_BYTES, LAYOUT, Clock, epoch_clock, nanoseconds, stamp_of, stamper
from trepid.config import Settings
from trepid.messages import Command, Frame, VehicleState
from trepid.processes.process import Assignment, Process, process
from trepid.processes.turns import repeat
from trepid.topics import CAMERA_IMAGE, VEHICLE_STATE, Topic
from trepid.wire import from_cdr, to_cdr

MODULE = "lab.bench.live.faults.inside"
APPLIED = Topic("bench/applied", Command, 100)
MARKS = "bench/marks"
FRAME_MARK = "frame"
REPLAYED_S = 1.0
KEPT = 128  # messages of a topic: a second at 100 Hz, and more
TYPES: dict[str, type[Any]] = {CAMERA_IMAGE.key: Frame, VEHICLE_STATE.key: VehicleState}
Sent = tuple[bytes, bytes | None]
"""CDR bytes and attachment of a message."""


class Order(Settings):
    """What the process has to do until the next order."""

    act: Act | None = None
    key: str = ""  # of the topic that is falsified
    clock_step_s: float = 0.0
    stamps_only: bool = False  # the step concerns the stamps of the topic, not the clock of a simulation
    renewals: int = 0  # the node starts anew whenever this number has grown


class HostOptions(Settings):
    """Options of the process besides those of the real module."""

    hosted: str  # the real module
    control: Path  # folder of the orders
    applied: Literal["", "limiter", "ecu"] = ""  # where commands act on the car in this process


class Falsifier:
    """What the faults make of the messages of one topic."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, Sent]] = deque(maxlen=KEPT)
        self._held: Sent | None = None
        self._image: bytes | None = None
        self._rng = np.random.default_rng(0)

    def keep(self, sent: Sent, *, now_s: float) -> None:
        """Remember a message for a later replay."""
        self._past.append((now_s, sent))

    def calm(self) -> None:
        """No fault is active."""
        self._held = self._image = None

    def falsify(self, order: Order, data: bytes, attachment: bytes | None, *, now_s: float) -> list[Sent]:
        """The messages that are published in place of one under ``order``, oldest first."""
        sent: Sent | None = (data, attachment)  # a clock that steps changes the stamps of the process itself
        match order.act:
            case Act.SILENT:
                sent = None
            case Act.CORRUPT:
                cut, junk = data[: int(self._rng.integers(0, len(data)))], self._rng.bytes(len(data))
                sent = (cut if self._rng.random() < 0.5 else junk, attachment)
            case Act.REPLAY:
                sent = next(sent for at_s, sent in self._past if now_s - at_s <= REPLAYED_S)
            case Act.DISORDER:
                held, self._held = self._held, None if self._held else (data, attachment)
                return [(data, attachment), held] if held else []
            case Act.REPEAT:
                self._image = self._image or data
                frame = replace(from_cdr(self._image, Frame), t_s=from_cdr(data, Frame).t_s)
                sent = to_cdr(frame), attachment
            case Act.CLOCK if order.stamps_only:
                message = from_cdr(data, TYPES[order.key])
                shifted = replace(message, t_s=message.t_s + order.clock_step_s)
                sent = to_cdr(shifted), restamp(attachment, order.clock_step_s)
        return [sent] if sent else []


def restamp(attachment: bytes | None, step_s: float) -> bytes:
    """The stamp in ``attachment`` as by a clock that is ``step_s`` ahead."""
    stamp = stamp_of(attachment)
    return LAYOUT.pack(stamp.sequence, nanoseconds(stamp.published_s + step_s), GID_BYTES, stamp.publisher)


class FaultyPublisher:
    """A publisher of Zenoh whose messages are falsified as ordered."""

    def __init__(self, publisher: Any, key: str, host: "Host") -> None:
        self._publisher, self._key, self._host = publisher, key, host
        self._falsifier = Falsifier()

    def put(self, data: bytes, *, attachment: bytes | None = None) -> None:
        """Publish ``data``, or what the fault makes of it."""
        host, now_s = self._host, self._host.true_s()
        self._falsifier.keep((data, attachment), now_s=now_s)
        if self._key == CAMERA_IMAGE.key:
            host.mark(FRAME_MARK)
        if host.order.act is None or host.order.key != self._key:
            self._falsifier.calm()
            self._publisher.put(data, attachment=attachment)
            return
        for false, stamp in self._falsifier.falsify(host.order, data, attachment, now_s=now_s):
            self._publisher.put(false, attachment=stamp)
        host.mark(self._key)


class FaultySession:
    """A session of Zenoh whose publishers are faulty ones."""

    def __init__(self, session: Any, host: "Host") -> None:
        self._session, self._host = session, host

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def declare_publisher(self, key: str, **settings: Any) -> FaultyPublisher:
        """A publisher on ``key``, which begins with trepid/<vehicle name>/."""
        publisher = self._session.declare_publisher(key, **settings)
        return FaultyPublisher(publisher, key.split("/", 2)[2], self._host)


class Host:
    """The state of the faults of this process."""

    def __init__(self, options: HostOptions, name: str, true_s: Clock) -> None:
        self.order = Order()
        self.true_s = true_s
        self._file = options.control / f"{name}.json"
        self._renewed = 0
        self._stamp = stamper(true_s)
        self._marks: Any = None

    def now_s(self) -> float:
        """The clock of the process: the true one plus the step of a fault."""
        return self.true_s() + (0.0 if self.order.stamps_only else self.order.clock_step_s)

    def read(self, *_: object) -> None:
        """Take the newest order."""
        self.order = Order.model_validate_json(self._file.read_text(encoding="utf-8"))

    def mark(self, text: str) -> None:
        """Report a message by name."""
        self._marks.put(text.encode(), attachment=self._stamp())

    @contextmanager
    def session(self, opened: Any, vehicle_name: str) -> Iterator[FaultySession]:
        """The session ``opened`` with faulty publishers."""
        with opened as session:
            self._marks = session.declare_publisher(f"trepid/{vehicle_name}/{MARKS}", express=True)
            yield FaultySession(session, self)

    def renewing(self) -> bool:
        """True when the node has to end, in order to start anew."""
        return self.order.renewals > self._renewed

    def renew(self) -> None:
        """The node starts anew."""
        self._renewed = self.order.renewals


def report_applied(owner: type, method: str, send: Callable[[Command], None]) -> None:
    """Send every command that ``owner.method`` returns."""
    original = getattr(owner, method)

    def reporting(*arguments: Any, **named: Any) -> Command | None:
        command: Command | None = original(*arguments, **named)
        if command is not None:
            send(command)
        return command

    setattr(owner, method, reporting)


def silence_bus(host: Host) -> None:
    """Let the frames of the ECU be silent while the order says so."""
    from vehicle.actuators.can.wire import CanWire

    original: Any = CanWire.send

    def send(*arguments: Any) -> None:
        if host.order.act is Act.SILENT:
            host.mark(host.order.key)
        else:
            original(*arguments)

    CanWire.send = send  # type: ignore[method-assign,assignment]


def run(module: Any, me: Process) -> None:
    """Run the process ``module`` until it is to stop, as it does when it is started itself."""
    if not hasattr(module, "node"):
        module.run(me)
        return
    with module.node(me) as node:
        repeat(me, node)


def main() -> None:
    """Run the real module with faulty publishers and a clock that can step."""
    assignment = Assignment.model_validate_json(sys.argv[1])
    given = {
        name: assignment.options[name] for name in HostOptions.model_fields if name in assignment.options
    }
    options = HostOptions.model_validate(given)
    host = Host(options, assignment.name, epoch_clock(assignment.clock_offset_ns))
    opened: Any = trepid.bus.open_session
    patched: Any = trepid.bus
    patched.open_session = lambda **settings: host.session(opened(**settings), assignment.vehicle_name)
    patched = trepid.processes.process
    patched.epoch_clock = lambda _: host.now_s
    signal.signal(signal.SIGUSR1, host.read)
    with process() as me:
        if options.applied == "limiter":
            from controller.limiter import Limiter

            report_applied(Limiter, "step", me.bus.publisher(APPLIED))
        elif options.applied == "ecu":
            from sim_harness.counterparts.ecu import Ecu

            report_applied(Ecu, "command", me.bus.publisher(APPLIED))
            silence_bus(host)
        module = importlib.import_module(options.hosted)
        if "cv2" in sys.modules:
            sys.modules["cv2"].setNumThreads(1)  # as the modules do when they are started themselves
        running = me.running
        me.running = lambda: running() and not host.renewing()  # type: ignore[method-assign]
        while running():
            run(module, me)
            host.renew()


if __name__ == "__main__":
    main()
