"""Image sources: images, folders of images, videos, read as frames in order."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trepid.config import InputError
from trepid.images.files import IMAGE_SUFFIXES, NOMINAL_FPS, VIDEO_SUFFIXES, images_in, read_image
from trepid.types import Image

INDEXED_SUFFIXES = frozenset({".mp4", ".m4v", ".mov", ".avi"})


@dataclass(frozen=True, slots=True)
class Still:
    """One image, independent of others."""

    path: Path

    def read(self) -> Image:
        """The decoded image. Raises InputError."""
        return read_image(self.path)


@dataclass(frozen=True, slots=True)
class Clip:
    """A video, whose frames are tracked."""

    path: Path
    frames: int
    fps: float

    def read(self) -> Iterator[Image]:
        """Its frames. Raises InputError when it ends before the announced number of frames."""
        capture = cv2.VideoCapture(str(self.path))
        decoded = 0
        try:
            while (read := capture.read())[0]:
                decoded += 1
                yield read[1].astype(np.uint8, copy=False)
        finally:
            capture.release()
        if decoded < self.frames - self._unsure_frames:
            raise InputError(
                f"{self.path}: video is truncated: {decoded} of {self.frames} frames can be read"
            )

    @property
    def _unsure_frames(self) -> int:
        """Tolerance of the announced number of frames: exact with an index, an estimate from the duration else."""
        return 1 if self.path.suffix.lower() in INDEXED_SUFFIXES else 2 + self.frames // 50

    def sample(self, count: int) -> list[Image]:
        """Up to ``count`` frames spread over the clip, for calibration. Raises InputError when none is read."""
        wanted = set(np.linspace(0, self.frames - 1, count).astype(int).tolist())
        images: list[Image] = []
        capture = cv2.VideoCapture(str(self.path))
        try:
            for number in range(max(wanted) + 1):
                if not capture.grab():
                    break
                if number in wanted:
                    good, image = capture.retrieve()
                    if good:
                        images.append(image.astype(np.uint8, copy=False))
        finally:
            capture.release()
        if not images:
            raise InputError(f"{self.path}: no frame of this video can be read")
        return images


Source = Still | Clip


def sources(path: Path) -> list[Source]:
    """The sources in ``path``: an image, a video, or the images of a folder in natural order. Raises InputError."""
    if path.is_dir():
        return [Still(image) for image in images_in(path)]
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    suffix = path.suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return [_clip(path)]
    if suffix in IMAGE_SUFFIXES:
        return [Still(path)]
    known = " ".join(sorted(IMAGE_SUFFIXES | VIDEO_SUFFIXES))
    raise InputError(f"{path}: unknown kind of file; known: {known}")


def _clip(path: Path) -> Clip:
    capture = cv2.VideoCapture(str(path))
    try:
        frames = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        fps = float(capture.get(cv2.CAP_PROP_FPS)) if frames else 0.0
    finally:
        capture.release()
    if frames <= 0:
        raise InputError(f"{path}: cannot be read as a video; it may be truncated")
    return Clip(path=path, frames=frames, fps=fps if 0 < fps < 1000 else NOMINAL_FPS)
