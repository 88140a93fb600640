"""Viewers of the page: each gets the newest state, never a queue of old ones.

A viewer acknowledges what it has drawn, and gets the next message only then. A slow viewer, or one in a
hidden tab, gets fewer messages and no older ones. A viewer without an acknowledgement for AWAY_S counts as absent;
while all viewers are absent the page receives no pictures, and a glimpse of the drive once a second.
"""

import asyncio
import json
import math
import struct
import time
from typing import Any

from cockpit.page.feed import Feed
from cockpit.page.stop import REPEAT_S, StopSender
from cockpit.page.view import PageView
from trepid.clock import Clock
from trepid.messages import CompressedFrame

MAX_VIEWERS = 8
LOOKING_PERIOD_S, IDLE_PERIOD_S = 0.02, 0.47  # between two turns
GLIMPSE_S = 0.08  # length of a glimpse, in which each topic has a new message
GLIMPSE_AFTER_S = 0.85  # from the end of a glimpse to the next one
PICTURE_S = 0.075  # at least, between two messages to a viewer; of a faster camera the newest picture is sent
UPDATE_S = 0.1  # without a new picture the numbers are sent as often
DECISION_S = 0.04  # a picture waits this long for the decision on its frame
AWAY_S = 3.0
HEADER = struct.Struct(">I")


class Viewer:
    """What one viewer has, and what it is to get next."""

    def __init__(self) -> None:
        self.samples = self.points = 0  # of the timelines and the path, that it has
        self.thinned = -1
        self.ready = True
        self.seen_s = time.monotonic()
        self.next: bytes | None = None
        self.arrived = asyncio.Event()

    def acknowledge(self) -> None:
        """The viewer has drawn the last message."""
        self.ready, self.seen_s = True, time.monotonic()

    async def message(self) -> bytes:
        """The next message for this viewer."""
        await self.arrived.wait()
        self.arrived.clear()
        assert self.next is not None
        return self.next

    @property
    def looks(self) -> bool:
        """The viewer has acknowledged something not long ago."""
        return time.monotonic() - self.seen_s < AWAY_S


class Hub:
    """Turns the messages of a feed into messages for viewers."""

    def __init__(self, feed: Feed, view: PageView, stop: StopSender, clock: Clock) -> None:
        self._feed, self._view, self._stop, self._clock = feed, view, stop, clock
        self.viewers: set[Viewer] = set()
        self.wanted = asyncio.Event()
        """A viewer has come, or a button was pressed: the next turn is due."""
        self._picture: tuple[CompressedFrame, float] | None = (
            None  # one that is not sent yet, and its arrival
        )
        self._sent_s = 0.0
        self._glimpsed_s = -math.inf

    def turn(self) -> float:
        """Read, sample and send what is due; the time until the next turn [s]."""
        now_s, looking = self._clock(), any(viewer.looks for viewer in self.viewers)
        self._feed.look(looking)
        self._feed.poll()
        pause_s = self._look(now_s) if looking else self._glimpse(now_s)
        self._stop.turn(self._view.hold(now_s))
        if self._feed.picture is not None:
            self._picture, self._feed.picture = (self._feed.picture, now_s), None
        if looking and self._due(now_s) and any(viewer.ready for viewer in self.viewers):
            self._send(now_s)
        return min(pause_s, REPEAT_S) if self._stop.waiting else pause_s

    def _look(self, now_s: float) -> float:
        """Sample for a viewer; the time until the next turn [s]."""
        self._view.sample(now_s)
        return LOOKING_PERIOD_S

    def _glimpse(self, now_s: float) -> float:
        """Without a viewer: begin a glimpse that is due, or sample and end it; the time until the next turn [s]."""
        if self._feed.glimpsing:
            self._view.sample(now_s)
            self._feed.glimpse(False)
            self._glimpsed_s = now_s
        elif now_s - self._glimpsed_s >= GLIMPSE_AFTER_S:
            self._feed.glimpse(True)
            return GLIMPSE_S
        return IDLE_PERIOD_S

    def _due(self, now_s: float) -> bool:
        if now_s - self._sent_s < PICTURE_S:
            return False
        if self._picture is None:
            return now_s - self._sent_s >= UPDATE_S
        picture, arrived_s = self._picture
        decision = self._view.decision_of(picture)
        complete = decision is not None and decision.t_s == picture.t_s
        return complete or now_s - arrived_s >= DECISION_S

    def _send(self, now_s: float) -> None:
        state, jpeg = self._view.state(now_s), b""
        state |= {"stopping": self._stop.pending, "stop_undelivered": self._stop.is_undelivered}
        if self._picture is not None:
            picture, _ = self._picture
            jpeg, self._picture = picture.jpeg, None
            age_ms = round(1e3 * (now_s - picture.t_s), 1)
            state["picture"] = {"t": picture.t_s, "age_ms": age_ms, **self._view.overlay_of(picture)}
        for viewer in self.viewers:
            if viewer.ready:
                viewer.next = pack_state({**state, **self._further(viewer)}, jpeg)
                viewer.ready = False
                viewer.arrived.set()
        self._sent_s = now_s

    def _further(self, viewer: Viewer) -> dict[str, Any]:
        """Samples and points that the viewer does not have."""
        timelines, track = self._view.timelines, self._view.track
        anew, points = track.since(viewer.thinned, viewer.points)
        found = {
            "series": timelines.names,
            "samples": timelines.since(viewer.samples),
            "track": {"anew": anew, "points": points},
        }
        viewer.samples, viewer.points, viewer.thinned = timelines.count, track.count, track.thinned
        return found


def pack_state(state: dict[str, Any], jpeg: bytes) -> bytes:
    """Length of the JSON, the JSON, the JPEG; a number that is not finite is null, as one that is absent."""
    text = json.dumps(_finite(state), separators=(",", ":"), allow_nan=False).encode()
    return HEADER.pack(len(text)) + text + jpeg


def _finite(value: Any) -> Any:
    """``value`` with None in place of NaN and infinity, in dictionaries and lists too."""
    match value:
        case dict():
            return {key: _finite(one) for key, one in value.items()}
        case list() | tuple():
            return [_finite(one) for one in value]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
