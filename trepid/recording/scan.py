"""The records of an MCAP file in order, up to the first incomplete or corrupted one.

The reader of the package ``mcap`` parses every message and every index in Python. A recording holds hundreds of
messages a second, of which a question needs few, so this one steps over the others by their lengths. A chunk with
one message, as the recorder writes for each raw image, is not decompressed when its topic is not read.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from trepid.config import InputError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length of a record
MESSAGE = struct.Struct("<HIQQ")  # channel, number, time of logging and of publication
MESSAGE_HEAD = struct.Struct("<BQH")  # opcode, length and channel of a message
INDEX = struct.Struct("<HI")  # channel and number of bytes of the index of a chunk
INDEX_ENTRY = 16  # bytes of a message in it
TIMES = struct.Struct("<QQ")  # first and last time of a chunk
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
_OTHERS = (
    (b"version https://git-lfs", "a Git LFS pointer: `git lfs pull` gets the file"),
    (b"#ROSBAG", "a bag of ROS 1: `rosbags-convert` of the package rosbags makes one of ROS 2 in MCAP"),
    (b"SQLite format 3", "a bag of ROS 2 in SQLite: `ros2 bag convert` makes one in MCAP"),
    (b"PK\x03\x04", "a ZIP archive: unpack it"),
    (b"\x1f\x8b", "packed by gzip: unpack it"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd: unpack it"),
)
"""How files begin that stand where a recording should, the longest first, and what to say of them."""
Wanted = Callable[[str], bool]
"""Whether the messages on a topic are read."""
Damage = Callable[[str, int], None]
"""Called with what is lost and where in the file, and with the number of wanted messages in it; 0: unknown."""
CUT_SHORT = "the file is cut short, or nothing in it can be read from here on"
"""What is lost at the end of a file, as a crash of its writer leaves it."""


def images_in_words(what: str, images: int) -> str:
    """``what`` is lost, a :data:`Damage` to a topic with images, and how many of them."""
    return f"{what}, {images} images among them" if images else what


def leave_out(_what: str, _messages: int) -> None:
    """A :data:`Damage` for what an earlier reading of the file has reported."""


def records(
    path: Path, wanted: Wanted = lambda _: True, *, damage: Damage | None = None
) -> Iterator[McapRecord]:
    """The records of a MCAP file with the messages on ``wanted`` topics. Raises InputError when it is none.

    A chunk is returned without its data before the records in it, and gives their times. With ``damage``, corrupted
    chunks are stepped over, and these and the end of a file that is cut short are reported to it.
    """
    found = False
    try:
        with path.open("rb") as file:
            beginning = file.read(len(_OTHERS[0][0]))
            if not beginning.startswith(MAGIC):
                raise InputError(f"{path}: not a recording: {_other(beginning)}")
            for record in _records(file, wanted, damage):
                found = True
                yield record
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _BROKEN as error:
        if not found:
            raise InputError(
                f"{path}: not a recording: an MCAP file cut short before its first record"
            ) from error
        if damage is not None:
            damage(CUT_SHORT, 0)


def _other(beginning: bytes) -> str:
    """What a file is that begins like this and not like MCAP."""
    if not beginning:
        return "the file is empty"
    return next((what for start, what in _OTHERS if beginning.startswith(start)), "no MCAP file")


def _records(file: IO[bytes], wanted: Wanted, damage: Damage | None) -> Iterator[McapRecord]:
    ids: dict[int, bool] = {}  # channel -> whether its messages are read
    size = file.seek(0, 2)
    file.seek(len(MAGIC))
    while True:
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        if length > size - file.tell():
            raise EOFError
        if opcode not in READ and opcode != Opcode.MESSAGE:
            file.seek(length, 1)
            continue
        if opcode == Opcode.CHUNK:
            begin = file.tell()
            try:
                yield from _of_chunk(file, length, ids, wanted)
            except _BROKEN:
                if damage is None:
                    raise
                file.seek(begin + length)
                what = f"the {length} bytes from byte {begin} on are corrupted, and the messages in them lost"
                damage(what, _count_messages(file, ids))
                file.seek(begin + length)
            continue
        content = file.read(length)
        if opcode == Opcode.MESSAGE:
            if ids.get(MESSAGE.unpack_from(content)[0]):
                yield _message(content, 0, length)
            continue
        record = _read(opcode, content)
        _note(record, ids, wanted)
        yield record
        if isinstance(record, Footer):
            return


def _of_chunk(file: IO[bytes], length: int, ids: dict[int, bool], wanted: Wanted) -> Iterator[McapRecord]:
    """The chunk of ``length`` bytes that begins here, without its data, and the records in it that are read."""
    begin = file.tell()
    file.seek(begin + length)
    if ids.get(_only_channel(file), True):
        file.seek(begin)
        chunk = _read(Opcode.CHUNK, file.read(length))
        data, chunk.data = _unpack(chunk), b""
        yield chunk
        yield from _in_chunk(data, ids, wanted)
    else:
        file.seek(begin)
        first_ns, last_ns = TIMES.unpack(file.read(TIMES.size))
        yield Chunk("", b"", last_ns, first_ns, 0, 0)
    file.seek(begin + length)


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


def _count_messages(file: IO[bytes], ids: dict[int, bool]) -> int:
    """Number of messages that are read, or of unknown channels, by the indices of a chunk, which begin here."""
    found = 0
    while True:
        head = file.read(HEAD.size + INDEX.size)
        if len(head) < HEAD.size + INDEX.size or head[0] != Opcode.MESSAGE_INDEX:
            return found
        channel, size = INDEX.unpack_from(head, HEAD.size)
        found += size // INDEX_ENTRY if ids.get(channel, True) else 0
        file.seek(size, 1)


def _in_chunk(data: bytes, ids: dict[int, bool], wanted: Wanted) -> Iterator[McapRecord]:
    place, end, is_message, unpack_head = 0, len(data), int(Opcode.MESSAGE), MESSAGE_HEAD.unpack_from
    while place < end:
        if data[place] == is_message:
            _, length, channel = unpack_head(data, place)
            place += HEAD.size
            if ids.get(channel):
                yield _message(data, place, length)
            place += length
            continue
        opcode, length = HEAD.unpack_from(data, place)
        place += HEAD.size
        if opcode in READ:
            record = _read(opcode, data[place : place + length])
            _note(record, ids, wanted)
            yield record
        place += length


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


def _note(record: McapRecord, ids: dict[int, bool], wanted: Wanted) -> None:
    if isinstance(record, Channel):
        ids[record.id] = wanted(record.topic)
