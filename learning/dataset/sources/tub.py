"""Tubs of donkeycar, versions 1 and 2.

Version 2 (donkeycar 4 and later): ``manifest.json`` (see :mod:`learning.dataset.sources.tub_manifest`), and
catalogs of one record a line. Version 1: one ``record_<n>.json`` a frame, and ``meta.json`` with the names of the
inputs. In both
``user/angle`` is the share of full steering, -1 to 1, positive to the right.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from learning.dataset.sources.log import Faults, Log, SteeringUnit, number, refuse_beyond_lock
from learning.dataset.sources.tub_manifest import MANIFEST, META, catalogs_in, read_manifest, read_meta
from learning.dataset.sources.written_paths import ImageFolder
from trepid.config import InputError, read_text
from trepid.files.decoding import is_broken
from trepid.images.files import IMAGE_SUFFIXES, natural_order
from trepid.recording.csv_file import refuse_rounded_times

IMAGES = "images"
NUMBERED = re.compile(r"record_\d+\.json")
IMAGE_KEY, ANGLE, MODE = "cam/image_array", "user/angle", "user/mode"
SPEEDS = ("enc/speed", "odom/speed", "pos/speed")  # [m/s]
STAMPS_MS = ("_timestamp_ms", "milliseconds")
LOOP_HZ = 20.0  # donkeycar's DRIVE_LOOP_HZ
ASSUMED_LOCK_DEG = 25.0
WHY_LOCK = "usual for RC cars; the tub does not have it"
DELETED, BY_PILOT = "deleted in the tub", "driven by a pilot"
Record = tuple[str, int, dict[str, Any]]  # where it stands, its number, its fields


def is_tub(path: Path) -> bool:
    """Whether ``path`` is the folder of a tub of either version, also without its manifest."""
    return path.is_dir() and (
        (path / MANIFEST).is_file() or bool(catalogs_in(path)) or bool(_numbered_records(path))
    )


def read_tub(path: Path, faults: Faults, renamed: Mapping[str, str]) -> Log:
    """The frames of a tub, by their numbers. ``renamed``: the field of the records that stands for ANGLE.

    Raises InputError when it cannot be read at all, and when its records have the steering in another field.
    """
    angle = renamed.get(ANGLE, ANGLE)
    if catalogs_in(path) or not _numbered_records(path):
        return _version_2(path, faults, angle)
    return _version_1(path, faults, angle)


def _numbered_records(path: Path) -> list[Path]:
    """The records of version 1, by their numbers."""
    return natural_order(file for file in path.glob("record_*.json") if NUMBERED.fullmatch(file.name))


def _version_2(path: Path, faults: Faults, angle: str) -> Log:
    manifest, held = read_manifest(path / MANIFEST), catalogs_in(path)
    if not manifest.catalogs and not held:
        first = manifest.faults[0][0] if manifest.faults else f"{path / MANIFEST}:5: no catalog"
        raise InputError(f"{first}, and there is no catalog_<n>.catalog beside it")
    if manifest.images == []:
        raise InputError(f"{path / MANIFEST}:2: no input of type image_array")
    before = faults.rows
    for fault, remedy in manifest.faults:
        faults(fault, rows=0, remedy=remedy)
    listed = held if manifest.catalogs is None else manifest.catalogs
    unlisted = [name for name in held if name not in listed]
    for name in unlisted:
        faults(f"{path / name}: is not in the manifest", rows=0, remedy="read")
    catalogs = [file.name for file in natural_order(map(Path, {*listed, *held}))] if unlisted else listed
    records = list(_catalog_records(path, catalogs, faults))
    if manifest.records is not None:
        _count_lost(f"{path / MANIFEST}:5", manifest.records, records, faults.rows - before, faults)
    records = _without_repeats(records, faults)
    images = manifest.images or _image_inputs(records)
    root = (
        path / IMAGES if (path / IMAGES).is_dir() else path
    )  # some copies of tubs have the images beside all else
    log = _log("tub2", path, root, records, (images[0], angle), faults, manifest.deleted or set())
    log.files = tuple(
        file for file in (path / MANIFEST, *(path / name for name in catalogs)) if file.is_file()
    )
    log.unread = faults.rows - before
    if manifest.deleted is None:
        log.notes.append("the manifest is damaged: which records were deleted is not known")
    log.notes += _unused_images(images)
    return log


def _count_lost(where: str, written: int, records: list[Record], unread: int, faults: Faults) -> None:
    """Report the records below ``written``, the number of the next one, that no catalog holds."""
    numbers = [number for _, number, _ in records]
    lost = written - len({number for number in numbers if 0 <= number < written}) - numbers.count(-1) - unread
    if lost > 0:
        faults(
            f"{where}: current_index is {written}, and {lost} records are in no catalog",
            rows=lost,
            remedy="lost",
        )


def _without_repeats(records: list[Record], faults: Faults) -> list[Record]:
    """``records`` without those that an earlier catalog holds too, as in a copy of one; these are reported."""
    first: dict[int, list[dict[str, Any]]] = {}
    kept: list[Record] = []
    repeats: list[Record] = []
    for one in records:
        _, number, record = one
        same = first.setdefault(number, [])
        (repeats if number >= 0 and record in same else kept).append(one)
        same.append(record)
    if repeats:
        faults(f"{repeats[0][0]}: {len(repeats)} records from here on are read already", rows=len(repeats))
    return kept


def _image_inputs(records: list[Record]) -> list[str]:
    """The fields of the first record that name an image, else that of donkeycar."""
    fields = records[0][2].items() if records else ()
    named = [
        name
        for name, value in fields
        if isinstance(value, str) and Path(value).suffix.lower() in IMAGE_SUFFIXES
    ]
    return named or [IMAGE_KEY]


def _catalog_records(path: Path, catalogs: list[str], faults: Faults) -> Iterator[Record]:
    """The records of all catalogs; ``faults`` gets lines that are none, and catalogs that are missing."""
    for name in catalogs:
        try:
            lines = read_text(path / name, broken_bytes=True).split("\n")
        except InputError as error:
            faults(str(error), rows=0)
            continue
        for line, text in enumerate(lines, start=1):
            if not text and line == len(lines):
                continue  # after the end of the last line
            record = _json(text, f"{path / name}:{line}", faults)
            if record is None:
                continue
            index = record.get("_index", -1)
            if isinstance(index, int):
                yield f"{path / name}:{line}", index, record
            else:
                faults(f"{path / name}:{line}: _index: expected the number of the record, got {index!r}")


def _version_1(path: Path, faults: Faults, angle: str) -> Log:
    files = _numbered_records(path)
    before, records = faults.rows, []
    for file in files:
        try:
            text = read_text(file)
        except InputError as error:
            faults(str(error))
            continue
        record = _json(text, str(file), faults)
        if record is not None:
            records.append((str(file), int(file.stem.removeprefix("record_")), record))
    meta = read_meta(path / META)
    for fault, remedy in meta.faults:
        faults(fault, rows=0, remedy=remedy)
    images = meta.images or _image_inputs(records)
    log = _log("tub1", path, path, records, (images[0], angle), faults, set())
    log.files = tuple(files)
    log.unread = faults.rows - before
    log.notes += _unused_images(images)
    return log


def _unused_images(images: list[str]) -> list[str]:
    """A note on the images of a tub beside those that are read."""
    return [f"images of {images[0]}; not used: {', '.join(images[1:])}"] if len(images) > 1 else []


def _json(text: str, where: str, faults: Faults) -> dict[str, Any] | None:
    if is_broken(text):
        faults(f"{where}: not a record: bytes that are no UTF-8")
        return None
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        faults(f"{where}: not a record: {error}")
        return None
    if not isinstance(record, dict):
        faults(f"{where}: not a record: expected names and values")
        return None
    return record


def _log(
    kind: str,
    path: Path,
    root: Path,
    records: list[Record],
    fields: tuple[str, str],
    faults: Faults,
    deleted: set[int],
) -> Log:
    """The log of ``records``; ``fields``: those of the image and of the steering."""
    image, angle = fields
    _check_angle(path, records, angle)
    timed = any(_stamp(record) is not None for _, _, record in records)
    rows: list[tuple[float, float, float]] = []
    names, routes, why, places = [], [], [], []
    images = ImageFolder(root)
    for ordinal, (where, index, record) in enumerate(records):
        try:
            if not isinstance(record.get(image), str) or not record[image]:
                raise ValueError(f"no {image}")
            speed = next((record[name] for name in SPEEDS if name in record), None)
            steering, speed_mps = number(record.get(angle)), number(speed)
            row = (_time_s(record) if timed else ordinal / LOOP_HZ, steering, speed_mps)
        except ValueError as error:
            faults(f"{where}: {error}")
            continue
        rows.append(row)
        places.append(where)
        names.append(images.find(record[image]))
        session = record.get("_session_id")
        routes.append(f"{path.name}/{session}" if session else path.name)
        by_pilot = record.get(MODE, "user") not in ("user", "recording")
        why.append(DELETED if index in deleted else BY_PILOT if by_pilot else "")
    if not rows:
        raise InputError(f"{path}: no record of this tub can be read")
    times_s, angles, speeds_mps = np.array(rows, dtype=np.float64).T
    refuse_beyond_lock(f"{path}: {angle}", angles, "divide it by its largest value, 100 or the angle at lock")
    if timed:
        refuse_rounded_times(path, str(_stamp(records[0][2])), times_s, routes)
    log = Log(
        kind=kind,
        path=path,
        root=root,
        files=(),
        image=names,
        item=np.full(len(rows), -1),
        t_s=times_s,
        route=routes,
        steering=angles,
        speed_mps=speeds_mps,
        yaw_rate_radps=np.full(len(rows), math.nan),
        why=why,
        where=places,
        unit=SteeringUnit.LOCK,
        left_positive=False,
        lock_rad=math.radians(ASSUMED_LOCK_DEG),
        lock_source=WHY_LOCK,
    )
    if not timed:
        log.notes.append(f"the records have no times: {LOOP_HZ:g} Hz assumed, the default of donkeycar")
    return log


def _check_angle(path: Path, records: list[Record], angle: str) -> None:
    """Raise InputError where no record has the field ``angle``, and other fields look like the steering."""
    if any(angle in record for _, _, record in records):
        return
    alike = {
        name
        for _, _, record in records
        for name, value in record.items()
        if isinstance(value, int | float) and name.startswith("user/") and re.search("steer|angle", name)
    }
    if alike or angle != ANGLE:
        other = f"; `--column {ANGLE}={min(alike)}` reads {min(alike)}" if alike else ""
        raise InputError(f"{path}: no record has the field {angle}{other}")


def _stamp(record: dict[str, Any]) -> str | None:
    """The name of the field with the time of a record; None without one."""
    known = (name for name in STAMPS_MS if record.get(name) is not None)
    return next(known, "timestamp" if isinstance(record.get("timestamp"), str) else None)


def _time_s(record: dict[str, Any]) -> float:
    """The time of a record. Raises ValueError where it has none."""
    name = _stamp(record)
    if name is None:
        raise ValueError("no time, and other records have one")
    t_s = (
        number(record[name]) / 1e3 if name in STAMPS_MS else datetime.fromisoformat(record[name]).timestamp()
    )
    if math.isnan(t_s):
        raise ValueError(f"{name}: no time")
    return t_s
