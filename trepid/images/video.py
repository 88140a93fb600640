"""Videos: their frames by the stamps in the file, up to its end, and what cannot be read by its name.

The number of frames that a file announces proves nothing: Matroska and WebM have none, OpenCV makes one of duration
and rate, and a trimmed MP4 keeps frames that are never shown. What is missing or damaged shows in the lengths that
the container states (:mod:`trepid.images.containers`).
"""

import math
import re
import shlex
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from trepid.config import InputError
from trepid.files.decoding import UndecodableText, refuse_packed
from trepid.images.containers import damage_of, is_container, loss_of
from trepid.images.files import NOMINAL_FPS
from trepid.loudness import warn
from trepid.types import Image

CODECS = {
    "av01": "AV1",
    "hevc": "HEVC",
    "hev1": "HEVC",
    "hvc1": "HEVC",
    "avc1": "H.264",
    "h264": "H.264",
    "vp80": "VP8",
    "vp90": "VP9",
    "vp09": "VP9",
    "apcn": "ProRes",
    "apch": "ProRes",
    "vvc1": "VVC",
}
DECODED = {"H.264", "HEVC", "VP8", "VP9", "ProRes"}  # by every build of OpenCV with FFmpeg, as of PyPI
LEAST_STEP_S = 5e-4  # between two frames: stamps are whole milliseconds or finer, and rates below 1 kHz
MOST_FRAMES = 1e8
MOST_DAMAGED = 300  # frames in a row: behind more of them, or as many tries at the end, nothing is sought
SEARCHED = 1 << 20  # bytes at both ends of a file that may name its codec


class VideoFrame(NamedTuple):
    """A frame of a video."""

    number: int  # from 0 on
    t_s: float  # its stamp
    decode: Callable[[], Image]  # before the next frame is asked for; raises InputError


def video_frames(path: Path) -> Iterator[VideoFrame]:
    """The frames of a video up to its last one.

    A stamp that does not follow the one before is replaced by one period later. Damaged frames are left out, and
    said once in a process; damaged parts of the file, which OpenCV passes over, are said at its end. Raises
    InputError when there is no frame that can be decoded.
    """
    capture = cv2.VideoCapture(str(path))

    def decode() -> Image:
        good, image = capture.retrieve()
        if not good:
            raise InputError(f"{path}: a frame cannot be decoded")
        return image.astype(np.uint8, copy=False)

    try:
        period_s = 1 / _rate_hz(capture)
        number, before_s, failed = -1, -math.inf, 0
        while failed < MOST_DAMAGED:
            if not capture.grab():  # at the end, and at a damaged frame
                failed += 1
                continue
            if failed:
                what = f"damaged before frame {number + 1}: {failed} frames cannot be decoded; left out"
                _warn_once(path, what)
                failed = 0
            number += 1
            stamp_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
            follows = math.isfinite(stamp_s) and stamp_s > before_s + LEAST_STEP_S
            before_s = stamp_s if follows else before_s + period_s if number else 0.0
            yield VideoFrame(number, before_s, decode)
        if number < 0:
            raise InputError(_unreadable(path, capture))
        if damage := damage_of(path):
            _warn_once(path, damage)
    finally:
        capture.release()


@cache
def _warn_once(path: Path, what: str) -> None:
    warn(f"trepid: {path}: {what}")


def spread_images(path: Path, count: int) -> list[Image]:
    """Up to ``count`` images of a video from the first to the last. Raises InputError as :func:`video_frames`."""
    stated = _stated_frames(path)
    images, held = _at_places(path, stated, count)
    if held != stated:
        images, _ = _at_places(path, held, count)
    return images


def _at_places(path: Path, frames: int, count: int) -> tuple[list[Image], int]:
    """``count`` images spread over ``frames``, and the number of frames that the file has."""
    places = set(np.linspace(0, frames - 1, count).astype(int).tolist()) if frames else set()
    images = []
    number = -1
    for frame in video_frames(path):
        number = frame.number
        if number in places:
            images.append(frame.decode())
    return images, number + 1


def _stated_frames(path: Path) -> int:
    """The number of frames that a file announces; 0 for none, and for one beyond any drive."""
    capture = cv2.VideoCapture(str(path))
    try:
        stated = capture.get(cv2.CAP_PROP_FRAME_COUNT) if capture.isOpened() else 0.0
    finally:
        capture.release()
    return int(stated) if 0 < stated < MOST_FRAMES else 0


def count_frames(path: Path) -> int:
    """The number of frames, each one found in the file. Raises InputError as :func:`video_frames`."""
    return sum(1 for _ in video_frames(path))


def video_rate_hz(path: Path) -> float:
    """The average rate that a video states; the nominal one without. Raises InputError when it cannot be opened."""
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise InputError(_unreadable(path, capture))
        return _rate_hz(capture)
    finally:
        capture.release()


def _rate_hz(capture: cv2.VideoCapture) -> float:
    rate_hz = float(capture.get(cv2.CAP_PROP_FPS)) if capture.isOpened() else 0.0
    return rate_hz if 0 < rate_hz < 1000 else NOMINAL_FPS


def _unreadable(path: Path, capture: cv2.VideoCapture) -> str:
    """Why no frame of ``path`` can be decoded, in one line."""
    try:
        loss, size = loss_of(path), path.stat().st_size
        with path.open("rb") as file:
            beginning = file.read(SEARCHED)
            file.seek(max(size - SEARCHED, 0))
            end = file.read(SEARCHED)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    if loss or not size:
        return f"{path}: video is truncated: {loss or 'the file is empty'}"
    try:
        refuse_packed(beginning)
    except UndecodableText as error:
        return f"{path}: {error.problem}"
    if not capture.isOpened() and not is_container(beginning):
        return f"{path}: cannot be read as a video"
    codec = _opened_codec(capture) if capture.isOpened() else _codec_in(beginning + end)
    if codec in DECODED:
        return f"{path}: {codec}: damaged: no picture in it can be decoded"
    copy = shlex.quote(str(path.with_name(f"{path.stem}-h264.mp4")))
    return (
        f"{path}: {codec or 'its codec'}: this OpenCV cannot decode it; convert it:"
        f" ffmpeg -i {shlex.quote(str(path))} -c:v libx264 {copy}"
    )


def _opened_codec(capture: cv2.VideoCapture) -> str:
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    text = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ")
    return CODECS.get(text.lower(), text)


def _codec_in(data: bytes) -> str:
    """The codec that the tracks of a Matroska or MP4 file name; empty where it is not known."""
    matroska = re.search(rb"V_[A-Z0-9]+(?:/[A-Z0-9]+)*", data)
    if matroska:
        return matroska[0].decode().removeprefix("V_")
    samples = [found[1].decode().lower() for found in re.finditer(rb"stsd.{12}([ -~]{4})", data, re.DOTALL)]
    return next((CODECS[code] for code in samples if code in CODECS), "")
