"""Counterparts of camera sources: a clock, files with numbered frames, and a device that fails on command."""

import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from vehicle.cameras.source import SourceContext

SIZE = (64, 48)


class ManualClock:
    """A clock that advances by sleeping and by assignment only."""

    def __init__(self, t_s: float = 1000.0) -> None:
        self.t_s = t_s

    def __call__(self) -> float:
        return self.t_s

    def sleep(self, duration_s: float) -> None:
        self.t_s += duration_s


def picture(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A grey image whose level tells ``number`` (up to 20), also after lossy compression."""
    return np.full((size[1], size[0], 3), 10 + 12 * number, np.uint8)


def number_of(image: np.ndarray) -> int:
    """The number in a :func:`picture`."""
    return round((float(image.mean()) - 10) / 12)


def folder_of(folder: Path, count: int) -> Path:
    """Numbered images without leading zeros."""
    folder.mkdir()
    for number in range(count):
        cv2.imwrite(str(folder / f"{number}.png"), picture(number))
    return folder


def video_of(path: Path, count: int, fps: float = 10.0) -> Path:
    """A video of numbered frames."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, SIZE)
    for number in range(count):
        writer.write(picture(number))
    writer.release()
    return path


def drive(clock: Callable[[], float]) -> SourceContext:
    """A drive without bus."""
    return SourceContext(bus=None, now_s=clock)


class FakeCamera:
    """A V4L2 camera that can be unplugged and can hang; a grab waits for a frame of :meth:`give`."""

    def __init__(self) -> None:
        self.plugged = True
        self.kernel_s = 0.0
        self.handles: list[FakeCapture] = []
        self.changed = threading.Condition()
        self.numbers: list[int] = []

    def open(self) -> "FakeCapture":
        """An open handle. Raises OSError without a camera."""
        if not self.plugged:
            raise OSError("/dev/video0: no such device")
        self.handles.append(FakeCapture(self))
        return self.handles[-1]

    def give(self, number: int, kernel_s: float = 0.0) -> None:
        """Expose a frame."""
        with self.changed:
            self.numbers.append(number)
            self.kernel_s = kernel_s
            self.changed.notify_all()

    def unplug(self) -> None:
        """Remove the camera: calls fail, also those that wait."""
        with self.changed:
            self.plugged = False
            self.numbers.clear()
            self.changed.notify_all()

    def plug_in(self) -> None:
        """Bring the camera back."""
        self.plugged = True

    def hang(self) -> None:
        """Let the calls of all present handles wait for :meth:`recover`."""
        with self.changed:
            for handle in self.handles:
                handle.hangs = True

    def recover(self) -> None:
        """End the waiting of the handles that hang; they fail."""
        with self.changed:
            for handle in self.handles:
                handle.dead, handle.hangs = handle.dead or handle.hangs, False
            self.changed.notify_all()


class FakeCapture:
    """An open handle of a :class:`FakeCamera`, as ``cv2.VideoCapture``."""

    def __init__(self, camera: FakeCamera) -> None:
        self._camera = camera
        self._number = 0
        self.hangs = self.dead = self.released = False

    def grab(self) -> bool:
        camera = self._camera
        with camera.changed:
            camera.changed.wait_for(
                lambda: not self.hangs and (self.dead or not camera.plugged or bool(camera.numbers)), 60
            )
            if self.dead or not camera.numbers:
                return False
            self._number = camera.numbers.pop(0)
            return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, picture(self._number)

    def get(self, propId: int) -> float:
        assert propId == cv2.CAP_PROP_POS_MSEC
        return 1e3 * self._camera.kernel_s

    def release(self) -> None:
        self.released = True
