"""The messages of a drive that the page shows.

A ring of Zenoh holds the newest small messages of each topic. The page subscribes to pictures only with a viewer:
these are JPEG images from the camera process, which makes them for the recorder anyway, so that nothing is encoded
for the page. A camera that publishes no JPEG is read raw.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeVar

from trepid.bus import Bus, Tap
from trepid.messages import CompressedFrame, Decision, Diagnostic, Frame, SteeringEstimate, Timing
from trepid.processes.settings import LAUNCHER
from trepid.processes.timing import APPLIES
from trepid.topics import (
    CAMERA_COMPRESSED,
    CAMERA_IMAGE,
    DECISION,
    DIAGNOSTICS,
    LEAD_VEHICLE,
    SIM_TRUTH,
    TIMING,
    VEHICLE_STATE,
    estimate_topic,
)
from trepid.wire import WireError, from_cdr

M = TypeVar("M")
REMEMBERED = 12  # estimates and decisions, for pictures that come later


class Feed:
    """The newest message of each topic, and the newest few where they belong to pictures."""

    def __init__(self, bus: Bus, estimators: Sequence[str], *, jpeg: bool = True) -> None:
        """``jpeg``: the camera publishes compressed pictures too."""
        self._bus = bus
        self._picture_topic = CAMERA_COMPRESSED if jpeg else CAMERA_IMAGE
        self._tap: Tap | None = None
        self._diagnostics, self._timing = bus.stream(DIAGNOSTICS), bus.stream(TIMING)
        self._decision = bus.latest(DECISION, wakes=False)
        self._estimates = {name: bus.latest(estimate_topic(name), wakes=False) for name in estimators}
        self.state = bus.latest(VEHICLE_STATE, wakes=False)
        self.truth = bus.latest(SIM_TRUTH, wakes=False)
        self.lead = bus.latest(LEAD_VEHICLE, wakes=False)
        self.decisions: deque[Decision] = deque(maxlen=REMEMBERED)
        self.estimates: dict[str, deque[SteeringEstimate]] = {
            name: deque(maxlen=REMEMBERED) for name in estimators
        }
        self.picture: CompressedFrame | None = None
        self.beats: dict[str, Diagnostic] = {}
        """Newest heartbeat by process, the report of the launcher among them."""
        self.latency_ms: list[float] = []
        """From the capture of a frame to its command at the actuator, of the frames of the last second."""

    @property
    def looking(self) -> bool:
        """True while pictures are subscribed to."""
        return self._tap is not None

    def look(self, at: bool) -> None:
        """Subscribe to pictures, or end it."""
        if at and self._tap is None:
            self._tap = self._bus.tap(self._picture_topic.key, kept=1)
        elif not at and self._tap is not None:
            self._tap.close()
            self._tap = self.picture = None

    def poll(self) -> None:
        """Take what has arrived."""
        for beat, _ in self._diagnostics.drain():
            self.beats[beat.process] = beat
        for timing, _ in self._timing.drain():
            if timing.process == APPLIES:
                self.latency_ms = _latencies_ms(timing)
        _take(self._decision.take, self.decisions)
        for name, latest in self._estimates.items():
            _take(latest.take, self.estimates[name])
        for _, data, _ in self._tap.drain() if self._tap is not None else ():
            self._show(data)

    @property
    def decision(self) -> Decision | None:
        """The newest decision."""
        return self.decisions[-1] if self.decisions else None

    @property
    def report(self) -> Diagnostic | None:
        """The newest report of the launcher."""
        return self.beats.get(LAUNCHER)

    def _show(self, data: bytes) -> None:
        try:
            message = from_cdr(data, self._picture_topic.type)
        except WireError:
            return  # counted by the processes that drive by it
        self.picture = _compressed(message) if isinstance(message, Frame) else message


def _take(take: Callable[[], M | None], into: deque[M]) -> None:
    message = take()
    if message is not None:
        into.append(message)


def _latencies_ms(timing: Timing) -> list[float]:
    return [1e3 * (sent - frame) for frame, sent in zip(timing.frame_s, timing.sent_s, strict=True)]


def _compressed(frame: Frame) -> CompressedFrame:
    from trepid.images.jpeg import encoded  # a camera that publishes JPEG needs no encoder here

    return encoded(frame)
