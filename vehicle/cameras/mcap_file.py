"""Frames of an MCAP file: a recording of Trepid, or of others with ``sensor_msgs``."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema

from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.reader import records
from trepid.spelling import did_you_mean
from trepid.types import Image
from trepid.wire import WireError
from vehicle.cameras.playback import Playback, PlaybackSettings, Shot, recording_path
from vehicle.cameras.ros_images import TYPES, RosImage, ros_image
from vehicle.cameras.source import Drive


class McapSettings(PlaybackSettings):
    """Block ``mcap`` of ``config/camera_source.yaml``."""

    topic: str | None = None  # None: the only one with images


class McapFile(Playback):
    """The images of one topic, by the stamps of their headers; by the time of logging where a stamp is zero."""

    Settings = McapSettings

    def __init__(self, settings: McapSettings, drive: Drive) -> None:
        path = recording_path(settings.path)
        topics = image_topics(path)
        topic = _chosen(settings.topic, topics, path)
        begin = partial(mcap_shots, path, topic, topics[topic])
        try:
            super().__init__(begin, now_s=drive.now_s, pace=settings.pace, loop=settings.loop)
        except InputError as error:
            raise InputError(f"{path}: {topic}: {error}") from error


def image_topics(path: Path) -> dict[str, str]:
    """Type by topic of the topics with images. Raises InputError when ``path`` is no MCAP file."""
    schemas: dict[int, Schema] = {}
    channels: list[Channel] = []
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (McapError, ValueError, EOFError):
        summary = None  # cut short: the summary is at the end
    if summary is not None and summary.channels:
        schemas, channels = summary.schemas, list(summary.channels.values())
    else:
        for record in records(path):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels.append(record)
    named = [(channel, schemas.get(channel.schema_id)) for channel in channels]
    return {
        channel.topic: schema.name
        for channel, schema in named
        if schema is not None and schema.name in TYPES and channel.message_encoding == "cdr"
    }


def _chosen(wanted: str | None, topics: dict[str, str], path: Path) -> str:
    if not topics:
        raise InputError(f"{path}: holds no topic with {' or '.join(TYPES)} in CDR, as ROS 2 records them")
    if wanted is None:
        if len(topics) > 1:
            raise InputError(
                f"{path}: holds several topics with images; set topic to one of {', '.join(topics)}"
            )
        return next(iter(topics))
    for name in (wanted, f"/{wanted}"):
        if name in topics:
            return name
    raise InputError(f"{path}: no topic {wanted!r} with images; {did_you_mean(wanted, topics)}")


def mcap_shots(path: Path, topic: str, ros_type: str) -> Iterator[Shot]:
    """The images of ``topic`` in the order of the file."""
    ids: set[int] = set()
    for record in records(path):
        if isinstance(record, Channel) and record.topic == topic:
            ids.add(record.id)
        elif isinstance(record, Message) and record.channel_id in ids:
            where = f"{path}: {topic} at {seconds(record.log_time):.3f} s"
            try:
                image = ros_image(record.data, ros_type)
            except WireError as error:
                raise InputError(f"{where}: {error}") from error
            stamp_s = seconds(record.log_time) if image.stamp_s is None else image.stamp_s
            yield Shot(stamp_s, partial(_decoded, image, where))


def _decoded(image: RosImage, where: str) -> Image:
    try:
        return image.decode()
    except WireError as error:
        raise InputError(f"{where}: {error}") from error
