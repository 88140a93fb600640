"""Videos: their frames by the stamps in the file, up to its end, and what cannot be read by its name.

The number of frames that a file announces proves nothing: Matroska and WebM have none, OpenCV makes one of duration
and rate, and a trimmed MP4 keeps frames that are never shown. The lengths that its container
states show whether a file was cut short: ISO 14496-12 (MP4, MOV), RIFF (AVI), RFC 8794 and 9559 (Matroska, WebM).
"""

import math
import re
import shlex
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

import cv2
import numpy as np

from trepid.config import InputError
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
BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free")  # that begin an MP4 or MOV
LEAST_STEP_S = 5e-4  # between two frames: stamps are whole milliseconds or finer, and rates below 1 kHz
MOST_FRAMES = 1e8
MOST_DAMAGED = 300  # frames in a row: behind more of them, or as many tries at the end, nothing is sought
SEARCHED = 1 << 20  # bytes at both ends of a file that may name its codec
_LEAST_ID = 0x10  # first byte of the identifier of a Matroska element: of 1 to 4 bytes
LFS = b"version https://git-lfs"
EBML, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"


class VideoFrame(NamedTuple):
    """A frame of a video."""

    number: int  # from 0 on
    t_s: float  # its stamp
    decode: Callable[[], Image]  # before the next frame is asked for; raises InputError


def video_frames(path: Path) -> Iterator[VideoFrame]:
    """The frames of a video up to its last one.

    A stamp that does not follow the one before is replaced by one period later. Damaged frames are left out, and
    said once in a process. Raises InputError when there is no frame that can be decoded.
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
                _warn_of_damage(path, number + 1, failed)
                failed = 0
            number += 1
            stamp_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
            follows = math.isfinite(stamp_s) and stamp_s > before_s + LEAST_STEP_S
            before_s = stamp_s if follows else before_s + period_s if number else 0.0
            yield VideoFrame(number, before_s, decode)
        if number < 0:
            raise InputError(_unreadable(path, capture))
    finally:
        capture.release()


@cache
def _warn_of_damage(path: Path, number: int, failed: int) -> None:
    warn(f"trepid: {path}: damaged before frame {number}: {failed} frames cannot be decoded; left out")


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
    if beginning.startswith(LFS):
        return f"{path}: is a Git LFS pointer, not the video: `git lfs pull` gets it"
    if not capture.isOpened() and not _is_container(beginning):
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


def _is_container(beginning: bytes) -> bool:
    return beginning.startswith((b"RIFF", EBML)) or beginning[4:8] in BOXES


def loss_of(path: Path) -> str:
    """What a video file lacks by the lengths that its container states; empty for a whole or other file.

    Raises OSError.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[:4] == b"RIFF":
            stated = 8 + int.from_bytes(head[4:8], "little")
            return _missing(stated, size) if 8 < stated < 0xFFFFFFFF else ""
        if head[:4] == EBML:
            return _matroska_loss(file, size)
        if head[4:8] in BOXES:
            return _boxes_loss(file, size)
    return ""


def _missing(stated: int, size: int) -> str:
    return f"{stated - size} of {stated} bytes are missing" if stated > size else ""


def _boxes_loss(file: BinaryIO, size: int) -> str:
    """Of the boxes of ISO 14496-12, each with its length and kind; one with the length 0 reaches to the end."""
    place, kinds = 0, set()
    while place + 8 <= size:
        file.seek(place)
        head = file.read(16)
        length, kind = int.from_bytes(head[:4], "big"), head[4:8]
        if not (kind.isascii() and kind.isalnum()):
            break  # padding
        kinds.add(kind)
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        if length < 8:
            break
        place += length
    if place > size:
        return f"at least {place - size} bytes are missing"
    return "" if b"moov" in kinds else "its index (moov) is missing"


def _matroska_loss(file: BinaryIO, size: int) -> str:
    """Of the segment after the header; of a live recording, which does not know its length, of its elements."""
    file.seek(len(EBML))
    header = _ebml_length(file)
    if header is None:
        return ""
    file.seek(header, 1)
    if file.read(len(SEGMENT)) != SEGMENT:
        return ""
    length = _ebml_length(file)
    if length is not None:
        return _missing(file.tell() + length, size)
    return _elements_loss(file, size)


def _elements_loss(file: BinaryIO, size: int) -> str:
    """Of the elements from here on; one without a length, such as the cluster of a live recording, is entered."""
    while (place := file.tell()) + 2 <= size:
        first = file.read(1)[0]
        if first < _LEAST_ID:
            return ""  # padding
        file.seek(place + 9 - first.bit_length())
        length = _ebml_length(file)
        end = file.tell() + (length or 0)
        if end > size:
            return f"at least {end - size} bytes are missing"
        file.seek(end)
    return ""


def _ebml_length(file: BinaryIO) -> int | None:
    """A length of 1 to 8 bytes, by the leading zero bits of the first one; None: not known."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    count = 9 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] & (0xFF >> count)]) + file.read(count - 1), "big")
    return None if value == (1 << 7 * count) - 1 else value
