"""Tables (CSV) with an image, a steering value and a time a row.

Two forms: ``driving_log.csv`` of the Udacity behavioural-cloning simulator (center, left, right, steering,
throttle, brake, speed in mph; with or without a header; times in the names of the images; ±1 is ±25° and positive
to the right), and any table with a header, whose columns are found by their names in COLUMNS or named by
``--column``. Images of a left and a right camera are read where their distance is given.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from types import MappingProxyType

import numpy as np

from learning.dataset.sources.log import Faults, Log, SteeringUnit, number, refuse_beyond_lock
from learning.dataset.sources.written_paths import ImageFolder
from trepid.config import InputError
from trepid.recording.csv_file import (
    MPS_PER_MPH,
    Row,
    column_names,
    read_rows,
    refuse_halved_numbers,
    refuse_rounded_times,
    seconds_of_date,
)
from trepid.spelling import did_you_mean
from trepid.types import Column

DEG = math.pi / 180.0
UDACITY = ("center", "left", "right", "steering", "throttle", "brake", "speed")
UDACITY_LOCK_DEG = 25.0
UDACITY_STAMP = re.compile(r"_(\d{4}_\d\d_\d\d_\d\d_\d\d_\d\d_\d{1,3})\.\w+$")

# Quantity -> its names in a table, and their factors to SI.
COLUMNS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "image": dict.fromkeys(("image", "filename", "file", "frame_path", "path", "center", "img"), 1.0),
        "left image": dict.fromkeys(("left", "left_image", "image_left"), 1.0),
        "right image": dict.fromkeys(("right", "right_image", "image_right"), 1.0),
        "frame": dict.fromkeys(("frame", "frame_number", "frame_index"), 1.0),
        "time": {
            "t_s": 1.0,
            "time_s": 1.0,
            "timestamp_s": 1.0,
            "timestamp_ms": 1e-3,
            "_timestamp_ms": 1e-3,
            "timestamp_ns": 1e-9,
        },
        "road wheel": {"road_wheel_angle_rad": 1.0, "road_wheel_angle_deg": DEG},
        "steering wheel": {
            "steering_wheel_angle_rad": 1.0,
            "steering_wheel_angle_deg": DEG,
            "steering_wheel_deg": DEG,
        },
        "lock": dict.fromkeys(
            ("user_angle", "user/angle", "steering", "steer", "angle", "steering_angle"), 1.0
        ),
        "speed": {"speed_mps": 1.0, "speed_kmh": 1 / 3.6, "speed_mph": MPS_PER_MPH},
        "yaw rate": {"yaw_rate_radps": 1.0, "yaw_rate_dps": DEG},
        "route": dict.fromkeys(("route", "drive", "session"), 1.0),
    }
)
SIDES = ("left image", "right image")
ANGLES = ("road wheel", "steering wheel", "lock")
NAMES = tuple(name for names in COLUMNS.values() for name in names)


@dataclass(frozen=True, slots=True)
class TableOptions:
    """What a table does not say itself."""

    renamed: Mapping[str, str] = field(default_factory=dict)  # name of COLUMNS -> column of the table
    fps: float | None = None  # of rows without times
    video: Path | None = None  # that holds the frames; None: image files
    side_camera_m: float | None = None  # of the left and the right camera from the middle one; None: not read


def read_table(path: Path, faults: Faults, options: TableOptions) -> Log:
    """The rows of a table; an image is sought below the folder of the table. Raises InputError."""
    if options.video is not None and not options.video.is_file():
        raise InputError(f"--video {options.video}: no such file")
    rows = read_rows(path)
    header = column_names(rows[0], {*NAMES} - {*options.renamed.values()})
    if UDACITY_STAMP.search(header[0]):
        refuse_halved_numbers(path, rows, len(UDACITY))
    if _is_udacity(header) and not options.renamed:
        has_header = tuple(name.lower() for name in header) == UDACITY
        log = _udacity(path, rows[1:] if has_header else rows, faults, options)
    else:
        log = _log_of_columns(path, header, rows[1:], faults, options)
    _refuse_shared_images(log)
    return log


def _refuse_shared_images(log: Log) -> None:
    """Raise InputError where a side camera has the image of the middle one: their folders are missing."""
    for side, images in (("left", log.left), ("right", log.right)):
        for row, (image, middle) in enumerate(zip(images, log.image, strict=False)):
            if image and image == middle:
                raise InputError(
                    f"{log.place(row)}: the {side} camera and the middle one have one image, {image}"
                )


def _is_udacity(header: list[str]) -> bool:
    if tuple(name.lower() for name in header) == UDACITY:
        return True
    return len(header) == len(UDACITY) and UDACITY_STAMP.search(header[0]) is not None


def _udacity(path: Path, rows: list[Row], faults: Faults, options: TableOptions) -> Log:
    found, names, where, before = [], [], [], faults.rows
    sides: list[tuple[str, str]] = []
    images = ImageFolder(path.parent)
    for line, row in ((row.line, row.cells) for row in rows):
        try:
            if len(row) != len(UDACITY):
                raise ValueError(f"expected {len(UDACITY)} columns, got {len(row)}")
            found.append((_stamp_s(row[0]), number(row[3].strip()), MPS_PER_MPH * number(row[6].strip())))
            names.append(images.find(row[0].strip()))
            sides.append((_side_image(images, row[1]), _side_image(images, row[2])))
            where.append(f"{path}:{line}")
        except ValueError as error:
            faults(f"{path}:{line}: {error}")
    if not found:
        raise InputError(f"{path}: no row can be read")
    t_s, steering, speed_mps = np.array(found, dtype=np.float64).T
    log = _log("udacity", path, names, t_s, steering, SteeringUnit.LOCK, where)
    log.speed_mps, log.unread = speed_mps, faults.rows - before
    log.lock_rad, log.lock_source = math.radians(UDACITY_LOCK_DEG), "of the Udacity simulator"
    left, right = (list(side) for side in zip(*sides, strict=True))
    if options.side_camera_m is not None:
        log.left, log.right = left, right
    elif any(left) or any(right):
        log.notes.append("images of the centre camera; those of left and right need --side-camera-m")
    return log


def _stamp_s(image: str) -> float:
    """The time in the name of an image of the Udacity simulator. Raises ValueError."""
    stamp = UDACITY_STAMP.search(image)
    if stamp is None:
        raise ValueError(f"no time in the name of the image {image!r}")
    seconds, _, milli = stamp.group(1).rpartition("_")
    return datetime.strptime(f"{seconds}+0000", "%Y_%m_%d_%H_%M_%S%z").timestamp() + int(milli) / 1e3


def _side_image(images: ImageFolder, cell: str) -> str:
    """The image of a side camera; empty without one."""
    return images.find(cell.strip()) if cell.strip() else ""


def _log_of_columns(
    path: Path, header: list[str], rows: list[Row], faults: Faults, options: TableOptions
) -> Log:
    at, names = _choose_columns(path, header, options)
    if "time" in at and options.fps is not None:
        raise InputError(f"{path}:1: has times in the column {header[at['time']]!r}; leave out --fps")
    angle = next(quantity for quantity in ANGLES if quantity in at)
    texts: dict[str, list[str]] = {"image": [], "route": [], "where": [], **{side: [] for side in SIDES}}
    numbers: list[list[float]] = []
    numeric = [quantity for quantity in ("frame", "time", angle, "speed", "yaw rate") if quantity in at]
    before, images = faults.rows, ImageFolder(path.parent)
    for ordinal, (line, row) in enumerate((row.line, row.cells) for row in rows):
        try:
            if len(row) != len(header):
                raise ValueError(f"expected {len(header)} columns, got {len(row)}")
            values = [_scaled_number(row[at[quantity]], names[quantity]) for quantity in numeric]
            _check_counted(dict(zip(numeric, values, strict=True)))
            image = "" if options.video else images.find(row[at["image"]].strip())
        except ValueError as error:
            faults(f"{path}:{line}: {error}")
            continue
        numbers.append([ordinal, *values])
        texts["image"].append(image)
        texts["route"].append(row[at["route"]].strip() if "route" in at else "")
        texts["where"].append(f"{path}:{line}")
        for side in SIDES:
            texts[side].append(_side_image(images, row[at[side]]) if side in at else "")
    if not numbers:
        raise InputError(f"{path}: no row can be read")
    columns = dict(zip(("row", *numeric), np.array(numbers, dtype=np.float64).T, strict=True))
    if "time" in columns:
        refuse_rounded_times(path, header[at["time"]], columns["time"], texts["route"])
    t_s = columns["time"] if "time" in columns else columns["row"] / (options.fps or math.nan)
    log = _log("table", path, texts["image"], t_s, columns[angle], SteeringUnit(angle), texts["where"])
    if any(texts["route"]):
        log.route = [f"{path.parent.name}/{route}" for route in texts["route"]]
    _name_film_frames(log, columns.get("frame", columns["row"]), options)
    log.speed_mps = columns.get("speed", log.speed_mps)
    log.yaw_rate_radps = columns.get("yaw rate", log.yaw_rate_radps)
    log.left, log.right = (texts[side] for side in SIDES)
    log.unread = faults.rows - before
    log.left_positive = angle != "lock"
    log.notes.append("columns: " + ", ".join(f"{quantity} = {header[at[quantity]]}" for quantity in at))
    if angle == "lock":
        name = header[at[angle]]
        unit = f"name its unit, for example --column steering_wheel_angle_deg={name}"
        refuse_beyond_lock(f"{path}:1: column {name}", columns[angle], unit)
        log.lock_rad, log.lock_source = math.radians(UDACITY_LOCK_DEG), "the table does not have it"
    return log


def _choose_columns(
    path: Path, header: list[str], options: TableOptions
) -> tuple[dict[str, int], dict[str, str]]:
    """Place of the column of each quantity, and the name whose unit it has. Raises InputError."""
    strange = [name for name in options.renamed if name not in NAMES]
    if strange:
        raise InputError(f"--column {strange[0]}: no such name; {did_you_mean(strange[0], set(NAMES))}")
    at, names = {}, {}
    named = {
        quantity: [name for name in known if name in options.renamed] for quantity, known in COLUMNS.items()
    }
    if options.side_camera_m is None and (sides := [name for side in SIDES for name in named[side]]):
        raise InputError(f"--column {sides[0]}: needs --side-camera-m")
    named_angles = [quantity for quantity in ANGLES if named[quantity]]
    unused = {"frame"} if options.video is None else {"image", *SIDES}
    unused |= set() if options.side_camera_m is not None else {*SIDES}
    if named_angles:
        unused |= {*ANGLES} - {named_angles[0]}
    for several in (*named.values(), [name for quantity in ANGLES for name in named[quantity]]):
        if len(several) > 1:
            raise InputError(f"--column {several[0]} and {several[1]}: two columns for one quantity")
    taken = set(options.renamed.values())
    for quantity, known in COLUMNS.items():
        if quantity in unused:
            continue
        found = named[quantity] or [name for name in known if name in header and name not in taken]
        if not found:
            continue
        name = found[0]
        column = options.renamed.get(name, name)
        if column not in header:
            raise InputError(f"{path}:1: no column {column!r}; there are {', '.join(header)}")
        if header.count(column) > 1:
            raise InputError(
                f"{path}:1: {header.count(column)} columns {column!r}: which one holds the values is not known"
            )
        at[quantity], names[quantity] = header.index(column), name
    need = {
        "an image": options.video is not None or "image" in at,
        "a time (or give --fps)": "time" in at or options.fps is not None,
        "the steering": any(quantity in at for quantity in ("road wheel", "steering wheel", "lock")),
    }
    for what, there in need.items():
        if not there:
            raise InputError(
                f"{path}:1: no column for {what} among {', '.join(header)}; name it by --column NAME=COLUMN"
            )
    return at, names


def _scaled_number(text: str, name: str) -> float:
    if name in COLUMNS["time"] and (date_s := seconds_of_date(text.strip())) is not None:
        return date_s
    factor = next(names[name] for names in COLUMNS.values() if name in names)
    return factor * number(text.strip())


def _check_counted(values: Mapping[str, float]) -> None:
    """Raise ValueError for a row without time, and for a frame number of a video that is none."""
    if "time" in values and math.isnan(values["time"]):
        raise ValueError("no time")
    frame = values.get("frame", 0.0)
    if not (0.0 <= frame < 2**53 and frame.is_integer()):
        raise ValueError(f"expected the number of a frame, got {frame:g}")


def _name_film_frames(log: Log, frame: Column, options: TableOptions) -> None:
    """Let the rows name frames of the video by their numbers."""
    if options.video is None:
        return
    log.root = options.video.parent
    log.image = [options.video.name] * len(log)
    log.item = frame.astype(np.int64)


def _log(
    kind: str,
    path: Path,
    image: list[str],
    t_s: Column,
    steering: Column,
    unit: SteeringUnit,
    where: list[str],
) -> Log:
    unknown = np.full(len(image), math.nan)
    return Log(
        kind=kind,
        path=path,
        root=path.parent,
        files=(path,),
        image=image,
        item=np.full(len(image), -1),
        t_s=t_s,
        route=[path.parent.name] * len(image),
        steering=steering,
        speed_mps=unknown,
        yaw_rate_radps=unknown,
        why=[""] * len(image),
        where=where,
        unit=unit,
        left_positive=False,
    )
