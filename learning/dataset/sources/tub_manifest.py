"""The index of a donkeycar tub, also a damaged one: the records stand beside it.

``manifest.json`` of version 2 has five lines of JSON: names of the inputs, their types, metadata of the user,
metadata of the sessions, and the catalogs with the number of records ever written and the deleted ones. Donkeycar
rewrites it in place at every record, so that a loss of power leaves it empty, short, or with the end of an older,
longer line.
``meta.json`` of version 1 has the names of the inputs and their types.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any

from trepid.config import InputError, read_text
from trepid.files.decoding import is_broken
from trepid.images.files import natural_order

MANIFEST, META = "manifest.json", "meta.json"
LINES = 5
CATALOG = re.compile(r"catalog_\d+\.catalog")
OF_FOLDER = "the catalogs of the folder are read, with the records that were deleted"
OF_RECORDS = "the images are sought in the records"
UNUSED = "not used"
Report = Callable[[str, str], None]  # a fault, and what is done about it


@dataclass(slots=True)
class Manifest:
    """What a manifest says; what it does not say is None."""

    images: list[str] | None = None  # the inputs that are images
    catalogs: list[str] | None = None  # names of files
    deleted: set[int] | None = None  # numbers of records
    records: int | None = None  # written so far
    faults: list[tuple[str, str]] = field(default_factory=list)  # and what is done about each


def catalogs_in(folder: Path) -> list[str]:
    """The names of the catalogs in ``folder``, by their numbers."""
    return [path.name for path in natural_order(folder.iterdir()) if CATALOG.fullmatch(path.name)]


def read_manifest(path: Path) -> Manifest:
    """The manifest at ``path``, as far as it can be read, with its faults."""
    manifest = Manifest()

    def report(fault: str, remedy: str) -> None:
        manifest.faults.append((fault, remedy))

    if not path.is_file():
        report(f"{path}: is missing", OF_FOLDER)
        return manifest
    try:
        lines = read_text(path, broken_bytes=True).rstrip("\n").split("\n")
    except InputError as error:
        report(str(error), OF_FOLDER)
        return manifest
    held = 0 if lines == [""] else len(lines)
    if held < LINES:
        report(f"{path}: {held} lines, expected {LINES}", OF_FOLDER)
    remedies = [OF_RECORDS] * 2 + [UNUSED] * 2 + [OF_FOLDER]
    parts = [
        _value(text, f"{path}:{number}", remedy, report)
        for number, (text, remedy) in enumerate(zip(lines[:held], remedies, strict=False), start=1)
    ]
    inputs, types, _, _, held_catalogs = (parts + [None] * LINES)[:LINES]
    if inputs is not None and types is not None:
        _take_inputs(manifest, path, inputs, types)
    if held_catalogs is not None:
        _take_catalogs(manifest, path, held_catalogs)
    return manifest


def read_meta(path: Path) -> Manifest:
    """What ``meta.json`` of a tub of version 1 says of its inputs, with its faults; nothing where it is missing."""
    manifest = Manifest()

    def report(fault: str, remedy: str) -> None:
        manifest.faults.append((fault, remedy))

    if not path.is_file():
        return manifest
    try:
        value = _value(read_text(path, broken_bytes=True), f"{path}:1", OF_RECORDS, report)
    except InputError as error:
        report(str(error), OF_RECORDS)
        return manifest
    if isinstance(value, dict) and "types" not in value:
        return manifest
    if value is not None:
        held = value if isinstance(value, dict) else {}
        _take_inputs(manifest, path, held.get("inputs"), held.get("types"))
    return manifest


def _value(text: str, where: str, remedy: str, report: Report) -> Any:
    """The JSON value at the beginning of ``text``; None where there is none."""
    if is_broken(text):
        report(f"{where}: not JSON: bytes that are no UTF-8", remedy)
        return None
    try:
        value, end = json.JSONDecoder().raw_decode(text.lstrip())
    except (ValueError, RecursionError) as error:
        report(f"{where}: not JSON: {error}", remedy)
        return None
    tail = text.lstrip()[end:].strip()
    if tail:
        report(f"{where}: {tail[:40]!r} after its value, as the end of an older, longer line", UNUSED)
    return value


def _take_inputs(manifest: Manifest, path: Path, inputs: Any, types: Any) -> None:
    if not (_is_list(inputs, str) and _is_list(types, str) and len(inputs) == len(types)):
        manifest.faults.append((f"{path}:1: no names of inputs with their types", OF_RECORDS))
        return
    manifest.images = [name for name, kind in zip(inputs, types, strict=True) if kind == "image_array"]


def _take_catalogs(manifest: Manifest, path: Path, held: object) -> None:
    if not (isinstance(held, dict) and _is_list(held.get("paths"), str)):
        manifest.faults.append((f"{path}:5: no names of catalogs in paths", OF_FOLDER))
        return
    manifest.catalogs = [
        PureWindowsPath(name).name for name in held["paths"]
    ]  # also of paths of another machine
    deleted, records = held.get("deleted_indexes") or [], held.get("current_index")
    if _is_list(deleted, int):
        manifest.deleted = set(deleted)
    else:
        wrong = f"{path}:5: deleted_indexes: expected numbers of records, got {deleted!r}"
        manifest.faults.append((wrong, "no record counts as deleted"))
    if isinstance(records, int) and records >= 0:
        manifest.records = records
    elif records is not None:
        wrong = f"{path}:5: current_index: expected the number of records, got {records!r}"
        manifest.faults.append((wrong, "lost records are not counted"))


def _is_list(values: Any, kind: type) -> bool:
    """Whether ``values`` is a list of ``kind``."""
    return isinstance(values, list) and all(isinstance(value, kind) for value in values)
