"""Recordings: MCAP files with the ROS 2 CDR bytes exactly as they were on the bus.

They open in Foxglove, Lichtblick and `ros2 bag` with no knowledge of Trepid: every channel carries its definition.
The camera is recorded compressed; the raw images stay on the bus.
"""

from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from trepid import __version__
from trepid.bus import Bus
from trepid.clock import nanoseconds
from trepid.config import InputError
from trepid.topics import topic_of
from trepid.wire import definition, ros_name

RECORDED = (
    "camera/image/compressed",
    "perception/**",
    "supervisor/**",
    "controller/**",
    "vehicle/**",
    "sim/**",
)


class Recording:
    """One MCAP file being written. Use as a context manager. Raises InputError when it cannot be created."""

    def __init__(self, path: Path, bus: Bus) -> None:
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        self._tap = bus.tap(*RECORDED, "diagnostics")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=f"trepid {__version__}")
        self._channels: dict[str, int] = {}

    def __enter__(self) -> "Recording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.write()
        self._writer.finish()
        self._file.close()

    def write(self) -> None:
        """Write everything that came since the last call."""
        for key, data, received_s in self._tap.drain():
            stamp_ns = nanoseconds(received_s)
            self._writer.add_message(
                channel_id=self._channel(key), log_time=stamp_ns, publish_time=stamp_ns, data=data
            )

    def _channel(self, key: str) -> int:
        if key not in self._channels:
            topic = topic_of(key)
            schema = 0  # a topic that we do not know is kept without a definition
            if topic is not None:
                text = definition(topic.type).encode()
                schema = self._writer.register_schema(ros_name(topic.type), "ros2msg", text)
            self._channels[key] = self._writer.register_channel(f"/{key}", "cdr", schema)
        return self._channels[key]
