"""Recorded frames in files: videos and folders of images."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS, images_in, read_image
from trepid.images.video import loss_of, video_frames
from trepid.loudness import warn
from trepid.types import Positive
from vehicle.cameras.playback import Playback, PlaybackSettings, UndecodedFrame, recording_path
from vehicle.cameras.source import SourceContext


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
