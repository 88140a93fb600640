"""MCAP files of any ROS 2 software: their topics, and the bytes of one topic."""

import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.summary import Summary

from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.scan import records


def types_of(path: Path) -> dict[str, str]:
    """ROS 2 type by topic, of the topics in CDR. Raises InputError when ``path`` is no MCAP file."""
    schemas: dict[int, Schema] = {}
    channels: list[Channel] = []
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (McapError, ValueError, EOFError, struct.error):
        summary = None  # cut short: the summary is at the end
    if summary is not None and _is_complete(summary):
        schemas, channels = summary.schemas, list(summary.channels.values())
    else:
        for record in records(path, lambda _: False):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels.append(record)
    return {
        channel.topic: schemas[channel.schema_id].name
        for channel in channels
        if channel.schema_id in schemas and channel.message_encoding == "cdr"
    }


def _is_complete(summary: Summary) -> bool:
    """Whether the summary repeats every channel and its schema; writers may leave either out."""
    counted = summary.statistics.channel_count if summary.statistics else 0
    return len(summary.channels) >= max(counted, 1) and all(
        channel.schema_id == 0 or channel.schema_id in summary.schemas
        for channel in summary.channels.values()
    )


def messages_of(path: Path, topic: str) -> Iterator[tuple[float, bytes]]:
    """Time of logging [s] and CDR bytes of the messages of ``topic`` in the order of the file, up to its end."""
    ids: set[int] = set()
    for record in records(path, lambda name: name == topic):
        if isinstance(record, Channel) and record.topic == topic:
            ids.add(record.id)
        elif isinstance(record, Message) and record.channel_id in ids:
            yield seconds(record.log_time), record.data


def in_order(path: Path) -> Iterator[tuple[int, str, bytes]]:
    """Time of logging [ns], key of the topic and bytes of every message in CDR, in the order of the file."""
    keys: dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Channel) and record.message_encoding == "cdr":
            keys[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, Message) and record.channel_id in keys:
            yield record.log_time, keys[record.channel_id], record.data
