"""A node applied to every frame of images, folders and videos: results, annotated copies and tables."""

import json
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Set
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from rich.console import Console
from rich.table import Table

from cockpit.footage.annotate import AnnotationWriter
from cockpit.footage.sources import FILM_SUFFIXES, Source, settings_of, sources
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS
from trepid.loudness import warn
from trepid.messages import Frame
from trepid.types import Image

R = TypeVar("R")
Step = Callable[[Frame], R]
CameraFor = Callable[[Source, Image], Camera]
Build = Callable[[Source, Camera], Step[R]]
PIPE_WIDTH = 200  # columns of a table that is not printed in a terminal


@dataclass(frozen=True, slots=True)
class FrameResult(Generic[R]):
    """The result of one frame."""

    path: Path
    number: int  # of the frame in its file or drive
    t_s: float  # of the capture; from 0 on but in a recording
    image: Image
    camera: Camera
    result: R
    latency_ms: float
    fps: float = NOMINAL_FPS  # of its source


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet(Generic[R]):
    """How results of one kind are shown."""

    as_row: Callable[[FrameResult[R]], dict[str, Any]]  # the object of JSON
    columns: Sequence[str]  # of the table
    left: Set[str]  # columns aligned to the left
    cells: Callable[[FrameResult[R]], list[str]]  # a row of the table
    draw: Callable[[FrameResult[R]], Image]  # the annotated frame


class Unread:
    """The images of folders that could not be read: each is named on standard error and left out."""

    def __init__(self, *, strict: bool) -> None:
        """``strict``: the first one ends the run with its error."""
        self._strict = strict
        self.count = 0

    def __call__(self, error: InputError) -> None:
        """Report ``error``. Raises it when strict."""
        if self._strict:
            raise error
        warn(f"{error}; left out")
        self.count += 1


def results(
    inputs: Iterable[Path],
    camera_for: CameraFor,
    build: Build[R],
    unread: Unread,
    *,
    drive_fps: float | None = None,
) -> Generator[FrameResult[R], None, None]:
    """The result of every frame of every input.

    A still gets a step of its own; a clip, a recording, and with ``drive_fps`` a folder get one for all frames. The
    settings of a recorded car are in use while its frames are read.
    ``unread`` gets unreadable images of folders. Raises InputError at the first other input that cannot be read.
    """
    for path in inputs:
        for source in sources(path, drive_fps=drive_fps):
            with settings_of(source):
                yield from _of_source(source, camera_for, build, unread)


def _of_source(
    source: Source, camera_for: CameraFor, build: Build[R], unread: Unread
) -> Iterator[FrameResult[R]]:
    step: Step[R] | None = None
    for path, number, t_s, image in source.shots(unread):
        if step is None:
            camera, first = camera_for(source, image), image.shape
            step = build(source, camera)
        elif image.shape != first:
            sizes = (f"{shape[1]} x {shape[0]} px" for shape in (image.shape, first))
            unread(InputError(f"{path}: {', but the first image of the drive has '.join(sizes)}"))
            continue
        started_s = time.perf_counter()
        result = step(Frame(t_s=t_s, image=image))
        latency_ms = 1e3 * (time.perf_counter() - started_s)
        yield FrameResult(path, number, t_s, image, camera, result, latency_ms, source.fps)


def write_frames(
    found: Iterator[FrameResult[R]],
    inputs: Iterable[Path],
    out: Path,
    draw: Callable[[FrameResult[R]], Image],
) -> Iterator[FrameResult[R]]:
    """``found`` in ``inputs``, each frame also written to ``out`` as ``draw`` gives it. Raises InputError."""
    with closing(AnnotationWriter(out, inputs)) as writer:
        for one in found:
            is_clip = one.path.suffix.lower() in FILM_SUFFIXES
            writer.write(draw(one), one.path, is_clip=is_clip, fps=one.fps)
            yield one


def show(
    found: Iterator[FrameResult[R]],
    sheet: Sheet[R],
    inputs: Iterable[Path],
    *,
    annotate: Path | None,
    as_json: bool,
) -> None:
    """Print what is ``found`` in ``inputs`` as it comes, and write annotated frames. Raises InputError."""
    if annotate is not None:
        found = write_frames(found, inputs, annotate, sheet.draw)
    if as_json:
        print_json(map(sheet.as_row, found))
    else:
        print_table(sheet.columns, sheet.left, map(sheet.cells, found))


def print_json(rows: Iterable[dict[str, Any]]) -> None:
    """One JSON object a line, printed at once."""
    for row in rows:
        print(json.dumps(row, allow_nan=False), flush=True)


def print_table(columns: Iterable[str], left: Set[str], rows: Iterable[list[str]]) -> None:
    """A table with the columns of ``left`` aligned to the left; the rows before an error are printed too."""
    table = Table(box=None, header_style="bold")
    for name in columns:
        table.add_column(name, justify="left" if name in left else "right")
    try:
        for row in rows:
            table.add_row(*row)
    finally:
        if table.row_count:
            Console(width=None if sys.stdout.isatty() else PIPE_WIDTH).print(table)
