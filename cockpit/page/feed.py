"""The messages of a drive that the page shows.

A ring of Zenoh holds the newest message of each topic. With a viewer the page subscribes to all of them. Without
one it subscribes to the reports of the processes, and once a second for a moment to decision, vehicle state and
pose, for the timelines and the driven path: hundreds of messages a second would cost more than the page itself.

Pictures are JPEG images from the camera process, which makes them for the recorder anyway, so that nothing is
encoded for the page. A camera that publishes no JPEG is read raw.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from trepid.bus import Bus, Tap
from trepid.messages import CompressedFrame, Decision, Diagnostic, Frame, SteeringEstimate, Timing
from trepid.processes.settings import LAUNCHER
from trepid.processes.timing import APPLIES
from trepid.topics import (
    CAMERA_COMPRESSED,
    CAMERA_IMAGE,
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    LEAD_VEHICLE,
    ROAD_USERS,
    SIM_TRUTH,
    TIMING,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)
from trepid.wire import WireError, from_cdr

M = TypeVar("M")
REMEMBERED = 12  # estimates and decisions, for pictures that come later


class WatchedTopic(Generic[M]):
    """The newest message of a topic, as long as it is subscribed to."""

    def __init__(self, bus: Bus, topic: Topic[M]) -> None:
        self._bus, self._topic = bus, topic
        self._tap: Tap | None = None
        self.message: M | None = None
        """The newest message taken so far; None before the first."""

    @property
    def watching(self) -> bool:
        """Whether the topic is subscribed to."""
        return self._tap is not None

    def watch(self, on: bool) -> None:
        """Subscribe, or end the subscription."""
        if on and self._tap is None:
            self._tap = self._bus.tap(self._topic.key, kept=1)
        elif not on and self._tap is not None:
            self._tap.close()
            self._tap = None

    def take(self) -> M | None:
        """The message if one arrived since the last call, else None; a malformed one counts as none."""
        new: M | None = None
        for _, data, _ in self._tap.drain() if self._tap is not None else ():
            try:
                new = self.message = from_cdr(data, self._topic.type)
            except WireError:
                continue  # counted by the processes that drive by it
        return new

    def refresh(self) -> M | None:
        """The newest message, new or not; None before the first."""
        self.take()
        return self.message


class Feed:
    """The newest message of each topic, and the newest few where they belong to pictures."""

    def __init__(self, bus: Bus, estimators: Sequence[str], *, jpeg: bool = True) -> None:
        """``jpeg``: the camera publishes compressed pictures too."""
        self._pictures: WatchedTopic[Any] = WatchedTopic(bus, CAMERA_COMPRESSED if jpeg else CAMERA_IMAGE)
        self._diagnostics, self._timing = bus.stream(DIAGNOSTICS), bus.stream(TIMING)
        self._decision = WatchedTopic(bus, DECISION)
        self._estimates = {name: WatchedTopic(bus, estimate_topic(name)) for name in estimators}
        self.state, self.truth = WatchedTopic(bus, VEHICLE_STATE), WatchedTopic(bus, SIM_TRUTH)
        self.lead, self.road_users = WatchedTopic(bus, LEAD_VEHICLE), WatchedTopic(bus, ROAD_USERS)
        self.command = WatchedTopic(bus, COMMAND)
        self._drive = (self._decision, self.state, self.truth)  # what timelines and path need
        self._shown = (
            self._pictures,
            self.lead,
            self.road_users,
            self.command,
            *self._estimates.values(),
        )  # what only a viewer needs
        self.decisions: deque[Decision] = deque(maxlen=REMEMBERED)
        self.estimates: dict[str, deque[SteeringEstimate]] = {
            name: deque(maxlen=REMEMBERED) for name in estimators
        }
        self.picture: CompressedFrame | None = None
        self.beats: dict[str, Diagnostic] = {}
        """Newest heartbeat by process, the report of the launcher among them."""
        self.applied: Timing | None = None
        """Newest report of the vehicle process: when it applied the frames of the second before."""

    @property
    def looking(self) -> bool:
        """True while pictures are subscribed to."""
        return self._pictures.watching

    @property
    def glimpsing(self) -> bool:
        """True while decision, state and pose are subscribed to."""
        return self._decision.watching

    def look(self, at: bool) -> None:
        """Subscribe to everything for a viewer, or end it."""
        if at is self.looking:
            return
        for watched in self._shown:
            watched.watch(at)
        self.glimpse(at)
        if not at:
            self.picture = None

    def glimpse(self, at: bool) -> None:
        """Subscribe to decision, state and pose, or end it."""
        for watched in self._drive:
            watched.watch(at)

    def poll(self) -> None:
        """Take what has arrived."""
        for beat, _ in self._diagnostics.drain():
            self.beats[beat.process] = beat
        for timing, _ in self._timing.drain():
            if timing.process == APPLIES:
                self.applied = timing
        _take(self._decision, self.decisions)
        for name, watched in self._estimates.items():
            _take(watched, self.estimates[name])
        picture = self._pictures.take()
        if picture is not None:
            self.picture = _compress(picture) if isinstance(picture, Frame) else picture

    @property
    def decision(self) -> Decision | None:
        """The newest decision."""
        return self.decisions[-1] if self.decisions else None

    @property
    def report(self) -> Diagnostic | None:
        """The newest report of the launcher."""
        return self.beats.get(LAUNCHER)


def _take(watched: WatchedTopic[M], into: deque[M]) -> None:
    message = watched.take()
    if message is not None:
        into.append(message)


def _compress(frame: Frame) -> CompressedFrame:
    from trepid.images.jpeg import encode_jpeg  # a camera that publishes JPEG needs no encoder here

    return encode_jpeg(frame)
