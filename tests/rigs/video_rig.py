"""Matroska files (RFC 8794, RFC 9559) with any stamps, with and without the lengths that writers may leave out."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

UNKNOWN = b"\x01" + b"\xff" * 7  # the length of a live recording


def length(size: int) -> bytes:
    return (size | 1 << 56).to_bytes(8, "big")


def element(name: str, content: bytes, *, known: bool = True) -> bytes:
    return bytes.fromhex(name) + (length(len(content)) if known else UNKNOWN) + content


def number(name: str, value: int) -> bytes:
    return element(name, value.to_bytes(8, "big"))


def matroska(
    path: Path,
    images: Sequence[np.ndarray],
    times_ms: Sequence[int],
    *,
    codec: str = "V_MJPEG",
    duration_ms: float | None = None,
    known: bool = True,
) -> Path:
    """A video of JPEG ``images`` at ``times_ms``. ``known``: with the length of its segment."""
    height, width = images[0].shape[:2]
    header = element("4286", b"\x01") + element("42f7", b"\x01") + element("42f2", b"\x04")
    header += element("42f3", b"\x08") + element("4282", b"matroska") + element("4287", b"\x04")
    header += element("4285", b"\x02")
    info = number("2ad7b1", 1_000_000) + element("4d80", b"rig") + element("5741", b"rig")
    if duration_ms is not None:
        info += element("4489", struct.pack(">d", duration_ms))
    size = element("e0", number("b0", width) + number("ba", height))
    track = number("d7", 1) + number("73c5", 1) + number("83", 1) + element("86", codec.encode()) + size
    clusters = b""
    for image, t_ms in zip(images, times_ms, strict=True):
        block = b"\x81" + struct.pack(">h", 0) + b"\x80" + cv2.imencode(".jpg", image)[1].tobytes()
        clusters += element("1f43b675", number("e7", t_ms) + element("a3", block))
    segment = element("1549a966", info) + element("1654ae6b", element("ae", track)) + clusters
    path.write_bytes(element("1a45dfa3", header) + element("18538067", segment, known=known))
    return path
