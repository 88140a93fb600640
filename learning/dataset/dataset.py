"""A data set: the rows of ``index.parquet`` and ``dataset.yaml`` in one folder, and the images that they name.

A row of the index is a frame of a drive:

    frame           int64    number in the order of its route, from 0 on
    source          int32    index into ``sources`` of dataset.yaml
    image           string   path below the image root of the source: an image file, a video or a recording
    item            int64    number of the frame inside a video or recording; -1: an image file
    t_s             float64  time of the capture [s]
    route           string
    stretch         int32    number, within the data set, of a piece without pauses
    road_wheel_rad  float64  angle a kinematic vehicle would need [rad], + = left; NaN: no label
    speed_mps       float64  [m/s]; NaN: not known
    split           string   train, validation, test; none: left out, or in the gap between two splits
    why             string   the reason of ``none``, else empty
    camera_left_m   float64  place of the camera to the left of the middle one [m]; other than 0: a side camera,
                             whose label is not recorded but leads back to the path (:mod:`learning.dataset.sides`)
    light           float32  mean grey of the image, 0 to 1; NaN: cannot be read
    hash            uint64   difference hash of the image (:mod:`learning.dataset.likeness`)
    change          float32  mean difference of its small grey copy from the frame before, 0 to 1; NaN: none before
    shift           float32  shift of the upper half of the view since the frame before, in widths, + = to the right
                             (the car turns left); NaN: not known
    yaw_rate_radps  float32  recorded yaw rate, + = to the left; NaN: not known

``data_sha256`` is the SHA-256 of the columns of DATA in this order, of all rows: little-endian numbers, and strings
in UTF-8 with a zero byte after each; ``camera_left_m`` counts where there is a side camera. It does not depend on
the version of Parquet, nor on how images are decoded.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from learning.dataset.pictures import PictureReader
from trepid.config import InputError, Settings, load
from trepid.types import Image, NonNegative, Positive, Share

VERSION = 1
INDEX, CARD = "index.parquet", "dataset.yaml"
DATA = MappingProxyType(
    {
        "frame": "<i8",
        "source": "<i4",
        "image": "str",
        "item": "<i8",
        "t_s": "<f8",
        "route": "str",
        "stretch": "<i4",
        "road_wheel_rad": "<f8",
        "speed_mps": "<f8",
        "split": "str",
        "why": "str",
        "camera_left_m": "<f8",
    }
)
"""Column of the index -> its type."""
MEASURED = MappingProxyType(
    {"light": "<f4", "hash": "<u8", "change": "<f4", "shift": "<f4", "yaw_rate_radps": "<f4"}
)
"""Columns that describe the drive, and are not learned."""
SPLITS = ("train", "validation", "test")
NONE = "none"
Rows = NDArray[np.void]
"""Rows of the index: a structured array with the columns of DATA and MEASURED as its fields."""


class Source(Settings):
    """A log of a drive and its images."""

    kind: str
    path: Path  # of the log: file or folder; a relative path is relative to the folder of the data set
    root: Path  # the folder that ``image`` is relative to; likewise
    sha256: str  # of the log
    rows: int  # of the log, those that cannot be read included
    unread: int = 0  # rows of the log that cannot be read, and have no row in the index
    topic: str | None = None  # of the images in a recording
    licence: str | None = None  # as the MANIFEST beside the log states it
    notes: tuple[str, ...] = ()  # what was chosen while reading


class Wheel(Settings):
    """How recorded steering became a road-wheel angle: δ = sign·steering·lock, or sign·angle/ratio."""

    lock_rad: Positive | None  # road-wheel angle of full steering; None: the log holds angles
    how: str  # "car file …", "fitted: …", "assumed …", "given", "angles in the log"
    sign: Literal[1, -1]  # -1: the log is positive to the right
    ratio: Positive = (
        1.0  # steering-wheel angle / road-wheel angle, of a log with angles of the steering wheel
    )
    k_us: float = 0.0  # understeer gradient [rad/(m/s²)] that was removed at the recorded speed
    wheelbase_m: Positive | None = None  # None: not known, and no understeer was removed


class Split(Settings):
    """How rows were divided."""

    by: Literal["time", "route"]
    seed: int
    gap_s: NonNegative  # left out on both sides of a border together
    shares: dict[Literal["train", "validation", "test"], Share]
    test_routes: tuple[str, ...] = ()


class DatasetFile(Settings):
    """``dataset.yaml``."""

    version: int
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]
    wheel: Wheel
    split: Split
    leave_out: tuple[str, ...] = ()  # rules of the clean-up
    command: str = ""  # that built it
    data_sha256: str


class Dataset:
    """A data set that was built. Images are read when they are asked for."""

    def __init__(self, folder: Path, file: DatasetFile, index: Rows) -> None:
        self.folder, self.file, self._index = folder, file, index
        self.wheel, self.sha256 = file.wheel, file.data_sha256
        self._pictures: dict[int, PictureReader] = {}

    @classmethod
    def open(cls, folder: Path) -> Self:
        """The data set in ``folder``. Raises InputError when it is none, of another version, or was changed."""
        if not (folder / CARD).is_file():
            raise InputError(
                f"{folder}: no data set: no {CARD}; `trepid dataset build {folder} SOURCE` makes one"
            )
        file = load(folder / CARD, DatasetFile)
        if file.version != VERSION:
            raise InputError(f"{folder / CARD}: version {file.version}, expected {VERSION}: build it again")
        index = read_index(folder / INDEX)
        if sha256_of(index) != file.data_sha256:
            raise InputError(f"{folder / INDEX}: was changed after the data set was built: build it again")
        if len(index) and not 0 <= index["source"].min() <= index["source"].max() < len(file.sources):
            raise InputError(f"{folder / INDEX}: names a source that {CARD} does not have")
        return cls(folder, file, index)

    def __len__(self) -> int:
        return len(self._index)

    def rows(self, split: str | None = None) -> Rows:
        """The rows of a split, or all; in the order of routes and time.

        Rows of train, validation and test have a label and a readable image. Raises InputError for another name.
        """
        if split is None:
            return self._index
        if split not in (*SPLITS, NONE):
            raise InputError(f"no split {split!r}; there are {', '.join((*SPLITS, NONE))}")
        return self._index[self._index["split"] == split]

    def labelled_rows(self, split: str) -> Rows:
        """The rows of a split that have a label. Raises InputError without any, with what makes some."""
        rows = self.rows(split)
        rows = rows[np.isfinite(rows["road_wheel_rad"])]
        if len(rows):
            return rows
        rule = self.file.split
        share = rule.shares.get(split, 1.0)  # type: ignore[call-overload]  # also of the split of the others
        remedy = (
            f"with a longer drive, or with less than --gap-s {rule.gap_s:g}"
            if share > 0
            else "with --shares that give it some"
        )
        there = {name: int((self._index["split"] == name).sum()) for name in (*SPLITS, NONE)}
        held = ", ".join(f"{name} {count}" for name, count in there.items())
        raise InputError(
            f"{self.folder}: no labelled frame in the split {split!r} ({held}): build it again {remedy}"
        )

    def image(self, row: np.void) -> Image:
        """The image of a row: uint8, (height, width, 3), BGR. Raises InputError.

        Videos and recordings are read on from the last frame; an earlier frame starts them again.
        """
        return self._pictures_of(int(row["source"])).read(str(row["image"]), int(row["item"]))

    def images(self, rows: Rows) -> Iterator[Image]:
        """The images of ``rows`` in their order; fast when the rows are in the order of the index."""
        for row in rows:
            yield self.image(row)

    def _pictures_of(self, source: int) -> PictureReader:
        if source not in self._pictures:
            described = self.file.sources[source]
            root = self.folder / described.root
            if not root.is_dir():
                raise InputError(
                    f"{root}: the images of {self.folder} are not there any more: build it again"
                )
            self._pictures[source] = PictureReader(root, described.topic)
        return self._pictures[source]


def middle_rows(rows: Rows) -> Rows:
    """Those of ``rows`` with a recorded label: the frames of the middle camera."""
    return rows[rows["camera_left_m"] == 0.0]


def as_rows(columns: dict[str, Any]) -> Rows:
    """Columns of equal length as rows."""
    arrays = {
        name: np.asarray(columns[name], dtype=None if kind == "str" else kind)
        for name, kind in {**DATA, **MEASURED}.items()
    }
    types = {
        name: np.dtype("<U1") if not len(array) and DATA.get(name) == "str" else array.dtype
        for name, array in arrays.items()
    }
    rows = np.empty(len(arrays["frame"]), dtype=list(types.items()))
    for name, array in arrays.items():
        rows[name] = array
    return rows


def pieces_of(rows: Rows) -> NDArray[np.int64]:
    """Number of the piece of each row, from 0 on: rows of a route and stretch that follow each other in `frame`."""
    same = [rows[name][1:] == rows[name][:-1] for name in ("route", "stretch")]
    follows = np.logical_and.reduce([*same, rows["frame"][1:] == rows["frame"][:-1] + 1])
    return np.cumsum(np.concatenate([[False], ~follows]))[: len(rows)]


def sha256_of(rows: Rows) -> str:
    """``data_sha256`` of ``rows``."""
    digest = hashlib.sha256()
    for name, kind in DATA.items():
        if name == "camera_left_m" and not rows[name].any():
            continue
        if kind == "str":
            digest.update("".join(f"{text}\0" for text in rows[name].tolist()).encode())
        else:
            digest.update(np.ascontiguousarray(rows[name], dtype=kind).tobytes())
    return digest.hexdigest()


def need_arrow() -> None:
    """Raises InputError unless pyarrow is installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise InputError("data sets need pyarrow: pip install 'trepid[report]'") from error


