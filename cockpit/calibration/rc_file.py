"""Writing a calibration into the ``actuator.yaml`` of a car: comments are kept, a wrong value is refused before."""

import os
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any, cast

from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from trepid.config import InputError, editing_yaml, put, read, read_text
from trepid.files.whole import write_whole
from vehicle.actuators.rc.settings import RcSettings
from vehicle.actuators.table import FILE, configured_actuator, settings_in

BOARDS = ("pca9685", "serial")
HEADER = "# Overrides config/actuator.yaml field by field; written by `trepid calibrate steering`.\n"


def chosen_board() -> str:
    """The board that ``actuator.yaml`` names. Raises InputError when it names no board."""
    name, _ = configured_actuator()
    if name not in BOARDS:
        raise InputError(
            f"actuator.yaml names {name!r}; give --board pca9685 or --board serial, or choose one in the file"
        )
    return name


def settings_of(board: str, changes: Mapping[str, Any] | None = None) -> RcSettings:
    """The settings of ``board`` with ``changes``, dotted names below its block.

    Raises InputError: a fault of the file with its place, one of ``changes`` with the name of the field.
    """
    data = read(FILE)
    for name, value in (changes or {}).items():
        put(data, f"{board}.{name}", value)
    try:
        return cast(RcSettings, settings_in(data, board))
    except InputError as error:
        if not changes:
            raise
        settings_of(board)
        raise InputError(str(error).partition(": ")[2]) from error


def write(car: Path, board: str, changes: Mapping[str, Any]) -> Path:
    """Write ``changes`` into the block ``board`` of the car's file; all else in it stays. Returns its path.

    The file is replaced at once, so that a running drive never reads half of it. Raises InputError.
    """
    settings_of(board, changes)
    path = car / FILE.name
    yaml = editing_yaml()
    yaml.preserve_quotes = True
    yaml.width = 120
    text = read_text(path) if path.exists() else HEADER
    try:
        data = yaml.load(text)
    except YAMLError as error:
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error
    if data is None:
        data = CommentedMap()
    for name, value in changes.items():
        put(data, f"{board}.{name}", _flow(value))
    out = StringIO() if path.exists() else StringIO(HEADER)
    out.seek(0, os.SEEK_END)
    yaml.dump(data, out)
    try:
        write_whole(path, out.getvalue().encode())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path


def _flow(value: Any) -> Any:
    """Lists of pairs on one line."""
    if not isinstance(value, list | tuple):
        return value
    seq = CommentedSeq([_flow(item) for item in value])
    seq.fa.set_flow_style()
    return seq
