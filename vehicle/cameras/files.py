"""Recorded frames in files: videos and folders of images."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS, images_in, read_image
from trepid.types import Positive
from vehicle.cameras.playback import Playback, PlaybackSettings, Shot, recording_path
from vehicle.cameras.source import Drive


class FolderSettings(PlaybackSettings):
    """Block ``folder`` of ``config/camera_source.yaml``."""

    rate_hz: Positive = NOMINAL_FPS


class VideoFile(Playback):
    """A video file, by the time stamps in it."""

    Settings = PlaybackSettings

    def __init__(self, settings: PlaybackSettings, drive: Drive) -> None:
        path = recording_path(settings.path)
        if not path.is_file():
            raise InputError(f"{path}: no such file; set path")
        begin = partial(video_shots, path)
        try:
            super().__init__(begin, now_s=drive.now_s, pace=settings.pace, loop=settings.loop)
        except InputError as error:
            raise InputError(f"{path}: cannot be read as a video; it may be truncated") from error


class ImageFolder(Playback):
    """The images of a folder in natural order, at a fixed rate."""

    Settings = FolderSettings

    def __init__(self, settings: FolderSettings, drive: Drive) -> None:
        folder = recording_path(settings.path)
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; set path")
        images = images_in(folder)
        read_image(images[0])  # an unreadable folder is refused at once
        shots = [Shot(n / settings.rate_hz, partial(read_image, path)) for n, path in enumerate(images)]
        super().__init__(lambda: iter(shots), now_s=drive.now_s, pace=settings.pace, loop=settings.loop)


def video_shots(path: Path) -> Iterator[Shot]:
    """The frames of a video with their times [s].

    A time that does not follow the one before it is replaced by one period later.
    """
    capture = cv2.VideoCapture(str(path))
    try:
        fps = capture.get(cv2.CAP_PROP_FPS)
        period_s = 1 / (fps if 0 < fps < 1000 else NOMINAL_FPS)
        t_s = -math.inf
        while (read := capture.read())[0]:
            own_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
            later = math.isfinite(own_s) and own_s > t_s
            t_s = own_s if later else t_s + period_s
            yield Shot(t_s, partial(np.asarray, read[1], np.uint8))
    finally:
        capture.release()
