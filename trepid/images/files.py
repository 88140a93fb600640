"""Image files: their order in a folder, and complete images from them."""

import re
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from trepid.config import InputError
from trepid.types import Image

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm"})
VIDEO_SUFFIXES = frozenset({".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v"})
NOMINAL_FPS = 25.0  # for videos without a frame rate
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
        raise InputError(f"{path}: image file is truncated")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if image is None:
        raise InputError(f"{path}: not an image")
    return image.astype(np.uint8, copy=False)


def _is_complete(data: bytes) -> bool:
    """False for a JPEG or PNG without its end mark: decoders fill the missing rest with grey."""
    tail = data.rstrip(b"\x00\r\n")
    if data.startswith(b"\xff\xd8\xff"):
        return b"\xff\xd9" in tail[-64 * 1024 :]
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return b"IEND" in data[-64 * 1024 :]
    return True
