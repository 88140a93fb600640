"""Image files: their order in a folder, complete images from them, pictures to them."""

import re
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from trepid.config import InputError
from trepid.files.decoding import UndecodableText, refuse_packed
from trepid.types import Image

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm"})
VIDEO_SUFFIXES = frozenset(
    {
        *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".3gp", ".flv", ".wmv"),
        *(".ts", ".mts", ".m2ts", ".mpg", ".mpeg"),  # MPEG streams, as dash cameras and camcorders write
        ".gif",  # animated; a single picture is a film of one frame
    }
)
HEIC = "is a HEIC photograph, which is not decoded here: `heif-convert IN.heic OUT.jpg` makes a JPEG of it"
NOMINAL_FPS = 25.0  # for videos without a frame rate
_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
"""A marker of a JPEG; within a scan, data and restart marks are none."""
_JPEG = b"\xff\xd8\xff"
_EXIF_WITHIN = 1 << 18  # bytes: several segments of 64 kB may stand before EXIF
_DIGITS = re.compile(r"([0-9]+)")


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """``paths`` by name, with the numbers in the names by value: ``2.jpg`` comes before ``100.jpg``."""

    def key(path: Path) -> tuple[list[tuple[int, str]], str]:
        parts = _DIGITS.split(path.name.lower())
        # Text at even places, digits at odd ones: the same place always compares the same kind.
        return [(int(part), "") if at % 2 else (0, part) for at, part in enumerate(parts)], path.name

    return sorted(paths, key=key)


def images_in(folder: Path) -> list[Path]:
    """The image files in ``folder`` in natural order. Raises InputError when there is none."""
    try:
        found = [
            path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES and path.is_file()
        ]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error
    if not found:
        raise InputError(f"{folder}: there is no image in this folder")
    return natural_order(found)


def read_image(path: Path) -> Image:
    """The image in ``path``, shape (height, width, 3). Raises InputError when it is not an image or truncated."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not _is_complete(data):
        raise InputError(f"{path}: image file is {'truncated' if data else 'empty'}")
    image = decoded_image(data)
    if image is None:
        try:
            refuse_packed(data)
        except UndecodableText as error:
            raise InputError(f"{path}: {error.problem}") from error
        raise InputError(
            f"{path}: {HEIC if data[4:12] == b'ftypheic' else 'not an image that can be decoded'}"
        )
    return image


def decoded_image(data: bytes) -> Image | None:
    """The image in the bytes of a file, shape (height, width, 3); None for one that OpenCV cannot decode."""
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # of no bytes, and of more pixels than CV_IO_MAX_IMAGE_PIXELS
        return None
    return None if image is None else image.astype(np.uint8, copy=False)


def is_upright_jpeg(data: bytes) -> bool:
    """Whether ``data`` is a JPEG whose pixels are upright as they are stored: EXIF does not turn or mirror them."""
    if not data.startswith(_JPEG):
        return False
    if b"Exif\0" not in data[:_EXIF_WITHIN]:
        return True
    stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    shown = decoded_image(data)
    return stored is not None and shown is not None and np.array_equal(stored, shown)


def _is_complete(data: bytes) -> bool:
    """False for no bytes, and for a JPEG or PNG without its end mark: decoders fill the missing rest with grey."""
    if data.startswith(_JPEG):
        return _has_end(data)
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return b"IEND" in data
    return bool(data)


def _has_end(jpeg: bytes) -> bool:
    """Whether the end mark follows the segments and scans (ITU-T T.81, annex B), before anything appended.

    A thumbnail with an end mark of its own is inside a segment.
    """
    at = 2
    while marker := _MARKER.search(jpeg, at):
        at = marker.end()
        if marker[1] == b"\xd9":
            return True
        at += int.from_bytes(jpeg[at : at + 2], "big")
    return False


def write_image(path: Path, image: Image, *, quality: int | None = None) -> None:
    """Write ``image`` in the format of the suffix; ``quality``: of a JPEG, 0 to 100. Raises InputError."""
    options = [] if quality is None else [cv2.IMWRITE_JPEG_QUALITY, quality]
    try:
        written = cv2.imwrite(str(path), image, options if path.suffix.lower() in (".jpg", ".jpeg") else [])
    except cv2.error:  # no such format
        written = False
    if not written:
        raise InputError(f"{path}: cannot be written as an image")
