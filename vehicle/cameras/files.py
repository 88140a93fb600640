"""Recorded frames in files: videos, folders of images, and MCAP files of Trepid or of other software."""

import heapq
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, islice
from pathlib import Path

import numpy as np

from trepid.config import InputError
from trepid.images.containers import loss_of
from trepid.images.files import NOMINAL_FPS, images_in, read_image
from trepid.images.video import video_frames
from trepid.loudness import warn
from trepid.recording.foreign import messages_of, topics_in_words, types_of
from trepid.recording.scan import Damage, leave_out
from trepid.spelling import did_you_mean
from trepid.types import Image, Positive
from trepid.wire import WireError
from vehicle.cameras.playback import Playback, PlaybackSettings, UndecodedFrame, recording_path
from vehicle.cameras.ros_images import TYPES, RosImage, ros_image
from vehicle.cameras.source import SourceContext, Values

PROBED_IMAGES = 30  # of a recording: one of these has to be a picture
SORTED_IMAGES = 8  # by their stamps, where a recording was joined of several


class FolderSettings(PlaybackSettings):
    """Block ``folder`` of ``config/camera_source.yaml``."""

    rate_hz: Positive = NOMINAL_FPS


class VideoFile(Playback):
    """A video file, by the time stamps in it."""

    Settings = PlaybackSettings

    def __init__(self, settings: PlaybackSettings, drive: SourceContext) -> None:
        path = recording_path(settings.path)
        if not path.is_file():
            raise InputError(f"{path}: no such file; set path")
        begin = partial(video_shots, path)
        super().__init__(begin, now_s=drive.now_s, pace=settings.pace, loop=settings.loop)
        loss = loss_of(path)
        if loss:
            warn(f"trepid: {path}: video is truncated: {loss}; played as far as it can be read")


class ImageFolder(Playback):
    """The images of a folder in natural order, at a fixed rate."""

    Settings = FolderSettings

    def __init__(self, settings: FolderSettings, drive: SourceContext) -> None:
        folder = recording_path(settings.path)
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; set path")
        images = images_in(folder)
        read_image(images[0])  # an unreadable folder is refused at once
        shots = [
            UndecodedFrame(n / settings.rate_hz, partial(read_image, path)) for n, path in enumerate(images)
        ]
        super().__init__(lambda: iter(shots), now_s=drive.now_s, pace=settings.pace, loop=settings.loop)


def video_shots(path: Path) -> Iterator[UndecodedFrame]:
    """The frames of a video by their stamps. Raises InputError when none can be decoded."""
    for frame in video_frames(path):
        yield UndecodedFrame(frame.t_s, partial(np.asarray, frame.decode(), np.uint8))


class McapSettings(PlaybackSettings):
    """Block ``mcap`` of ``config/camera_source.yaml``."""

    topic: str | None = None  # None: the only one with images


class McapFile(Playback):
    """The images of one topic, by the stamps of their headers; by the time of logging where a stamp is zero.

    Where the stamps of the first images are all the same, the time of logging counts for all. Corrupted chunks and
    the lost end of a file are warned of when they are reached, and counted. Raises InputError when none of the
    first images is a picture.
    """

    Settings = McapSettings

    def __init__(self, settings: McapSettings, drive: SourceContext) -> None:
        path = recording_path(settings.path)
        topics = image_topics(path)
        topic = _choose_topic(settings.topic, topics, path)
        self._path, self._damages = path, set[str]()
        begin = partial(mcap_images(path, topic, topics[topic]), self._report_damage)
        try:
            super().__init__(begin, now_s=drive.now_s, pace=settings.pace, loop=settings.loop)
        except InputError as error:
            raise InputError(f"{path}: {topic}: {error}") from error

    def values(self) -> Values:
        """Also the number of parts of the file that are lost."""
        return (*super().values(), ("damaged_parts", str(len(self._damages))))

    def _report_damage(self, what: str, _messages: int) -> None:
        if what not in self._damages:  # as when the file is played again
            self._damages.add(what)
            warn(f"trepid: {self._path}: {what}")


