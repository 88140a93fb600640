"""Image messages and MCAP files as other ROS 2 software writes them: by rosbags, without any code of Trepid."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types


def header(stamp_ns: int) -> Any:
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def image(data: np.ndarray, encoding: str, *, stamp_ns: int = 0, padding: int = 0) -> bytes:
    """A ``sensor_msgs/Image`` from bytes, shape (height, width, bytes per pixel); padding follows each row."""
    height, width = data.shape[:2]
    rows = np.pad(data.reshape(height, -1), ((0, 0), (0, padding)), constant_values=7)
    message = TYPES["sensor_msgs/msg/Image"](
        header=header(stamp_ns),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.reshape(-1),
    )
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def compressed_image(picture: np.ndarray, suffix: str = ".jpg", *, stamp_ns: int = 0) -> bytes:
    """A ``sensor_msgs/CompressedImage``."""
    return compressed_bytes(cv2.imencode(suffix, picture)[1].tobytes(), suffix, stamp_ns=stamp_ns)


def compressed_bytes(data: bytes, suffix: str, *, stamp_ns: int = 0) -> bytes:
    """A ``sensor_msgs/CompressedImage`` of these bytes."""
    message = TYPES["sensor_msgs/msg/CompressedImage"](
        header=header(stamp_ns), format=suffix.removeprefix("."), data=np.frombuffer(data, np.uint8)
    )
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def bag(folder: Path, topics: dict[str, tuple[str, list[tuple[int, bytes]]]]) -> Path:
    """The MCAP file of a rosbag2 with ``topics``: name -> type, and time of logging [ns] and CDR by message."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, (ros_type, messages) in topics.items():
            connection = writer.add_connection(topic, ros_type, typestore=STORE)
            for at_ns, data in messages:
                writer.write(connection, at_ns, data)
    (path,) = folder.glob("*.mcap")
    return path


def damage_chunk(path: Path, number: int) -> None:
    """Overwrite bytes in the middle of the chunk ``number`` of a recording."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)[number]
    data = bytearray(path.read_bytes())
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    data[middle : middle + 8] = b"\x55" * 8
    path.write_bytes(data)