def read_index(path: Path) -> Rows:
    """The rows of an index. Raises InputError when it is no Parquet file, or lacks a column."""
    need_arrow()
    import pyarrow as pa
    import pyarrow.parquet

    if not path.is_file():
        raise InputError(f"{path}: no such file: build the data set again")
    try:
        table = pa.parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from error
    if "camera_left_m" not in table.column_names:  # written before there were side cameras
        table = table.append_column("camera_left_m", pa.array(np.zeros(len(table))))
    missing = [name for name in (*DATA, *MEASURED) if name not in table.column_names]
    if missing:
        raise InputError(f"{path}: no column {missing[0]}: not the index of a data set")
    try:
        return as_rows({name: table[name].to_numpy() for name in (*DATA, *MEASURED)} | _texts(table))
    except (ValueError, TypeError, pa.ArrowException) as error:
        raise InputError(f"{path}: not the index of a data set: {error}") from error


def _texts(table: Any) -> dict[str, Any]:
    return {
        name: np.array(table[name].to_pylist(), dtype=str) for name, kind in DATA.items() if kind == "str"
    }


def check_place(folder: Path) -> None:
    """Raise InputError where ``folder`` has a file of the name CARD that is not of a data set."""
    if (folder / CARD).exists():
        try:
            load(folder / CARD, DatasetFile)
        except InputError as error:
            raise InputError(
                f"{folder}: nothing is written here, for its {CARD} is not that of a data set: {error}"
            ) from error


def write(folder: Path, file: DatasetFile, rows: Rows) -> None:
    """Write a data set; dataset.yaml comes last, so that a folder with it is complete. Raises InputError."""
    need_arrow()
    import pyarrow as pa
    import pyarrow.parquet
    from ruamel.yaml import YAML

    def column(name: str) -> Any:
        return pa.array(rows[name].tolist() if DATA.get(name) == "str" else rows[name])

    index, card = folder / f"{INDEX}.partial", folder / f"{CARD}.partial"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        pa.parquet.write_table(pa.table({name: column(name) for name in rows.dtype.names or ()}), index)
        yaml = YAML()
        yaml.width = 1000
        with card.open("w", encoding="utf-8") as stream:
            yaml.dump(file.model_dump(mode="json"), stream)
        (folder / CARD).unlink(missing_ok=True)
        index.replace(folder / INDEX)
        card.replace(folder / CARD)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from error