def image_topics(path: Path) -> dict[str, str]:
    """ROS 2 type by topic, of the topics with images. Raises InputError without any."""
    topics = {topic: name for topic, name in types_of(path).items() if name in TYPES}
    if not topics:
        images = f"no topic with {' or '.join(TYPES)} in CDR, as ROS 2 records them"
        raise InputError(f"{path}: holds {images}, but {topics_in_words(path)}")
    return topics


def mcap_images(path: Path, topic: str, ros_type: str) -> Callable[[Damage], Iterator[UndecodedFrame]]:
    """What begins the images of one of :func:`image_topics`, as :class:`McapFile` plays them; raises as it does."""
    has_stamps = _probe_images(path, topic, ros_type)
    return lambda damage: mcap_shots(path, topic, ros_type, has_stamps=has_stamps, damage=damage)


def _probe_images(path: Path, topic: str, ros_type: str) -> bool:
    """Whether the stamps of the first images tell them apart.

    Raises InputError with the reason of the last one when none can be decoded; an empty topic is no fault here.
    """
    stamps: list[float] = []
    reason, decoded = "", False
    for _, data in islice(messages_of(path, topic, damage=leave_out), PROBED_IMAGES):
        try:
            image = ros_image(data, ros_type)
            stamps += [] if image.stamp_s is None else [image.stamp_s]
            if not decoded:
                image.decode()
                decoded = True
        except WireError as error:
            reason = str(error)
    if reason and not decoded:
        raise InputError(f"{path}: {topic}: {reason}")
    if len(stamps) > 1 and min(stamps) == max(stamps):
        warn(
            f"trepid: {path}: {topic}: all images have the same stamp; they are played by their times of logging"
        )
        return False
    return True


def _choose_topic(wanted: str | None, topics: dict[str, str], path: Path) -> str:
    if wanted is None:
        if len(topics) > 1:
            raise InputError(
                f"{path}: holds several topics with images; set topic to one of {', '.join(topics)}"
            )
        return next(iter(topics))
    for name in (wanted, f"/{wanted}"):
        if name in topics:
            return name
    raise InputError(f"{path}: no topic {wanted!r} with images; {did_you_mean(wanted, topics)}")


def mcap_shots(
    path: Path, topic: str, ros_type: str, *, has_stamps: bool = True, damage: Damage | None = None
) -> Iterator[UndecodedFrame]:
    """The images of ``topic`` in the order of their times, as far as SORTED_IMAGES neighbours tell."""
    waiting: list[tuple[float, int, UndecodedFrame]] = []
    number = count()
    for shot in _shots_of_file(path, topic, ros_type, has_stamps=has_stamps, damage=damage):
        heapq.heappush(waiting, (shot.t_s, next(number), shot))
        if len(waiting) > SORTED_IMAGES:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _shots_of_file(
    path: Path, topic: str, ros_type: str, *, has_stamps: bool, damage: Damage | None
) -> Iterator[UndecodedFrame]:
    """The images of ``topic`` in the order of the file, by their stamps or by the time of logging.

    The image of a malformed message cannot be decoded; its time is that of logging, less the delay of the image
    before it. Malformed messages before the first image have no time and are left out.
    """
    delay_s: float | None = None
    for logged_s, data in messages_of(path, topic, damage=damage):
        where = f"{path}: {topic} at {logged_s:.3f} s"
        try:
            image = ros_image(data, ros_type)
        except WireError as error:
            if delay_s is not None:
                yield UndecodedFrame(logged_s - delay_s, partial(_refuse, f"{where}: {error}"))
            continue
        t_s = image.stamp_s if has_stamps and image.stamp_s is not None else logged_s
        delay_s = logged_s - t_s
        yield UndecodedFrame(t_s, partial(_decode, image, where))


def _refuse(reason: str) -> Image:
    raise InputError(reason)


def _decode(image: RosImage, where: str) -> Image:
    try:
        return image.decode()
    except WireError as error:
        raise InputError(f"{where}: {error}") from error
