"""The records of an MCAP file in order; corrupted ones are stepped over and reported, up to the last whole one.

The reader of the package ``mcap`` parses every message and every index in Python. A recording holds hundreds of
messages a second, of which a question needs few, so this one steps over the others by their lengths. A chunk with
one message, as the recorder writes for each raw image, is not decompressed when its topic is not read.

A lost chunk may have held the only definition of a channel, whose messages follow in others, and a corrupted length
hides where the next record begins. The summary at the end of the file repeats the channels and the places of the
chunks, so that reading goes on by these.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from io import BytesIO
from os import SEEK_END
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

from trepid.config import InputError
from trepid.files.decoding import MARK_BYTES, other_file
from trepid.loudness import warn

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length of a record
MESSAGE = struct.Struct("<HIQQ")  # channel, number, time of logging and of publication
MESSAGE_HEAD = struct.Struct("<BQH")  # opcode, length and channel of a message
INDEX = struct.Struct("<HI")  # channel and number of bytes of the index of a chunk
INDEX_ENTRY = 16  # bytes of a message in it
TIMES = struct.Struct("<QQ")  # first and last time of a chunk
LEAST_BYTES = 2 * len(MAGIC) + 29  # of a file with a summary: both magics and the footer
READ: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHUNK: Chunk,
    Opcode.FOOTER: Footer,
}
"""Class of the records that are read by opcode; the others are indices of these."""
_BROKEN = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    ValueError,
    MemoryError,
    OverflowError,
    EOFError,
)
"""Exceptions of the libraries for a truncated record and for other content."""
_OTHERS = {
    b"#ROSBAG": "a bag of ROS 1: `rosbags-convert` of the package rosbags makes one of ROS 2 in MCAP",
    b"SQLite format 3": "a bag of ROS 2 in SQLite: `ros2 bag convert` makes one in MCAP",
    b"PK\x03\x04": "a ZIP archive: unpack it",
    b"\x28\xb5\x2f\xfd": "packed by zstd: unpack it",
}
"""How files begin that stand where a recording should, and what to say of them."""
Wanted = Callable[[str], bool]
"""Whether the messages on a topic are read."""
Damage = Callable[[str, int], None]
"""Called with what is lost and where in the file, and with the number of wanted messages in it; 0: unknown."""
CUT_SHORT = "the file is cut short, or nothing in it can be read from here on"
"""What is lost at the end of a file, as a crash of its writer leaves it."""
UNDEFINED = "messages of channels that no readable part defines are lost"


def images_in_words(what: str, images: int) -> str:
    """``what`` is lost, a :data:`Damage` to a topic with images, and how many of them."""
    return f"{what}, {images} images among them" if images else what


def leave_out(_what: str, _messages: int) -> None:
    """A :data:`Damage` for what another reading of the file reports."""


def saying(path: Path) -> Damage:
    """A :data:`Damage` that says each corrupted part of ``path`` once in a process.

    The end of a file is not said: a recording that is being written ends anywhere.
    """

    def say(what: str, _messages: int) -> None:
        if what != CUT_SHORT:
            say_once(path, what)

    return say


@cache
def say_once(path: Path, what: str) -> None:
    """Say what of ``path`` is lost, once in a process however often the file is read."""
    warn(f"trepid: {path}: {what}")


def records(
    path: Path, wanted: Wanted = lambda _: True, *, damage: Damage | None = None
) -> Iterator[McapRecord]:
    """The records of a MCAP file with the messages on ``wanted`` topics. Raises InputError when it is none.

    A chunk is returned without its data before the records in it, and gives their times. Corrupted parts are
    stepped over; these and the end of a file that is cut short are reported to ``damage``, else :func:`saying`.
    """
    report, found = damage or saying(path), False
    try:
        with path.open("rb") as file:
            beginning = file.read(MARK_BYTES)
            if not beginning.startswith(MAGIC):
                raise InputError(f"{path}: not a recording: {_other(beginning)}")
            for record in _Scan(file, wanted, report).records():
                found = True
                yield record
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _BROKEN as error:
        if not found:
            raise InputError(
                f"{path}: not a recording: an MCAP file cut short before its first record"
            ) from error
        report(CUT_SHORT, 0)


def _other(beginning: bytes) -> str:
    """What a file is that begins like this and not like MCAP."""
    if not beginning:
        return "the file is empty"
    return other_file(beginning, _OTHERS) or "no MCAP file"


def summary_of(file: IO[bytes]) -> Summary | None:
    """What the end of ``file`` repeats; None where there is no summary, as in a file that is cut short."""
    if file.seek(0, SEEK_END) < LEAST_BYTES:
        return None
    file.seek(0)
    try:
        return make_reader(file).get_summary()
    except _BROKEN:
        return None


class _Scan:
    """The records of one open file."""

    def __init__(self, file: IO[bytes], wanted: Wanted, damage: Damage) -> None:
        self._file, self._wanted, self._damage = file, wanted, damage
        self._ids: dict[int, bool] = {}  # channel -> whether its messages are read
        self._undefined = 0  # messages whose channel no record defines
        self._size = file.seek(0, SEEK_END)

    def records(self) -> Iterator[McapRecord]:
        """From the first to the last that can be found. Raises one of _BROKEN at the end of a file cut short."""
        self._file.seek(len(MAGIC))
        try:
            while True:
                begin = self._file.tell()
                opcode, length = HEAD.unpack(self._file.read(HEAD.size))
                after = begin + HEAD.size + length
                if after > self._size:
                    after = self._next_chunk(begin)
                    yield from self._lose(begin, after)
                elif opcode in READ or opcode == Opcode.MESSAGE:
                    try:
                        yield from (
                            self._of_chunk(length) if opcode == Opcode.CHUNK else self._one(opcode, length)
                        )
                    except _BROKEN:
                        yield from self._lose(begin + HEAD.size, after)
                    if opcode == Opcode.FOOTER:
                        return
                self._file.seek(after)
        finally:
            if self._undefined:
                self._damage(f"{self._undefined} {UNDEFINED}", self._undefined)

    def _one(self, opcode: int, length: int) -> Iterator[McapRecord]:
        """The record of ``length`` bytes outside a chunk that begins here, if it is read."""
        content = self._file.read(length)
        if opcode != Opcode.MESSAGE:
            record = _read(opcode, content)
            self._note(record)
            yield record
            return
        is_read = self._ids.get(MESSAGE.unpack_from(content)[0])
        self._undefined += is_read is None
        if is_read:
            yield _message(content, 0, length)

    def _lose(self, begin: int, end: int) -> Iterator[McapRecord]:
        """Report the corrupted bytes from ``begin`` to ``end``; their definitions that the summary repeats."""
        summary = self._summary
        channels = summary.channels.values() if summary is not None else ()
        lost = [channel for channel in channels if channel.id not in self._ids]
        for channel in lost:
            self._note(channel)
        self._file.seek(end)
        messages, wanted = self._count_messages()
        number = f"{messages} " if messages else ""
        self._damage(
            f"the {end - begin} bytes from byte {begin} on are corrupted, and the {number}messages in them lost",
            wanted,
        )
        if summary is not None and lost:
            yield from summary.schemas.values()
            yield from lost

    @cached_property
    def _summary(self) -> Summary | None:
        return summary_of(self._file)

    def _next_chunk(self, begin: int) -> int:
        """Where the next chunk after ``begin`` begins by the summary. Raises EOFError where it does not say."""
        chunks = self._summary.chunk_indexes if self._summary is not None else ()
        starts = (chunk.chunk_start_offset for chunk in chunks)
        found = min((start for start in starts if begin < start < self._size), default=None)
        if found is None:
            raise EOFError
        return found

    def _of_chunk(self, length: int) -> Iterator[McapRecord]:
        """The chunk of ``length`` bytes that begins here, without its data, and the records in it that are read."""
        file, begin = self._file, self._file.tell()
        file.seek(begin + length)
        is_read = self._ids.get(_only_channel(file), True)
        file.seek(begin)
        if not is_read:
            first_ns, last_ns = TIMES.unpack(file.read(TIMES.size))
            yield Chunk("", b"", last_ns, first_ns, 0, 0)
            return
        chunk = _read(Opcode.CHUNK, file.read(length))
        data, chunk.data = _unpack(chunk), b""
        yield chunk
        yield from self._in_chunk(data)

    def _in_chunk(self, data: bytes) -> Iterator[McapRecord]:
        place, end, is_message, unpack_head = 0, len(data), int(Opcode.MESSAGE), MESSAGE_HEAD.unpack_from
        ids = self._ids
        while place < end:
            if data[place] == is_message:
                _, length, channel = unpack_head(data, place)
                place += HEAD.size
                is_read = ids.get(channel)
                if is_read:
                    yield _message(data, place, length)
                elif is_read is None:
                    self._undefined += 1
                place += length
                continue
            opcode, length = HEAD.unpack_from(data, place)
            place += HEAD.size
            if opcode in READ:
                record = _read(opcode, data[place : place + length])
                self._note(record)
                yield record
            place += length

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Channel):
            self._ids[record.id] = self._wanted(record.topic)

    def _count_messages(self) -> tuple[int, int]:
        """Number of messages, and of those that are read or of unknown channels, by the indices that begin here."""
        found = wanted = 0
        while True:
            head = self._file.read(HEAD.size + INDEX.size)
            if len(head) < HEAD.size + INDEX.size or head[0] != Opcode.MESSAGE_INDEX:
                return found, wanted
            channel, size = INDEX.unpack_from(head, HEAD.size)
            found += size // INDEX_ENTRY
            wanted += size // INDEX_ENTRY if self._ids.get(channel, True) else 0
            self._file.seek(size, 1)


def _unpack(chunk: Chunk) -> bytes:
    """The records of a chunk, which zstd may hold in several frames. Raises one of _BROKEN."""
    if chunk.compression != "zstd":
        stream, total = get_chunk_data_stream(chunk, validate_crc=True)
        return stream.read(total)
    with zstandard.ZstdDecompressor().stream_reader(chunk.data, read_across_frames=True) as packed:
        data = packed.read(chunk.uncompressed_size)
    if len(data) < chunk.uncompressed_size or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk is corrupted")
    return data


def _only_channel(file: IO[bytes]) -> int:
    """Channel of the only message of a chunk, by the indices after it; -1 for any other chunk.

    A chunk of several messages may also define channels, and they are not in its indices.
    """
    found = -1
    while True:
        head = file.read(HEAD.size + INDEX.size)
        if len(head) < HEAD.size + INDEX.size or head[0] != Opcode.MESSAGE_INDEX:
            return found
        channel, size = INDEX.unpack_from(head, HEAD.size)
        if found >= 0 or size != INDEX_ENTRY:
            return -1
        found = channel
        file.seek(size, 1)


def _message(data: bytes, place: int, length: int) -> Message:
    """The message whose content is ``length`` bytes at ``place``."""
    channel, number, log_ns, publish_ns = MESSAGE.unpack_from(data, place)
    return Message(channel, log_ns, data[place + MESSAGE.size : place + length], publish_ns, number)


def _read(opcode: int, content: bytes) -> Any:
    """The record with this content. Raises ValueError for a corrupted attachment."""
    if opcode == Opcode.ATTACHMENT:
        (crc,) = struct.unpack("<I", content[-4:])
        if crc and zlib.crc32(content[:-4]) != crc:
            raise ValueError("an attachment is corrupted")
    return READ[opcode].read(ReadDataStream(BytesIO(content)))
