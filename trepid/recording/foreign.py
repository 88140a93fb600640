"""MCAP files of any ROS 2 software: their topics, and the bytes of one topic."""

import re
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.summary import Summary

from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.scan import Damage, leave_out, records, summary_of

CDR = "cdr"  # encoding of the messages of ROS 2
_OF_DDS = re.compile(r"(\w+)::msg::dds_::(\w+)_")  # sensor_msgs::msg::dds_::Image_


def types_of(path: Path) -> dict[str, str]:
    """ROS 2 type by topic, of the topics in CDR. Raises InputError when ``path`` is no MCAP file."""
    schemas, channels = _schemas_and_channels(path)
    return {
        channel.topic: _ros2_name(schemas[channel.schema_id].name)
        for channel in channels
        if channel.schema_id in schemas and channel.message_encoding == CDR
    }


def topics_in_words(path: Path) -> str:
    """Every topic with its type and its encoding where that is not CDR, for a message; "no topic" without any."""
    schemas, channels = _schemas_and_channels(path)
    words = []
    for channel in channels:
        schema = schemas.get(channel.schema_id)
        name = schema.name if schema is not None else "without a type"
        other = "" if channel.message_encoding == CDR else f" in {channel.message_encoding or 'no encoding'}"
        words.append(f"{channel.topic} ({name}{other})")
    return ", ".join(dict.fromkeys(words)) or "no topic"


def _ros2_name(name: str) -> str:
    """A type of ROS 2 as ``package/msg/Type``, also as ROS 1 and DDS write it."""
    if found := _OF_DDS.fullmatch(name):
        return f"{found[1]}/msg/{found[2]}"
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind}" if kind and "/" not in kind else name


def _schemas_and_channels(path: Path) -> tuple[dict[int, Schema], list[Channel]]:
    """By the summary, else by the whole file. Raises InputError when ``path`` is no MCAP file."""
    schemas: dict[int, Schema] = {}
    channels: list[Channel] = []
    try:
        with path.open("rb") as file:
            summary = summary_of(file)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if summary is not None and _is_complete(summary):
        schemas, channels = summary.schemas, list(summary.channels.values())
    else:
        for record in records(path, lambda _: False, damage=leave_out):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels.append(record)
    return schemas, channels


def _is_complete(summary: Summary) -> bool:
    """Whether the summary repeats every channel and its schema; writers may leave either out."""
    counted = summary.statistics.channel_count if summary.statistics else 0
    return len(summary.channels) >= max(counted, 1) and all(
        channel.schema_id == 0 or channel.schema_id in summary.schemas
        for channel in summary.channels.values()
    )


def messages_of(path: Path, topic: str, *, damage: Damage | None = None) -> Iterator[tuple[float, bytes]]:
    """Time of logging [s] and CDR bytes of the messages of ``topic`` in the order of the file, up to its end.

    Corrupted parts are left out and reported to ``damage``, by default said once.
    """
    ids: set[int] = set()
    for record in records(path, lambda name: name == topic, damage=damage):
        if isinstance(record, Channel) and record.topic == topic:
            ids.add(record.id)
        elif isinstance(record, Message) and record.channel_id in ids:
            yield seconds(record.log_time), record.data


def in_order(path: Path) -> Iterator[tuple[int, str, bytes]]:
    """Time of logging [ns], key of the topic and bytes of every message in CDR, in the order of the file.

    Corrupted parts are left out, and said once in a process.
    """
    keys: dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Channel) and record.message_encoding == CDR:
            keys[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, Message) and record.channel_id in keys:
            yield record.log_time, keys[record.channel_id], record.data
