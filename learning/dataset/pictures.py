"""The images of a source: files, frames of videos, messages of recordings."""

from collections.abc import Generator
from pathlib import Path

from trepid.config import InputError
from trepid.images.files import VIDEO_SUFFIXES, read_image
from trepid.images.video import video_frames
from trepid.recording.scan import leave_out
from trepid.types import Image
from vehicle.cameras.files import mcap_shots
from vehicle.cameras.playback import UndecodedFrame

RECORDING_SUFFIX = ".mcap"
FILM_SUFFIXES = VIDEO_SUFFIXES | {".hevc", ".h264", ".h265"}  # videos, and bare streams without an index


class PictureReader:
    """Reads the images below one folder; of a video or recording from the place of the last one on."""

    def __init__(self, root: Path, topic: str | None = None) -> None:
        """``topic``: of the images in recordings."""
        self._root, self._topic = root, topic
        self._container: str | None = None
        self._next = 0  # number of the next frame of the container
        self._frames: Generator[UndecodedFrame, None, None] | None = None

    def read(self, image: str, item: int) -> Image:
        """The image file ``image`` (``item`` -1), or frame ``item`` of this container. Raises InputError."""
        if item < 0:
            return read_image(self._root / image)
        if self._frames is None or self._container != image or item < self._next:
            self.close()
            self._container, self._next = image, 0
            self._frames = self._begin(self._root / image)
        for shot in self._frames:
            self._next += 1
            if self._next > item:
                return shot.decode()
        raise InputError(f"{self._root / image}: has no frame {item}: {self._next} can be read")

    def close(self) -> None:
        """Release the container."""
        if self._frames is not None:
            self._frames.close()
        self._frames = None

    def _begin(self, path: Path) -> Generator[UndecodedFrame, None, None]:
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        suffix = path.suffix.lower()
        if suffix == RECORDING_SUFFIX and self._topic is not None:
            return _recorded_frames(path, self._topic)
        if suffix in FILM_SUFFIXES:
            return _film_frames(path)
        raise InputError(f"{path}: unknown kind of file with several frames")


def _recorded_frames(path: Path, topic: str) -> Generator[UndecodedFrame, None, None]:
    from trepid.recording.foreign import types_of

    yield from mcap_shots(path, topic, types_of(path)[topic], damage=leave_out)


def _film_frames(path: Path) -> Generator[UndecodedFrame, None, None]:
    for frame in video_frames(path):
        yield UndecodedFrame(frame.t_s, frame.decode)
