"""Reads the messages of an MCAP file of :mod:`trepid.recording.writer` by topic.

A recording that was cut short, by a crash or a loss of power, is read up to its last complete chunk. A recording of
an older version of Trepid is decoded by the definitions in the file; fields that it lacks are absent.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar

from mcap.records import Attachment, Channel, Chunk, Footer, Metadata, Schema
from mcap.records import Message as McapMessage
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.scan import records
from trepid.recording.writer import BEGAN, DRIVE
from trepid.topics import Topic, topic_of
from trepid.wire import DERIVED, WireError, definition, from_cdr, ros_name

M = TypeVar("M")
Decoder = Callable[[bytes], Any]


@dataclass(slots=True)
class Recorded:
    """The content of a recording. Times are those of arrival at the recorder [s]."""

    path: Path
    messages: dict[str, list[tuple[float, Any]]] = field(default_factory=dict)
    """Key of a topic -> arrival and message, in order of arrival."""
    files: dict[str, bytes] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)  # about the drive: trepid.recording.notes
    first_s: float = math.nan  # arrival of the first message of any topic ...
    last_s: float = math.nan  # ... and of the last
    complete: bool = False  # False: cut short, or broken somewhere
    malformed: Counter[str] = field(default_factory=Counter)
    """Number of messages by topic that were malformed on the bus already; they are left out."""

    @property
    def began_s(self) -> float | None:
        """Start of the drive; None: not recorded."""
        stamp = self.notes.get(BEGAN, "")
        return seconds(int(stamp)) if stamp.isdecimal() else None

    def spans(self, first_s: float, last_s: float) -> None:
        """Note that messages arrived from ``first_s`` to ``last_s``."""
        self.first_s = first_s if math.isnan(self.first_s) else min(first_s, self.first_s)
        self.last_s = last_s if math.isnan(self.last_s) else max(last_s, self.last_s)

    def of(self, topic: Topic[M]) -> list[tuple[float, M]]:
        """Every message of ``topic`` that was read, with its arrival."""
        return self.messages.get(topic.key, [])


def read_recording(path: Path, *keys: str, from_s: float = -math.inf, to_s: float = math.inf) -> Recorded:
    """The messages that arrived from ``from_s`` to ``to_s`` on topics that match one of ``keys`` (with ``*``).

    Raises InputError when ``path`` is no MCAP file, or holds other types on the topics of Trepid.
    """
    recorded = Recorded(path)
    schemas: dict[int, Schema] = {}
    wanted: dict[int, tuple[str, Decoder]] = {}

    def asked(name: str) -> bool:
        key = name.removeprefix("/")
        return topic_of(key) is not None and any(fnmatchcase(key, pattern) for pattern in keys)

    for record in records(path, asked):
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel():
                key = record.topic.removeprefix("/")
                topic = topic_of(key)
                if topic is not None and asked(key):
                    wanted[record.id] = key, _decoder(topic, schemas.get(record.schema_id), path)
            case Chunk():
                recorded.spans(seconds(record.message_start_time), seconds(record.message_end_time))
            case McapMessage():
                at_s = seconds(record.log_time)
                recorded.spans(at_s, at_s)
                if record.channel_id in wanted and from_s <= at_s <= to_s:
                    key, decode = wanted[record.channel_id]
                    try:
                        recorded.messages.setdefault(key, []).append((at_s, decode(record.data)))
                    except WireError:
                        recorded.malformed[key] += 1
            case Attachment():
                recorded.files[record.name] = record.data
            case Metadata(name=name, metadata=notes) if name == DRIVE:
                recorded.notes |= notes
            case Footer():
                recorded.complete = True
    for arrived in recorded.messages.values():
        arrived.sort(key=lambda entry: entry[0])
    return recorded


def read_head(path: Path) -> Recorded:
    """The files and the notes at the beginning of a recording, without its messages. Raises InputError."""
    recorded = Recorded(path)
    for record in records(path, lambda _: False):
        match record:
            case Chunk():
                break
            case Attachment():
                recorded.files[record.name] = record.data
            case Metadata(name=name, metadata=notes) if name == DRIVE:
                recorded.notes |= notes
    return recorded


def times_of(path: Path) -> dict[str, list[float]]:
    """Times of arrival [s] of all messages by topic key, without decoding them. Raises InputError."""
    keys: dict[int, str] = {}
    times: dict[str, list[float]] = {}
    for record in records(path):
        if isinstance(record, Channel):
            keys[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, McapMessage):
            times.setdefault(keys[record.channel_id], []).append(seconds(record.log_time))
    return times


def _decoder(topic: Topic[Any], schema: Schema | None, path: Path) -> Decoder:
    """Decoder of the messages of a channel. Raises InputError for messages of another type."""
    name = ros_name(topic.type)
    if schema is None or schema.name != name:
        held = schema.name if schema else "messages without a definition"
        raise InputError(f"{path}: {topic.key} holds {held}, expected {name}")
    text = schema.data.decode(errors="replace")
    if topic.type not in DERIVED or text == definition(topic.type):
        return lambda data: from_cdr(data, topic.type)
    return _older(topic.type, text, path)


def _older(message_type: type, text: str, path: Path) -> Decoder:
    """Decoder by the definition ``text`` of another version of Trepid."""
    name, store = ros_name(message_type), get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(text, name))
    except Exception as error:  # the exceptions of the parser in rosbags are not documented
        raise InputError(f"{path}: its definition of {name} cannot be read") from error

    def decoded(data: bytes) -> Any:
        try:
            return from_cdr(data, message_type, store)
        except WireError as error:
            raise InputError(f"{path}: {error}") from error

    return decoded
