"""Image sources: images, folders of images, videos, recordings, read as frames in order."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import cv2
import numpy as np

from trepid.config import InputError
from trepid.images.containers import loss_of
from trepid.images.files import (
    HEIC,
    IMAGE_SUFFIXES,
    NOMINAL_FPS,
    VIDEO_SUFFIXES,
    images_in,
    read_image,
)
from trepid.images.video import spread_images, video_frames, video_rate_hz
from trepid.recording.images import RecordedImages, decode_image, recorded_car, recorded_images
from trepid.recording.reader import RecordingContent, read_head
from trepid.recording.scan import CUT_SHORT, Damage, images_in_words, leave_out, say_once
from trepid.types import Image

if TYPE_CHECKING:
    from vehicle.cameras.playback import UndecodedFrame

RECORDING_SUFFIX = ".mcap"
FILM_SUFFIXES = VIDEO_SUFFIXES | {RECORDING_SUFFIX}
"""Files that hold many frames."""
RATED_IMAGES = 100  # of a recording, whose stamps give its frame rate


def is_recording(path: Path) -> bool:
    """True for a recording of Trepid. Raises InputError for a file of this name that is no MCAP."""
    return path.suffix.lower() == RECORDING_SUFFIX and path.is_file() and recorded_images(path) is not None


class SourceImage(NamedTuple):
    """One image of a source."""

    path: Path
    number: int  # in the source
    t_s: float
    image: Image


Refused = Callable[[InputError], None]
"""Takes the error of an image that cannot be read, and either raises it or returns: the image is left out."""


def _raise_error(error: InputError) -> None:
    raise error


def _reporting(path: Path, refused: Refused) -> Damage:
    """Reports corrupted parts of a recording to ``refused``; a lost end, as crashes leave it, is only warned of."""

    def report(what: str, images: int) -> None:
        if what == CUT_SHORT:
            say_once(path, what)
        else:
            refused(InputError(f"{path}: {images_in_words(what, images)}"))

    return report


@dataclass(frozen=True, slots=True)
class Still:
    """One image, independent of others."""

    path: Path
    in_folder: bool = False
    fps: ClassVar[float] = NOMINAL_FPS

    def read(self) -> Image:
        """The decoded image. Raises InputError."""
        return read_image(self.path)

    def shots(self, refused: Refused = _raise_error) -> Iterator[SourceImage]:
        """The image at time 0, the first of several.

        ``refused`` gets the error of an unreadable image of a folder.
        """
        image = _image(self.path, refused if self.in_folder else _raise_error)
        if image is not None:
            if (pictures := cv2.imcount(str(self.path))) > 1:
                say_once(self.path, f"holds {pictures} pictures; the first one is read")
            yield SourceImage(self.path, 0, 0.0, image)


@dataclass(frozen=True, slots=True)
class Stills:
    """The images of a folder as one drive, whose frames are tracked."""

    path: Path
    files: Sequence[Path]
    fps: float

    def shots(self, refused: Refused = _raise_error) -> Iterator[SourceImage]:
        """The images in order; ``refused`` gets the errors of unreadable ones, whose places in time stay empty."""
        for number, path in enumerate(self.files):
            image = _image(path, refused)
            if image is not None:
                yield SourceImage(path, number, number / self.fps, image)

    def sample(self, count: int) -> list[Image]:
        """Up to ``count`` images spread over the drive, for calibration; unreadable ones are left out."""
        places = np.linspace(0, len(self.files) - 1, count).astype(int).tolist()
        images = [_image(self.files[place], lambda _: None) for place in dict.fromkeys(places)]
        return [image for image in images if image is not None]


@dataclass(frozen=True, slots=True)
class Footage:
    """The camera images of a recording of Trepid, whose frames are tracked."""

    images: RecordedImages
    head: RecordingContent
    fps: float

    @property
    def path(self) -> Path:
        """Of the recording."""
        return self.images.path

    @property
    def has_settings(self) -> bool:
        """The recording states its drive, so that its camera is known: that of its car, else the shipped one."""
        return bool(self.head.notes)

    def shots(self, refused: Refused = _raise_error) -> Iterator[SourceImage]:
        """The images by their capture times.

        ``refused`` gets the errors of images that cannot be decoded, and of corrupted parts of the file; images in
        these have no number.
        """
        for number, (_, message) in enumerate(self.images.messages(_reporting(self.path, refused))):
            image = decode_image(message)
            if image is None:
                refused(InputError(f"{self.path}: the image of {message.t_s:.3f} s cannot be decoded"))
            else:
                yield SourceImage(self.path, number, message.t_s, image)

    def sample(self, count: int) -> list[Image]:
        """Up to ``count`` images spread over the recording, for calibration; undecodable ones are left out."""
        wanted = set(np.linspace(0, self.images.count() - 1, count).astype(int).tolist())
        messages = enumerate(self.images.messages(leave_out))
        chosen = (message for place, (_, message) in messages if place in wanted)
        found = [image for message in chosen if (image := decode_image(message)) is not None]
        if not found:
            raise InputError(f"{self.path}: no image of this recording can be decoded")
        return found


@dataclass(frozen=True, slots=True)
class Clip:
    """A video, whose frames are tracked."""

    path: Path
    fps: float  # on average

    def read(self) -> Iterator[Image]:
        """Its frames. Raises InputError as :meth:`shots`."""
        return (shot.image for shot in self.shots())

    def shots(self, refused: Refused = _raise_error) -> Iterator[SourceImage]:
        """Its frames by their stamps. Raises InputError after the last one when the file is cut short."""
        count = 0
        for frame in video_frames(self.path):
            count += 1
            yield SourceImage(self.path, frame.number, frame.t_s, frame.decode())
        loss = loss_of(self.path)
        if loss:
            raise InputError(f"{self.path}: video is truncated: {count} frames can be read; {loss}")

    def sample(self, count: int) -> list[Image]:
        """Up to ``count`` frames spread over the clip, for calibration. Raises InputError when none is read."""
        return spread_images(self.path, count)


@dataclass(frozen=True, slots=True)
class ForeignFootage:
    """The images on one topic of an MCAP file of other software, whose frames are tracked."""

    path: Path
    fps: float
    begin: Callable[[Damage], Iterator["UndecodedFrame"]]

    def shots(self, refused: Refused = _raise_error) -> Iterator[SourceImage]:
        """The images by their stamps. ``refused`` gets the same errors as that of :meth:`Footage.shots`."""
        for number, frame in enumerate(self.begin(_reporting(self.path, refused))):
            try:
                image = frame.decode()
            except InputError as error:
                refused(error)
            else:
                yield SourceImage(self.path, number, frame.t_s, image)

    def sample(self, count: int) -> list[Image]:
        """Up to ``count`` images spread over the file, for calibration; undecodable ones are left out."""
        last = sum(1 for _ in self.begin(leave_out)) - 1
        wanted = set(np.linspace(0, last, count).astype(int).tolist())
        return [shot.image for shot in self.shots(lambda _: None) if shot.number in wanted]


Source = Still | Stills | Clip | Footage | ForeignFootage


def settings_of(source: Source) -> AbstractContextManager[None]:
    """Use the settings of the car of a recording, unless another car is in use already. Raises InputError."""
    return recorded_car(source.head) if isinstance(source, Footage) else nullcontext()


def sources(path: Path, *, drive_fps: float | None = None) -> list[Source]:
    """The sources in ``path``: an image, a video, a recording, or the images of a folder in natural order.

    With ``drive_fps`` the images of a folder are one source, a drive at this frame rate. Raises InputError.
    """
    if path.is_dir():
        images = images_in(path)
        if drive_fps is not None:
            if not 0 < drive_fps < math.inf:
                raise InputError(f"{path}: a drive has more than 0 frames per second, got {drive_fps:g}")
            return [Stills(path, images, drive_fps)]
        return [Still(image, in_folder=True) for image in images]
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    suffix = path.suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return [Clip(path, video_rate_hz(path))]
    if suffix in IMAGE_SUFFIXES:
        return [Still(path)]
    if suffix == RECORDING_SUFFIX:
        return [_footage(path)]
    if suffix in (".heic", ".heif"):
        raise InputError(f"{path}: {HEIC}")
    known = " ".join(sorted(IMAGE_SUFFIXES | FILM_SUFFIXES))
    raise InputError(f"{path}: unknown kind of file; known: {known}")


def _footage(path: Path) -> Footage | ForeignFootage:
    images = recorded_images(path)
    if images is None:
        return _foreign_footage(path)
    stamps_s = (message.t_s for _, message in images.messages(leave_out))
    return Footage(images, read_head(path), _usual_fps(stamps_s))


def _foreign_footage(path: Path) -> ForeignFootage:
    from vehicle.cameras.files import image_topics, mcap_images  # for files of other software only

    types = image_topics(path)
    topics = list(types)
    if len(topics) > 1:
        keep = f"mcap filter {path.name} --include-topic-regex {topics[0]} --output one.mcap"
        raise InputError(f"{path}: holds images on {', '.join(topics)}; keep one of these topics: {keep}")
    begin = mcap_images(path, topics[0], types[topics[0]])
    stamps_s = [frame.t_s for frame in islice(begin(leave_out), RATED_IMAGES)]
    if not stamps_s:
        raise InputError(f"{path}: {topics[0]}: holds no image")
    return ForeignFootage(path, _usual_fps(stamps_s), begin)


def _usual_fps(stamps_s: Iterable[float]) -> float:
    """1 / the median of the first positive intervals between captures; the nominal rate for one image."""
    steps_s = np.diff(list(islice(stamps_s, RATED_IMAGES)))
    steps_s = steps_s[steps_s > 0]
    return float(1 / np.median(steps_s)) if len(steps_s) else NOMINAL_FPS


def _image(path: Path, refused: Refused) -> Image | None:
    """The image in ``path``; None where ``refused`` takes its error."""
    try:
        return read_image(path)
    except InputError as error:
        refused(error)
        return None
