"""Recordings: MCAP files with the ROS 2 CDR bytes exactly as they were on the bus.

They open in Foxglove, Lichtblick and `ros2 bag` without Trepid: every channel contains its definition. The camera
is recorded as JPEG, without raw images. Settings files of the drive are attached, and a metadata record gives the
start of the drive.

After a crash at most the last second is missing: see FLUSH_S and :mod:`trepid.recording.reader`.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from mcap.writer import CompressionType, Writer

from trepid import __version__
from trepid.bus import Bus
from trepid.clock import nanoseconds
from trepid.config import InputError
from trepid.topics import topic_of
from trepid.wire import definition, ros_name

RECORDED = (
    "camera/image/compressed",
    *(f"{part}/**" for part in ("perception", "supervisor", "controller", "vehicle", "driver", "sim")),
    "diagnostics",
    "diagnostics/timing",
)
DRIVE, BEGAN = "trepid.drive", "began_ns"  # name of the metadata record and its field
FLUSH_S = 1.0  # chunks are closed and handed to the operating system at least this often; costs 5 % in size


class Recording:
    """One MCAP file being written. Use as a context manager. Raises InputError when it cannot be created."""

    def __init__(self, path: Path, files: Iterable[Path] = ()) -> None:
        """``files`` are attached under their names."""
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=f"trepid {__version__}")
        self._channels: dict[str, int] = {}
        self._flushed_s: float | None = None
        for file in files:
            self._writer.add_attachment(0, 0, file.name, "application/yaml", file.read_bytes())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.finish()
        self._file.close()

    def began(self, t_s: float) -> None:
        """Record that the drive began at ``t_s``; earlier messages belong to the start of the processes."""
        self._writer.add_metadata(DRIVE, {BEGAN: str(nanoseconds(t_s))})

    def add(self, key: str, data: bytes, *, at_s: float) -> None:
        """Write the CDR bytes of a message that was published at ``at_s``, in order of time."""
        stamp_ns = nanoseconds(at_s)
        self._writer.add_message(
            channel_id=self._channel(key), log_time=stamp_ns, publish_time=stamp_ns, data=data
        )
        if self._flushed_s is None:
            self._flushed_s = at_s
        elif at_s - self._flushed_s >= FLUSH_S:
            self._writer.flush()
            self._flushed_s = at_s

    def _channel(self, key: str) -> int:
        if key not in self._channels:
            topic = topic_of(key)
            schema = 0  # an unknown topic is recorded without a definition
            if topic is not None:
                text = definition(topic.type).encode()
                schema = self._writer.register_schema(ros_name(topic.type), "ros2msg", text)
            self._channels[key] = self._writer.register_channel(f"/{key}", "cdr", schema)
        return self._channels[key]


class BusRecorder(Recording):
    """A recording of all topics of a bus."""

    def __init__(self, path: Path, bus: Bus, files: Iterable[Path] = ()) -> None:
        super().__init__(path, files)
        self._tap = bus.tap(*RECORDED)

    def __exit__(self, *_: object) -> None:
        self.write()
        super().__exit__()

    def write(self) -> None:
        """Write all messages since the last call."""
        for key, data, at_s in self._tap.drain():
            self.add(key, data, at_s=at_s)
