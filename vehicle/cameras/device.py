"""A live device, read on a thread of its own: a call that hangs stops the thread, never the process.

The thread opens the device, grabs frame after frame and keeps the newest. After an error it closes the device and
opens it again until that succeeds: a camera that was unplugged continues when it is plugged in. A thread that hangs
inside the device longer than ``hang_s`` is reported and given up; another one opens the device. The old thread
releases its handle as soon as the call returns.

The time of capture is that of the driver where it states one (:class:`CaptureStamps`).
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

import cv2
import numpy as np

from trepid import config
from trepid.clock import Clock
from trepid.config import InputError
from trepid.messages import Frame
from trepid.types import Image, Positive
from vehicle.cameras.source import Values

MAX_AGE_S = 1.0  # of the first frames; a larger one means that the device counts on another clock


class CaptureStamps:
    """Times of capture by the stamps of the kernel where these are plausible, else by the return of the grab.

    V4L2 stamps a buffer on CLOCK_MONOTONIC (linux/videodev2.h, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC); OpenCV returns
    the stamp as CAP_PROP_POS_MSEC. With the age a = grabbed − stamped the frame was captured at t = now − a. A
    stamp is plausible if it is later than the one before it and 0 ≤ a < 1 s. After a plausible one, a may be
    larger: then the buffer waited while the process stood still, and its image is old indeed.
    """

    def __init__(self) -> None:
        self._kernel_s = -math.inf
        self._last_s = -math.inf
        self._trusted = False
        self.origin = "none yet"
        """Where the newest time comes from: "kernel" or "grab"."""

    def stamp(self, kernel_s: float, *, grabbed_s: float, now_s: float) -> float | None:
        """The time of capture [s] on the clock of ``now_s``; None when it does not follow the one before it.

        ``kernel_s``: stamp of the device, ``grabbed_s``: return of the grab, both on CLOCK_MONOTONIC.
        """
        age_s = grabbed_s - kernel_s
        limit_s = math.inf if self._trusted else MAX_AGE_S
        plausible = kernel_s > max(self._kernel_s, 0.0) and 0 <= age_s < limit_s
        self._trusted = self._trusted or plausible
        self.origin = "kernel" if plausible else "grab"
        if plausible:
            self._kernel_s = kernel_s
        t_s = now_s - age_s if plausible else now_s
        if t_s <= self._last_s:
            return None
        self._last_s = t_s
        return t_s


T = TypeVar("T")
MAX_HANGING = 3  # threads; then no further one is started until one of them returns


class Capture(Protocol):
    """An open device, as ``cv2.VideoCapture``."""

    def grab(self) -> bool:
        """Wait for the next frame; False when the device fails."""
        ...

    def retrieve(self) -> tuple[bool, Image]:
        """Decode the grabbed frame."""
        ...

    def get(self, propId: int) -> float:
        """The value of a property."""
        ...

    def release(self) -> None:
        """Close the device."""
        ...


Opener = Callable[[], Capture]
"""Opens the device. Raises OSError with the reason."""


class DeviceSettings(config.Settings):
    """Settings of every live device."""

    hang_s: Positive = 1.0  # inside the device; after it the device is opened again
    reopen_s: Positive = 0.5  # between two attempts


class _Reader:
    """One thread, and what it has come to."""

    def __init__(self) -> None:
        self.given_up = False
        self.inside_since_s: float | None = None  # begin of the call into the device; None outside
        self.ended = False
        self.thread: threading.Thread | None = None


class Device:
    """A camera source over a device."""

    ended = False

    def __init__(
        self,
        opener: Opener,
        settings: DeviceSettings,
        *,
        now_s: Clock,
        kernel_stamps: bool,
        open_s: float = 10.0,
        monotonic_s: Clock = time.monotonic,
    ) -> None:
        """Open the device. Raises InputError when this fails or takes longer than ``open_s``.

        ``kernel_stamps``: CAP_PROP_POS_MSEC of the device is the time of capture on CLOCK_MONOTONIC.
        """
        self._opener, self._now_s, self._monotonic_s = opener, now_s, monotonic_s
        self._hang_s, self._reopen_s = settings.hang_s, settings.reopen_s
        self._kernel_stamps = kernel_stamps
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._newest: Frame | None = None
        self._stamps = CaptureStamps()
        self._opened = 0  # times
        self._hung = 0  # times
        self._hanging: list[_Reader] = []
        self._trouble = ""
        self._reader = self._start_reader()
        with self._changed:
            answered = self._changed.wait_for(lambda: self._opened or self._trouble, open_s)
        if not self._opened:
            reason = self._trouble if answered else f"it does not answer within {open_s:g} s"
            self.close()
            raise InputError(reason)

    @property
    def trouble(self) -> str:
        """Why frames are absent; "" while the device works."""
        return self._trouble

    def values(self) -> Values:
        """Origin of the stamps, and how often the device was opened again and hung."""
        return (
            ("stamped_by", self._stamps.origin),
            ("reopened", str(max(0, self._opened - 1))),
            ("hung", str(self._hung)),
        )

    def read(self, *, timeout_s: float) -> Frame | None:
        """The newest frame since the last call; None when there is none within ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None, timeout_s)
            frame, self._newest = self._newest, None
            if frame is None:
                self._replace_hanging()
            return frame

    def close(self) -> None:
        """End the thread; the device is released by it, at once or when its call returns."""
        self._closing.set()
        with self._changed:
            self._reader.given_up = True
        if self._reader.thread is not None:
            self._reader.thread.join(timeout=self._hang_s)

    def _replace_hanging(self) -> None:
        """Give up a thread that hangs. The lock is held."""
        since_s = self._reader.inside_since_s
        if since_s is None or self._monotonic_s() - since_s < self._hang_s:
            return
        self._hanging = [reader for reader in self._hanging if not reader.ended]
        self._trouble = f"the device does not answer for {self._monotonic_s() - since_s:.1f} s"
        if len(self._hanging) < MAX_HANGING:
            self._hung += 1
            self._reader.given_up = True
            self._hanging.append(self._reader)
            self._reader = self._start_reader()

    def _start_reader(self) -> _Reader:
        reader = _Reader()
        reader.thread = threading.Thread(target=self._run, args=(reader,), name="camera", daemon=True)
        reader.thread.start()
        return reader

    def _run(self, reader: _Reader) -> None:
        """Open and read the device again and again until the reader is given up."""
        try:
            while not reader.given_up:
                try:
                    reason = self._one_opening(reader)
                except Exception as error:  # noqa: BLE001 - any fault of the driver; it is reported
                    reason = _reason(error)
                with self._changed:
                    if reader.given_up:
                        break
                    self._trouble = reason
                    self._changed.notify_all()
                self._closing.wait(self._reopen_s)
        finally:
            reader.ended = True

    def _one_opening(self, reader: _Reader) -> str:
        """Open the device and read it until it fails; the reason of the end. Raises what the device raises."""
        capture: Capture | None = None
        try:
            capture = self._inside(reader, self._opener)
            with self._changed:
                if reader.given_up:
                    return ""
                self._opened += 1
                self._changed.notify_all()
            while not reader.given_up:
                if not self._inside(reader, capture.grab):
                    return "the device gives no frame: unplugged, or used by another program"
                self._keep(reader, capture)
        finally:
            if capture is not None:
                self._inside(reader, capture.release)
        return ""

    def _inside(self, reader: _Reader, call: Callable[[], T]) -> T:
        reader.inside_since_s = self._monotonic_s()
        try:
            return call()
        finally:
            reader.inside_since_s = None

    def _keep(self, reader: _Reader, capture: Capture) -> None:
        """Stamp and decode the grabbed frame."""
        grabbed_s, now_s = self._monotonic_s(), self._now_s()
        kernel_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC) if self._kernel_stamps else 0.0
        good, image = self._inside(reader, capture.retrieve)
        with self._changed:
            if reader.given_up:
                return
            if not good:
                self._trouble = "the frames of the device cannot be decoded"
                return
            t_s = self._stamps.stamp(kernel_s, grabbed_s=grabbed_s, now_s=now_s)
            if t_s is None:
                return
            self._trouble = ""
            self._newest = Frame(t_s=t_s, image=np.asarray(image))
            self._changed.notify_all()


def _reason(error: Exception) -> str:
    """The text of an error of the device in one line, with its type where that is not usual or has no text."""
    text = " ".join(str(error).split())
    usual = isinstance(error, OSError | cv2.error) and text
    return text if usual else f"{type(error).__name__} {text}".strip()
