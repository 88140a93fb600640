"""The messages of a recording as the nodes of the drive had them, and its camera images in order."""

from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trepid.clock import nanoseconds
from trepid.config import InputError
from trepid.loudness import warn
from trepid.messages import Frame, Steps
from trepid.recording.images import RecordedImages, decode_image, recorded_images
from trepid.recording.notes import PERIOD, Times, number
from trepid.recording.reader import RecordingContent, read_recording
from trepid.recording.scan import Damage, leave_out, saying
from trepid.topics import (
    CAMERA_IMAGE,
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    LOSSES,
    ROAD_USERS,
    STEPS,
    VEHICLE_STATE,
    estimate_topic,
)

READ = (
    *(topic.key for topic in (IMAGE_STATISTICS, LEAD_VEHICLE, DECISION, COMMAND, VEHICLE_STATE, LOSSES)),
    *(ROAD_USERS.key, DIAGNOSTICS.key, STEPS.key, estimate_topic("*").key),
)
HANDED_OVER_S = 5e-3  # between two nodes of one process a message is used this long before its publication
KEPT_FRAMES = 64  # images in memory; two nodes may step on images of different age at one instant


class TopicTape:
    """The messages of one topic in order of publication."""

    def __init__(self, recorded: list[tuple[float, Any]], times: Times) -> None:
        self.recorded_s = [at_s for at_s, _ in recorded]
        self.recorded = [message for _, message in recorded]
        self.published_s = [times.node_s(at_s) for at_s, _ in recorded]
        self.messages = list(map(times.of_node, self.recorded))

    def index_published_at(self, at_s: float) -> int | None:
        """Place of the message that was published at ``at_s``; None when it was not recorded."""
        place = bisect_left(self.published_s, at_s)
        found = place < len(self.published_s) and self.published_s[place] - at_s < HANDED_OVER_S
        return place if found else None

    def newest(self, by_s: float, *, before: bool = False) -> int | None:
        """Place of the last message published by ``by_s``, or ``before`` it; None without one."""
        place = (bisect_left if before else bisect_right)(self.published_s, by_s) - 1
        return place if place >= 0 else None


class Tape:
    """A recording for :mod:`cockpit.replay.rerun`."""

    def __init__(self, path: Path, *, said: bool = False) -> None:
        """``said``: another process says what the file lacks.

        Raises InputError when ``path`` is no recording of a supervisor or controller.
        """
        self.path = path
        self.damage = leave_out if said else saying(path)
        self.recorded: RecordingContent = read_recording(path, *READ, damage=self.damage)
        if not {DECISION.key, COMMAND.key} & self.recorded.messages.keys():
            raise InputError(f"{path}: holds no decision and no command: there is nothing to run again")
        if not self.recorded.complete and not said:
            warn(f"trepid: {path}: cut short; run again up to its last whole chunk")
        self.notes = self.recorded.notes
        period_s = number(self.notes, PERIOD)
        self.is_lockstep = period_s is not None
        self.zero_s = self.recorded.first_s if self.recorded.began_s is None else self.recorded.began_s
        self.times = Times(began_s=self.zero_s, period_s=period_s)
        self._tracks: dict[str, TopicTape] = {}

    def track(self, key: str) -> TopicTape:
        """The messages on ``key``."""
        if key not in self._tracks:
            self._tracks[key] = TopicTape(self.recorded.messages.get(key, []), self.times)
        return self._tracks[key]

    def reports(self, output: str) -> list[Steps]:
        """The reports of the node that publishes ``output`` on its steps, in order."""
        return [report for _, report in self.recorded.of(STEPS) if output in report.outputs]

    @cached_property
    def images(self) -> RecordedImages | None:
        """The images of the camera: raw ones, else compressed ones; None without any."""
        return recorded_images(self.path)

    @property
    def has_raw_images(self) -> bool:
        """Whether the recording holds the very images that the estimators got."""
        return self.images is not None and self.images.topic is CAMERA_IMAGE


class Frames:
    """The camera images of a recording one after the other; only the last KEPT_FRAMES stay in memory."""

    def __init__(self, tape: Tape) -> None:
        self._times = tape.times
        self._coming = self._read(tape.images, tape.damage)
        self._kept: OrderedDict[int, Frame] = OrderedDict()
        self._read_s = -np.inf

    def of(self, t_s: float, *, by_s: float) -> Frame | None:
        """The frame captured at ``t_s`` (time of the nodes), looked for up to those published at ``by_s``."""
        wanted = nanoseconds(t_s)
        while wanted not in self._kept and self._read_s <= by_s:
            at_s, frame = next(self._coming, (np.inf, None))
            self._read_s = at_s
            if frame is not None:
                self._kept[nanoseconds(frame.t_s)] = frame
            if len(self._kept) > KEPT_FRAMES:
                self._kept.popitem(last=False)
        return self._kept.get(wanted)

    def _read(self, images: RecordedImages | None, damage: Damage) -> Iterator[tuple[float, Frame | None]]:
        for at_s, message in images.messages(damage) if images is not None else ():
            moved = self._times.of_node(message)
            image = decode_image(moved)
            yield self._times.node_s(at_s), None if image is None else Frame(t_s=moved.t_s, image=image)
