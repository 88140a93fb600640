"""Recordings: MCAP files with the ROS 2 CDR bytes exactly as they were on the bus.

They open in Foxglove, Lichtblick and `ros2 bag` without Trepid: every channel contains its definition. The camera
is recorded as JPEG; raw images only where they are asked for. The rule file and the files of the car are attached,
and a metadata record gives the start of the drive and what the nodes were built with.

After a crash at most the last half second is missing: see FLUSH_S and :mod:`trepid.recording.reader`.

The index of the chunks is kept small until the end: an MCAP file ends with one index record a chunk. The writer of
the package `mcap` keeps each of them as an object until then: 1.4 kB with 16 channels, four times a second. The
record itself takes 0.3 kB.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from mcap.data_stream import RecordBuilder
from mcap.writer import CompressionType, Writer

from trepid import __version__
from trepid.bus import Bus
from trepid.clock import nanoseconds
from trepid.config import InputError, car_folder
from trepid.messages import Diagnostic
from trepid.recording.notes import RULES
from trepid.topics import CAMERA_IMAGE, topic_of
from trepid.wire import definition, ros_name

KEPT = "_Writer__chunk_indices"
"""The list of a writer that holds the indices; the package has no public way to it."""


class PackedIndex(bytes):
    """The record of an index, as it is in the file."""

    __slots__ = ()

    def write(self, stream: RecordBuilder) -> None:
        """Append the record to ``stream``."""
        stream.write(self)


class PackedIndices(list[PackedIndex]):
    """A list that takes indices of chunks and keeps their records."""

    def append(self, index: Any) -> None:
        """Keep the record of ``index``, a ``mcap.records.ChunkIndex``."""
        builder = RecordBuilder()
        index.write(builder)
        super().append(PackedIndex(builder.end()))


def pack_indices(writer: Writer) -> None:
    """Let ``writer``, which has written no chunk, keep its indices packed. The file stays the same, byte by byte.

    A version of the package that keeps them elsewhere goes on to do so: it costs memory, and no recording.
    """
    if isinstance(getattr(writer, KEPT, None), list):
        setattr(writer, KEPT, PackedIndices())


RECORDED = (
    "camera/image/compressed",
    *(f"{part}/**" for part in ("perception", "supervisor", "controller", "vehicle", "driver", "sim")),
    "drive/losses",
    "diagnostics",
    "diagnostics/timing",
    "diagnostics/steps",
)
DRIVE, BEGAN = "trepid.drive", "began_ns"  # name of the metadata record and its field
CAR_FILES = "car/"  # beginning of the names of the attached files of a car
FLUSH_S = 0.25  # chunks are closed and handed to the operating system at least this often; costs 10 % in size


def check_free(path: Path) -> None:
    """Raise InputError when a recording at ``path`` would overwrite a file, or has no folder to be written in.

    A disk that is full or read-only is no reason not to drive; :mod:`trepid.recording.node` reports it.
    """
    try:
        if path.exists():
            raise InputError(f"{path}: exists already and is kept; give another name")
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written: no such folder; `mkdir -p {path.parent}` makes it")
        read_only = os.statvfs(path.parent).f_flag & os.ST_RDONLY
        if not read_only and not os.access(path.parent, os.W_OK):
            raise InputError(f"{path}: cannot be written: no right to write in {path.parent}")
    except OSError as error:  # such as a name that is too long
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def check_recording(path: Path) -> None:
    """As :func:`check_free`; also raise InputError for a name by which no verb would take it for a recording."""
    if path.suffix.lower() != ".mcap":
        raise InputError(f"{path}: a recording is an MCAP file: name it {path.name}.mcap")
    check_free(path)


def remove(path: Path) -> None:
    """Delete a file that is not whole, where the disk permits it."""
    with suppress(OSError):
        path.unlink()


def attachments(rules: Path) -> dict[str, bytes]:
    """The files that a recording keeps, by name: rules, and settings of the car in use. Raises InputError."""
    car = car_folder()
    settings = sorted(car.glob("*.yaml")) if car is not None else []
    try:
        kept = {f"{CAR_FILES}{path.name}": path.read_bytes() for path in settings}
        return {rules.name: rules.read_bytes(), **kept}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error


def rules_name(files: Iterable[str]) -> str | None:
    """The name of the rule file among the attached ``files``, which is none of the car; None without one."""
    return next((name for name in files if not name.startswith(CAR_FILES)), None)


def attach_adopted(files: dict[str, bytes], beat: Diagnostic) -> None:
    """Replace the rule file among the attached ``files`` where ``beat`` reports changed rules as adopted."""
    name, text = rules_name(files), dict(beat.values).get(RULES)
    if name is not None and text is not None:
        files[name] = text.encode()


class Recording:
    """One MCAP file being written. Use as a context manager.

    Every method raises InputError when the disk refuses the file; what was written until then stays readable. Of a
    file whose beginning it refuses nothing is left.
    """

    def __init__(
        self,
        path: Path,
        files: Mapping[str, bytes] | None = None,
        notes: Mapping[str, str] | None = None,
        *,
        further: Mapping[str, tuple[str, str]] | None = None,
    ) -> None:
        """``files`` are attached by name; ``notes`` describe the drive. An existing file is never overwritten.

        ``further``: key of a topic that is none of Trepid's -> ROS 2 type and definition.
        """
        self._path, self._further = path, further or {}
        try:
            self._file = path.open("xb")
        except FileExistsError as error:
            raise InputError(f"{path}: exists already and is kept; give another name") from error
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        pack_indices(self._writer)
        self._channels: dict[str, int] = {}
        self._flushed_s: float | None = None
        self._refused = False  # the disk has refused a part
        with ExitStack() as undo:
            undo.callback(remove, path)
            with self._on_disk():
                self._writer.start(profile="ros2", library=f"trepid {__version__}")
                for name, data in (files or {}).items():
                    self._writer.add_attachment(0, 0, name, "application/yaml", data)
                if notes:
                    self._writer.add_metadata(DRIVE, dict(notes))
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._refused:
            with suppress(OSError):  # what is buffered is refused too
                self._file.close()
            return
        with self._on_disk():
            self._writer.finish()
            self._file.close()

    @contextmanager
    def _on_disk(self) -> Iterator[None]:
        """Turn an OSError of the disk into an InputError, once; nothing more is written after it."""
        try:
            yield
        except OSError as error:
            self._refused = True
            with suppress(OSError):
                self._file.close()
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def began(self, t_s: float) -> None:
        """Record that the drive began at ``t_s``; earlier messages belong to the start of the processes."""
        self.began_ns(nanoseconds(t_s))

    def began_ns(self, stamp_ns: int) -> None:
        """As :meth:`began`, with an integer stamp."""
        with self._on_disk():
            self._writer.add_metadata(DRIVE, {BEGAN: str(stamp_ns)})

    def add(self, key: str, data: bytes, *, at_s: float) -> None:
        """Write the CDR bytes of a message that was published at ``at_s``, in order of time.

        A raw image is a chunk of its own, so that a reader of other topics steps over it.
        """
        stamp_ns = nanoseconds(at_s)
        with self._on_disk():
            alone = key == CAMERA_IMAGE.key
            if alone:
                self._writer.flush()
            channel = self._channel(key)
            self._writer.add_message(channel_id=channel, log_time=stamp_ns, publish_time=stamp_ns, data=data)
            if self._flushed_s is None:
                self._flushed_s = at_s
            if alone or at_s - self._flushed_s >= FLUSH_S:
                self._writer.flush()
                self._flushed_s = at_s

    def _channel(self, key: str) -> int:
        if key not in self._channels:
            topic = topic_of(key)
            name, text = self._further.get(key, ("", ""))
            if topic is not None:
                name, text = ros_name(topic.type), definition(topic.type)
            # an unknown topic is recorded without a definition
            schema = self._writer.register_schema(name, "ros2msg", text.encode()) if name else 0
            self._channels[key] = self._writer.register_channel(f"/{key}", "cdr", schema)
        return self._channels[key]


class BusRecorder(Recording):
    """A recording of all topics of a bus."""

    def __init__(
        self,
        path: Path,
        bus: Bus,
        files: Mapping[str, bytes] | None = None,
        notes: Mapping[str, str] | None = None,
        *,
        raw_images: bool = False,
    ) -> None:
        super().__init__(path, files, notes)
        self._tap = bus.tap(*RECORDED, *([CAMERA_IMAGE.key] if raw_images else []))

    def __exit__(self, *_: object) -> None:
        try:
            if not self._refused:
                self.write()
        finally:
            self._tap.close()
            super().__exit__()

    def write(self) -> None:
        """Write all messages since the last call."""
        for key, data, at_s in self._tap.drain():
            self.add(key, data, at_s=at_s)
