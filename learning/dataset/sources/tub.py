"""Tubs of donkeycar, versions 1 and 2.

Version 2 (donkeycar 4 and later): ``manifest.json`` with five lines of JSON (names of the inputs, their types, user
metadata, metadata, catalogs and deleted records), and catalogs of one record a line. Version 1: one
``record_<n>.json`` a frame, with ``meta.json`` beside them. In both ``user/angle`` is the share of full steering,
-1 to 1, positive to the right.
"""

import json
import math
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
IMAGE_KEY, ANGLE, MODE = "cam/image_array", "user/angle", "user/mode"
SPEEDS = ("enc/speed", "odom/speed", "pos/speed")  # [m/s]
LOOP_HZ = 20.0  # donkeycar's DRIVE_LOOP_HZ
ASSUMED_LOCK_DEG = 25.0
WHY_LOCK = "usual for RC cars; the tub does not have it"
DELETED, BY_PILOT = "deleted in the tub", "driven by a pilot"
Record = tuple[str, int, dict[str, Any]]  # where it stands, its number, its fields


def is_tub(path: Path) -> bool:
    """Whether ``path`` is the folder of a tub of either version."""
    return path.is_dir() and (
        (path / MANIFEST).is_file() or next(path.glob("record_*.json"), None) is not None
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
        except ValueError as error:
            raise InputError(f"{path}:{line}: not JSON: {error}") from error
    inputs, types, _, _, catalogs = parts
    fits = (
        isinstance(inputs, list)
        and isinstance(types, list)
        and len(inputs) == len(types)
        and isinstance(catalogs, dict)
        and isinstance(catalogs.get("paths"), list)
    )
    if not fits:
        raise InputError(other)
    return inputs, types, catalogs["paths"], {int(n) for n in catalogs.get("deleted_indexes") or []}


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
            if record is not None:
                yield f"{path / name}:{line}", record.get("_index", -1), record


def _version_1(path: Path, faults: Faults) -> Log:
    files = natural_order(path.glob("record_*.json"))
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
    except ValueError as error:
        faults(f"{where}: not a record: {error}")
        return None
    if not isinstance(record, dict):
        faults(f"{where}: not a record: expected names and values")
        return None
    return record


def _log(
    kind: str, path: Path, root: Path, records: list[Record], image: str, faults: Faults, deleted: set[int]
) -> Log:
    rows, names, routes, why = [], [], [], []
    for where, index, record in records:
        try:
            if not isinstance(record.get(image), str):
                raise ValueError(f"no {image}")
            speed = next((record[name] for name in SPEEDS if name in record), None)
            row = (_time_s(record), number(record.get(ANGLE)), number(speed))
        except ValueError as error:
            faults(f"{where}: {error}")
            continue
        rows.append(row)
        names.append(record[image])
        session = record.get("_session_id")
        routes.append(f"{path.name}/{session}" if session else path.name)
        by_pilot = record.get(MODE, "user") not in ("user", "recording")
        why.append(DELETED if index in deleted else BY_PILOT if by_pilot else "")
    if not rows:
        raise InputError(f"{path}: no record of this tub can be read")
    t_s, steering, speed_mps = np.array(rows, dtype=np.float64).T
    log = Log(
        kind=kind,
        path=path,
        root=root,
        files=(),
        image=names,
        item=np.full(len(rows), -1),
        t_s=t_s,
        route=routes,
        steering=steering,
        speed_mps=speed_mps,
        yaw_rate_radps=np.full(len(rows), math.nan),
        why=why,
        unit=Steering.LOCK,
        left_positive=False,
        lock_rad=math.radians(ASSUMED_LOCK_DEG),
        lock_source=WHY_LOCK,
    )
    if np.isnan(t_s).any():
        log.t_s = np.arange(len(rows)) / LOOP_HZ
        log.notes.append(f"the records have no times: {LOOP_HZ:g} Hz assumed, the default of donkeycar")
    return log


def _time_s(record: dict[str, Any]) -> float:
    """The time of a record; NaN where it has none. Raises ValueError."""
    for name in ("_timestamp_ms", "milliseconds"):
        if name in record:
            return number(record[name]) / 1e3
    stamp = record.get("timestamp")
    return datetime.fromisoformat(stamp).timestamp() if isinstance(stamp, str) else math.nan
