"""Tubs of donkeycar, versions 1 and 2.

Version 2 (donkeycar 4 and later): ``manifest.json`` with five lines of JSON (names of the inputs, their types, user
metadata, metadata, catalogs and deleted records), and catalogs of one record a line. Version 1: one
``record_<n>.json`` a frame, with ``meta.json`` beside them. In both ``user/angle`` is the share of full steering,
-1 to 1, positive to the right.
"""

import json
import math
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from learning.dataset.sources.log import Faults, Log, Steering, number
from trepid.config import InputError
from trepid.images.files import natural_order

MANIFEST = "manifest.json"
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
    """Whether ``path`` is the folder of a tub of either version."""
    return path.is_dir() and (
        (path / MANIFEST).is_file() or any(NUMBERED.fullmatch(file.name) for file in path.iterdir())
    )


def read_tub(path: Path, faults: Faults) -> Log:
    """The frames of a tub, by their numbers. Raises InputError when it cannot be read at all."""
    return _version_2(path, faults) if (path / MANIFEST).is_file() else _version_1(path, faults)


def _version_2(path: Path, faults: Faults) -> Log:
    inputs, types, catalogs, deleted = _manifest(path / MANIFEST)
    images = [name for name, kind in zip(inputs, types, strict=True) if kind == "image_array"]
    if not images:
        raise InputError(f"{path / MANIFEST}:2: no input of type image_array")
    before = faults.count
    records = list(_catalogued(path, catalogs, faults))
    log = _log("tub2", path, path / IMAGES, records, images[0], faults, deleted)
    log.files = (path / MANIFEST, *(path / name for name in catalogs if (path / name).is_file()))
    log.unread = faults.count - before
    if len(images) > 1:
        log.notes.append(f"images of {images[0]}; not used: {', '.join(images[1:])}")
    return log


def _manifest(path: Path) -> tuple[list[str], list[str], list[str], set[int]]:
    """Inputs, their types, names of the catalogs, numbers of deleted records. Raises InputError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    other = f"{path}: not the manifest of a donkeycar tub of version 2"
    if len(lines) < 5:
        raise InputError(f"{other}: {len(lines)} lines, expected 5; version 1 has record_<n>.json files")
    parts = []
    for line, text in enumerate(lines[:5], start=1):
        try:
            parts.append(json.loads(text))
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}:{line}: not JSON: {error}") from error
    inputs, types, _, _, catalogs = parts
    if not (_all(inputs, str) and _all(types, str) and len(inputs) == len(types)):
        raise InputError(other)
    if not (isinstance(catalogs, dict) and _all(catalogs.get("paths"), str)):
        raise InputError(f"{path}:5: no names of catalogs in paths")
    deleted = catalogs.get("deleted_indexes") or []
    if not _all(deleted, int):
        raise InputError(f"{path}:5: deleted_indexes: expected numbers of records, got {deleted!r}")
    return inputs, types, catalogs["paths"], set(deleted)


def _all(values: object, kind: type) -> bool:
    """Whether ``values`` is a list of ``kind``."""
    return isinstance(values, list) and all(isinstance(value, kind) for value in values)


def _catalogued(path: Path, catalogs: list[str], faults: Faults) -> Iterator[Record]:
    """The records of all catalogs; ``faults`` gets lines that are none, and catalogs that are missing."""
    for name in catalogs:
        try:
            lines = (path / name).read_bytes().splitlines()
        except OSError as error:
            faults(f"{path / name}: cannot be read: {error.strerror or error}")
            continue
        for line, text in enumerate(lines, start=1):
            record = _json(text, f"{path / name}:{line}", faults)
            if record is None:
                continue
            index = record.get("_index", -1)
            if isinstance(index, int):
                yield f"{path / name}:{line}", index, record
            else:
                faults(f"{path / name}:{line}: _index: expected the number of the record, got {index!r}")


def _version_1(path: Path, faults: Faults) -> Log:
    files = natural_order(file for file in path.glob("record_*.json") if NUMBERED.fullmatch(file.name))
    before, records = faults.count, []
    for file in files:
        try:
            text = file.read_bytes()
        except OSError as error:
            faults(f"{file}: cannot be read: {error.strerror or error}")
            continue
        record = _json(text, str(file), faults)
        if record is not None:
            records.append((str(file), int(file.stem.removeprefix("record_")), record))
    log = _log("tub1", path, path, records, IMAGE_KEY, faults, set())
    log.files = tuple(files)
    log.unread = faults.count - before
    return log


def _json(text: bytes, where: str, faults: Faults) -> dict[str, Any] | None:
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
    kind: str, path: Path, root: Path, records: list[Record], image: str, faults: Faults, deleted: set[int]
) -> Log:
    timed = any(_stamp(record) is not None for _, _, record in records)
    rows: list[tuple[float, float, float]] = []
    names, routes, why, places = [], [], [], []
    for ordinal, (where, index, record) in enumerate(records):
        try:
            if not isinstance(record.get(image), str) or not record[image]:
                raise ValueError(f"no {image}")
            speed = next((record[name] for name in SPEEDS if name in record), None)
            steering, speed_mps = number(record.get(ANGLE)), number(speed)
            row = (_time_s(record) if timed else ordinal / LOOP_HZ, steering, speed_mps)
        except ValueError as error:
            faults(f"{where}: {error}")
            continue
        rows.append(row)
        places.append(where)
        names.append(record[image])
        session = record.get("_session_id")
        routes.append(f"{path.name}/{session}" if session else path.name)
        by_pilot = record.get(MODE, "user") not in ("user", "recording")
        why.append(DELETED if index in deleted else BY_PILOT if by_pilot else "")
    if not rows:
        raise InputError(f"{path}: no record of this tub can be read")
    times_s, angles, speeds_mps = np.array(rows, dtype=np.float64).T
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
        unit=Steering.LOCK,
        left_positive=False,
        lock_rad=math.radians(ASSUMED_LOCK_DEG),
        lock_source=WHY_LOCK,
    )
    if not timed:
        log.notes.append(f"the records have no times: {LOOP_HZ:g} Hz assumed, the default of donkeycar")
    return log


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
