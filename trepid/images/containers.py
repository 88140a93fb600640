"""Containers of videos: what their lengths and their structure say of bytes that are missing or damaged.

Of MP4 and MOV (ISO 14496-12), AVI (RIFF), Matroska and WebM (RFC 8794 and 9559). The decoders of OpenCV pass over
damaged parts without a word.
"""

import mmap
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free")  # that begin an MP4 or MOV
EBML, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
CLUSTER = b"\x1f\x43\xb6\x75"
_LEAST_ID = 0x10  # first byte of the identifier of a Matroska element: of 1 to 4 bytes
# Identifiers of the elements of a segment: seek head, information, tracks, cues, tags, chapters, attachments; of a
# cluster: times, silent tracks, place, size before, blocks, groups of blocks; of both: void, checksum.
_ELEMENTS = {
    *(
        bytes.fromhex(name)
        for name in ("114d9b74", "1549a966", "1654ae6b", "1c53bb6b", "1254c367", "1043a770")
    ),
    *(bytes.fromhex(name) for name in ("1941a469", "e7", "5854", "a7", "ab", "a3", "a0", "af", "ec", "bf")),
    CLUSTER,
}
_CHUNK = re.compile(rb"\d\d(?:dc|db|wb|tx|pc)|ix\d\d|JUNK|LIST|RIFF|idx1|INFO")
_PADDING = 16  # bytes
_FRAME = re.compile(rb"\d\d(?:dc|db)")  # of a chunk with a picture, where reading goes on


def is_container(beginning: bytes) -> bool:
    """Whether a file that begins so is a video in a container."""
    return beginning.startswith((b"RIFF", EBML)) or beginning[4:8] in BOXES


def damage_of(path: Path) -> str:
    """What of an AVI, Matroska or WebM is no part of the film, in words; empty for a whole or other file.

    Raises OSError.
    """
    if not path.stat().st_size:
        return ""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if data[:4] == EBML:
            lost, early = list(_damaged_elements(data)), ""
        elif data[:4] == b"RIFF" and data[8:12] == b"AVI ":
            lost, early = list(_damaged_chunks(data)), ", and those after them come too early"
        else:
            return ""
    if not lost:
        return ""
    places = f" and in {len(lost) - 1} more places" if len(lost) > 1 else ""
    count = sum(end - start for start, end in lost)
    return f"damaged at byte {lost[0][0]}{places}, {count} bytes in all: frames there are lost{early}"


def _damaged_elements(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Start and end of what stands between the elements of a segment and of its clusters, which are entered."""
    data.seek(data.find(SEGMENT) + len(SEGMENT))
    _ebml_length(data)
    while (place := data.tell()) + 2 <= len(data):
        first = data[place]
        begin = place + 9 - first.bit_length() if first >= _LEAST_ID else place
        name = data[place:begin]
        if name in _ELEMENTS:
            data.seek(begin)
            length = _ebml_length(data) or 0
            data.seek(min(data.tell() + (0 if name == CLUSTER else length), len(data)))
            continue
        again = data.find(CLUSTER, place)
        if again < 0 and not data[place : place + _PADDING].strip(b"\0"):
            return  # zeros at the end
        end = len(data) if again < 0 else again
        yield place, end
        data.seek(end)


def _damaged_chunks(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Start and end of what stands between the chunks of the list of pictures and sounds."""
    place = data.find(b"movi")
    place = len(data) if place < 0 else place + 4
    while place + 8 <= len(data):
        name, length = data[place : place + 4], int.from_bytes(data[place + 4 : place + 8], "little")
        if _CHUNK.fullmatch(name):
            inside = name in (b"LIST", b"RIFF")
            place += 12 if inside else 8 + length + length % 2
            continue
        found = _FRAME.search(data, place)
        if found is None:
            return  # padding
        yield place, found.start()
        place = found.start()


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


def _ebml_length(file: BinaryIO | mmap.mmap) -> int | None:
    """A length of 1 to 8 bytes, by the leading zero bits of the first one; None: not known."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    count = 9 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] & (0xFF >> count)]) + file.read(count - 1), "big")
    return None if value == (1 << 7 * count) - 1 else value
