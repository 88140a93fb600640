"""Reads the messages of an MCAP file of :mod:`trepid.recording.writer` by topic.

A recording that was cut short, by a crash or a loss of power, is read up to its last complete chunk; corrupted
chunks are left out, said and counted. A recording of an older version of Trepid is decoded by the definitions in
the file; fields that it lacks are absent.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar, overload

from mcap.records import Attachment, Channel, Chunk, Footer, Metadata, Schema
from mcap.records import Message as McapMessage
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.scan import CUT_SHORT, Damage, leave_out, records, saying
from trepid.recording.writer import BEGAN, DRIVE
from trepid.topics import Topic, topic_of
from trepid.wire import DERIVED, WireError, check_fields, definition, from_cdr, ros_name

M = TypeVar("M")
Decoder = Callable[[bytes], Any]


@dataclass(slots=True)
class RecordingContent:
    """The content of a recording. Times are those of arrival at the recorder [s]."""

    path: Path
    messages: dict[str, list[tuple[float, Any]]] = field(default_factory=dict)
    """Key of a topic -> arrival and message, in order of arrival."""
    files: dict[str, bytes] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)  # about the drive: trepid.recording.notes
    first_s: float = math.nan  # arrival of the first message of any topic ...
    last_s: float = math.nan  # ... and of the last
    complete: bool = False  # False: the end of the file was not reached
    lost: dict[str, int] = field(default_factory=dict)
    """Corrupted part of the file -> number of messages in it on the topics that were read; 0: unknown."""
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


def read_recording(
    path: Path,
    *keys: str,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    damage: Damage | None = None,
) -> RecordingContent:
    """The messages that arrived from ``from_s`` to ``to_s`` on topics that match one of ``keys`` (with ``*``).

    Corrupted chunks are left out and reported to ``damage``, by default said once in a process.
    Raises InputError when ``path`` is no MCAP file, or holds other types on the topics of Trepid.
    """
    recorded, series = read_series(path, *keys, from_s=from_s, to_s=to_s, damage=damage)
    for key, one in series.items():
        for place, at_s in enumerate(one.at_s):
            try:
                recorded.messages.setdefault(key, []).append((at_s, one.decode(one.data[place])))
            except WireError:
                recorded.malformed[key] += 1
    return recorded


class Series(Sequence[M]):
    """The messages of one topic in order of arrival, each decoded when it is used."""

    def __init__(self, decode: Callable[[bytes], M], definition: bytes | None) -> None:
        """``definition``: text of the type of the messages; None: that of this version."""
        self.at_s: list[float] = []  # arrival
        self.data: list[bytes] = []
        self.decode, self.definition = decode, definition
        self._decoded: dict[int, M] = {}

    @property
    def current(self) -> bool:
        """Whether the definition of the messages is that of this version."""
        return self.definition is None

    def add(self, at_s: float, data: bytes) -> None:
        """Add a message, which may have arrived before others."""
        self.at_s.append(at_s)
        self.data.append(data)

    def sort(self) -> None:
        """Bring the messages into the order of their arrival."""
        if any(later < earlier for earlier, later in pairwise(self.at_s)):
            order = sorted(range(len(self.at_s)), key=self.at_s.__getitem__)
            self.at_s, self.data = [self.at_s[i] for i in order], [self.data[i] for i in order]

    def keep(self, places: Sequence[int]) -> None:
        """Keep only the messages at ``places``."""
        self.at_s, self.data = [self.at_s[i] for i in places], [self.data[i] for i in places]
        self._decoded = {}

    def __len__(self) -> int:
        return len(self.data)

    @overload
    def __getitem__(self, place: int) -> M: ...
    @overload
    def __getitem__(self, place: slice) -> list[M]: ...
    def __getitem__(self, place: int | slice) -> M | list[M]:
        """The message at ``place``. Raises WireError when it was malformed on the bus already."""
        if isinstance(place, slice):
            return [self[i] for i in range(*place.indices(len(self)))]
        place = range(len(self))[place]
        if place not in self._decoded:
            self._decoded[place] = self.decode(self.data[place])
        return self._decoded[place]


def read_series(
    path: Path,
    *keys: str,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    damage: Damage | None = None,
) -> tuple[RecordingContent, dict[str, Series[Any]]]:
    """As :func:`read_recording`, with the messages in series that are decoded later.

    Raises InputError also when two channels of a topic have different definitions, as after a join of recordings of
    two versions.
    """
    recorded = RecordingContent(path)
    schemas: dict[int, Schema] = {}
    wanted: dict[int, Series[Any]] = {}
    series: dict[str, Series[Any]] = {}

    def is_asked_for(name: str) -> bool:
        key = name.removeprefix("/")
        return topic_of(key) is not None and any(fnmatchcase(key, pattern) for pattern in keys)

    report = damage or saying(path)

    def lose(what: str, messages: int) -> None:
        if what != CUT_SHORT:
            recorded.lost[what] = messages
        report(what, messages)

    for record in records(path, is_asked_for, damage=lose):
        match record:
            case McapMessage():
                at_s = seconds(record.log_time)
                if not recorded.first_s <= at_s <= recorded.last_s:
                    recorded.spans(at_s, at_s)
                if record.channel_id in wanted and from_s <= at_s <= to_s:
                    wanted[record.channel_id].add(at_s, record.data)
            case Schema():
                schemas[record.id] = record
            case Channel():
                key = record.topic.removeprefix("/")
                topic = topic_of(key)
                if topic is not None and is_asked_for(key) and record.id not in wanted:
                    schema = schemas.get(record.schema_id)
                    fresh = _series(topic, schema, path)
                    wanted[record.id] = _join_series(series.setdefault(key, fresh), fresh, f"{path}: {key}")
            case Chunk():
                recorded.spans(seconds(record.message_start_time), seconds(record.message_end_time))
            case Attachment():
                recorded.files[record.name] = record.data
            case Metadata(name=name, metadata=notes) if name == DRIVE:
                recorded.notes |= notes
            case Footer():
                recorded.complete = True
    for one in series.values():
        one.sort()
    return recorded, {key: one for key, one in series.items() if len(one)}


def _join_series(first: Series[Any], other: Series[Any], what: str) -> Series[Any]:
    """``first``, for the messages of a further channel of its topic too. Raises InputError for other messages."""
    if first.definition != other.definition:
        raise InputError(f"{what} has messages of two definitions of its type")
    return first


def read_head(path: Path) -> RecordingContent:
    """The files and the notes at the beginning of a recording, without its messages. Raises InputError."""
    recorded = RecordingContent(path)
    for record in records(path, lambda _: False, damage=leave_out):
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


def _series(topic: Topic[Any], schema: Schema | None, path: Path) -> Series[Any]:
    """An empty series for the messages of a channel. Raises InputError for messages of another type."""
    name = ros_name(topic.type)
    if schema is None or schema.name != name:
        held = schema.name if schema else "messages without a definition"
        raise InputError(f"{path}: {topic.key} holds {held}, expected {name}")
    standard = topic.type not in DERIVED
    if standard or schema.data == definition(topic.type).encode():
        return Series(lambda data: from_cdr(data, topic.type), None)
    return Series(_older(topic.type, schema.data.decode(errors="replace"), path), schema.data)


def _older(message_type: type, text: str, path: Path) -> Decoder:
    """Decoder by the definition ``text`` of another version of Trepid.

    Raises InputError where it lacks a field without which there is no message.
    """
    name, store = ros_name(message_type), get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(text, name))
    except Exception as error:  # the exceptions of the parser in rosbags are not documented
        raise InputError(f"{path}: its definition of {name} cannot be read") from error
    try:
        check_fields(message_type, store)
    except WireError as error:
        raise InputError(f"{path}: its definition of {name} does not fit this version: {error}") from error
    return lambda data: from_cdr(data, message_type, store)
