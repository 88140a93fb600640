"""A recorded drive on one time base: the newest message of each topic at any time, and its camera images."""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from trepid.clock import nanoseconds, seconds
from trepid.config import InputError
from trepid.messages import CompressedFrame, SteeringEstimate
from trepid.recording.images import decode_image, recorded_images
from trepid.recording.reader import read_recording
from trepid.recording.scan import CUT_SHORT, saying
from trepid.topics import (
    COMMAND,
    DECISION,
    LEAD_VEHICLE,
    ROAD_USERS,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)
from trepid.types import Image

M = TypeVar("M")
KEYS = (
    *(topic.key for topic in (DECISION, COMMAND, VEHICLE_STATE, LEAD_VEHICLE, ROAD_USERS)),
    estimate_topic("*").key,
)
STALE_S = 0.5
"""An older message counts as missing: a node that has ended has no present value."""
OLDEST_S, CLOCKS_S = 10.0, 0.1
"""The capture time of an image or estimate is possible from OLDEST_S before its arrival to CLOCKS_S after it, by
which the clocks of two machines may differ."""


def is_possible(t_s: float, at_s: float) -> bool:
    """Whether a message that arrived at ``at_s`` can be of a frame captured at ``t_s``."""
    return -CLOCKS_S <= at_s - t_s <= OLDEST_S


class Drive:
    """The messages of a recording, without its images. Times are those of the recorder [s]."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when ``path`` is no recording, or holds neither an image nor an estimate."""
        self.path = path
        self.recorded = read_recording(path, *KEYS)
        self.lost = dict(self.recorded.lost)
        """Corrupted part of the file -> number of messages in it that are not exported; 0: unknown."""
        self._arrived_s = {
            key: [at_s for at_s, _ in messages] for key, messages in self.recorded.messages.items()
        }
        self._images = recorded_images(path)
        if not self.frames_s:
            why = " with a possible capture time" if self.impossible else ""
            raise InputError(
                f"{path}: holds no camera image and no estimate of Trepid{why}: nothing to export"
            )

    @property
    def zero_s(self) -> float:
        """The time that is exported as 0: the start of the drive, else the first message."""
        return self.recorded.first_s if self.recorded.began_s is None else self.recorded.began_s

    @cached_property
    def estimators(self) -> list[str]:
        """Names of the estimators with a message, in alphabetical order."""
        return sorted(key.split("/")[1] for key in self.recorded.messages if key.endswith("/estimate"))

    @cached_property
    def image_s(self) -> list[float]:
        """Capture times of the recorded images in the order of the file, without impossible ones."""
        return [t_s for t_s, at_s in self._image_times if is_possible(t_s, at_s)]

    @cached_property
    def _image_times(self) -> list[tuple[float, float]]:
        """Capture and arrival of every recorded image."""
        messages = () if self._images is None else self._images.messages(self._lose_images)
        return [(message.t_s, at_s) for at_s, message in messages]

    def _lose_images(self, what: str, images: int) -> None:
        if what != CUT_SHORT:
            self.lost[what] = self.lost.get(what, 0) + images
        saying(self.path)(what, images)

    @cached_property
    def frames_s(self) -> list[float]:
        """Capture times of all camera frames: those recorded, and those that an estimate goes back to.

        Impossible ones are left out.
        """
        stamps = {nanoseconds(t_s) for t_s in self.image_s}
        for name in self.estimators:
            estimates = self.recorded.of(estimate_topic(name))
            stamps |= {nanoseconds(one.t_s) for at_s, one in estimates if is_possible(one.t_s, at_s)}
        return [seconds(stamp) for stamp in sorted(stamps)]

    @cached_property
    def impossible(self) -> dict[str, int]:
        """Number of images and estimates with an impossible capture time, by topic."""
        topics = [estimate_topic(name) for name in self.estimators]
        times = {topic.key: [(one.t_s, at_s) for at_s, one in self.recorded.of(topic)] for topic in topics}
        if self._images is not None:
            times[self._images.topic.key] = self._image_times
        counts = {key: sum(not is_possible(*both) for both in of_topic) for key, of_topic in times.items()}
        return {key: count for key, count in counts.items() if count}

    def newest(self, topic: Topic[M], at_s: float) -> M | None:
        """The last message of ``topic`` that arrived by ``at_s``; None without one, or older than STALE_S."""
        arrived_s = self._arrived_s.get(topic.key, [])
        place = bisect_right(arrived_s, at_s) - 1
        if place < 0 or at_s - arrived_s[place] > STALE_S:
            return None
        return self.recorded.of(topic)[place][1]

    def from_frame(self, topic: Topic[M], t_s: float) -> M | None:
        """The first message of ``topic`` that goes back to the frame captured at ``t_s``; None without one."""
        return self._of_frame(topic).get(nanoseconds(t_s))

    def estimates_from(self, t_s: float) -> dict[str, SteeringEstimate]:
        """The estimates from the frame captured at ``t_s``."""
        found = {name: self.from_frame(estimate_topic(name), t_s) for name in self.estimators}
        return {name: estimate for name, estimate in found.items() if estimate is not None}

    def images(self) -> Iterator[tuple[float, Image, bytes | None]]:
        """Capture time, image and, where it was recorded as JPEG, its bytes; in the order of the file.

        Images with an impossible capture time are left out. Raises InputError for an image that cannot be decoded.
        """
        for at_s, message in () if self._images is None else self._images.messages():
            if not is_possible(message.t_s, at_s):
                continue
            image = decode_image(message)
            if image is None:
                raise InputError(f"{self.path}: the image of {message.t_s:.3f} s cannot be decoded")
            yield message.t_s, image, message.jpeg if isinstance(message, CompressedFrame) else None

    def _of_frame(self, topic: Topic[M]) -> dict[int, M]:
        if topic.key not in self._by_frame:
            stamped = ((getattr(one, "t_s", None), one) for _, one in reversed(self.recorded.of(topic)))
            self._by_frame[topic.key] = {nanoseconds(t_s): one for t_s, one in stamped if t_s is not None}
        return self._by_frame[topic.key]

    @cached_property
    def _by_frame(self) -> dict[str, dict[int, Any]]:
        return {}
