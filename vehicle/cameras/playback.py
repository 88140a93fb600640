"""Frames of recordings, played at their own pace.

A frame with the stamp s of a recording that began at s₀ is captured at t = t₀ + (s − s₀)/pace, where t₀ is the time
of the first reading. It is not handed out before t; of several that are due, only the newest is decoded.
"""

import itertools
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field

from trepid import config
from trepid.clock import Clock
from trepid.config import InputError, car_folder
from trepid.messages import Frame
from trepid.types import Image, NonNegative
from vehicle.cameras.source import Values


class UndecodedFrame(NamedTuple):
    """A frame of a recording that is not decoded yet."""

    t_s: float  # its own stamp
    decode: Callable[[], Image]  # raises InputError


class PlaybackSettings(config.Settings):
    """Settings of every recording."""

    path: Annotated[str, Field(min_length=1)]
    pace: NonNegative = 1.0  # recorded seconds per second; 0: frame by frame as they are read, stamped then
    loop: bool = False


def recording_path(path: str) -> Path:
    """The file or folder at ``path``: in the folder of the car if it is there, else from the working folder."""
    own, car = Path(path).expanduser(), car_folder()
    return car / own if car is not None and (car / own).exists() else own


class Playback:
    """A camera source over a recording."""

    def __init__(
        self,
        shots: Callable[[], Iterator[UndecodedFrame]],
        *,
        now_s: Clock,
        pace: float,
        loop: bool,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """``shots``: begins the recording anew. Raises InputError when it has no frame."""
        self._shots, self._now_s, self._pace, self._loop, self._sleep = shots, now_s, pace, loop, sleep
        self._timed = self._times()
        self._dropped = self._malformed = self._older = 0
        self.trouble = ""
        self._next = next(self._timed, None)
        if self._next is None:
            raise InputError("holds no frame")
        self._start_s: float | None = None

    @property
    def ended(self) -> bool:
        """True after the last frame."""
        return self._next is None

    def values(self) -> Values:
        """Origin of the stamps, and numbers of frames.

        They were due before they were read, are older than the one before them, or cannot be decoded.
        """
        return (
            ("stamped_by", "recording" if self._pace else "reading"),
            ("dropped_frames", str(self._dropped)),
            ("older_frames", str(self._older)),
            ("malformed_images", str(self._malformed)),
        )

    def close(self) -> None:
        """Close the recording."""
        self._timed.close()
        self._next = None

    def read(self, *, timeout_s: float) -> Frame | None:
        """The newest frame that is due; None when none is within ``timeout_s``."""
        if self._next is None:
            return None
        now_s = self._now_s()
        if self._start_s is None:
            self._start_s = now_s
        if not self._pace:
            shot, t_s = self._next, now_s
            self._next = next(self._timed, None)
            return self._frame(shot, t_s)
        wait_s = self._due_s(self._next) - now_s
        if wait_s > timeout_s:
            self._sleep(timeout_s)
            return None
        if wait_s > 0:
            self._sleep(wait_s)
        now_s = max(self._now_s(), self._due_s(self._next))
        shot = self._next
        self._next = next(self._timed, None)
        while self._next is not None and self._due_s(self._next) <= now_s:
            self._dropped += 1
            shot, self._next = self._next, next(self._timed, None)
        return self._frame(shot, self._due_s(shot))

    def _due_s(self, shot: UndecodedFrame) -> float:
        assert self._start_s is not None
        return self._start_s + shot.t_s / self._pace

    def _frame(self, shot: UndecodedFrame, t_s: float) -> Frame | None:
        """The decoded frame; None, and a trouble, for one that cannot be decoded."""
        try:
            image = shot.decode()
        except InputError as error:
            self._malformed += 1
            self.trouble = str(error)
            return None
        self.trouble = "" if self._next is not None else "the recording has ended"
        return Frame(t_s=t_s, image=image)

    def _times(self) -> Generator[UndecodedFrame]:
        """The shots with times from 0 on; repeated without end in a loop. Shots with older stamps are left out."""
        begin_s = 0.0
        for _ in itertools.count() if self._loop else range(1):
            first_s = last_s = gap_s = None
            for shot in self._shots():
                if last_s is not None and shot.t_s <= last_s:
                    self._older += 1
                    continue
                first_s = shot.t_s if first_s is None else first_s
                gap_s = None if last_s is None else shot.t_s - last_s
                last_s = shot.t_s
                yield shot._replace(t_s=begin_s + shot.t_s - first_s)
            if first_s is None or last_s is None:
                return
            begin_s += last_s - first_s + (gap_s or 0.04)
