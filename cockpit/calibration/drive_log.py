"""Logs of a drive as columns for identification.

The formats are recordings (.mcap, as ``trepid drive --record`` writes them), traces (.npz of ``trepid sim run
--trace``) and tables (.csv, one row of names first). Times in seconds, angles positive to the left; a missing
value is NaN, or an empty cell of a table.

Columns of a table (of each line the first that is present is used):

    t_s
    speed_mps | speed_kmh
    road_wheel_angle_rad | road_wheel_angle_deg | steering_wheel_angle_rad | steering_wheel_angle_deg
    yaw_rate_radps | yaw_rate_dps
    command_rad | command_deg      optional; at the road wheel or the steering wheel, as the angle is
    driver_override                optional; 1 while the driver steers and commands have no effect
"""

import math
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from trepid.config import InputError
from trepid.recording.csv_file import Row, column_names, read_rows, refuse_rounded_times
from trepid.recording.reader import read_recording
from trepid.topics import COMMAND, VEHICLE_STATE
from trepid.types import Column

RAD = math.pi / 180.0
# Quantity: its names in a table, and their factors to SI.
TABLE: dict[str, dict[str, float]] = {
    "t_s": {"t_s": 1.0},
    "speed": {"speed_mps": 1.0, "speed_kmh": 1 / 3.6},
    "angle": {
        "road_wheel_angle_rad": 1.0,
        "road_wheel_angle_deg": RAD,
        "steering_wheel_angle_rad": 1.0,
        "steering_wheel_angle_deg": RAD,
    },
    "yaw_rate": {"yaw_rate_radps": 1.0, "yaw_rate_dps": RAD},
    "command": {"command_rad": 1.0, "command_deg": RAD},
    "driver_override": {"driver_override": 1.0},
}
LONGEST_SPAN = (
    100.0  # of the time from the first row to the last, in times that the rows would take without pauses
)
OPTIONAL = ("command", "driver_override")
NAMES = [name for names in TABLE.values() for name in names]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLog:
    """Measurements and commands; columns of equal length for each of the two clocks, in order of time."""

    t_s: Column
    speed_mps: Column
    angle_rad: Column  # of the road wheels, or of the steering wheel
    yaw_rate_radps: Column
    driver_override: Column  # 1: commands have no effect
    at_steering_wheel: bool  # where angle and command are measured
    command_t_s: Column  # times of the commands; empty: the log has none
    command_rad: Column
    complete: bool = True  # False: a recording that was cut short, read up to its last whole chunk


def read_log(path: Path, renamed: Mapping[str, str] | None = None) -> DriveLog:
    """The log in ``path``; ``renamed``: name of this module -> column of the table.

    A minus before the column reverses its sign. Raises InputError.
    """
    readers = {".mcap": _from_recording, ".npz": _from_trace}
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return _from_table(path, renamed or {})
    if suffix not in readers:
        raise InputError(f"{path}: expected a recording (.mcap), a trace (.npz) or a table (.csv)")
    if renamed:
        raise InputError(f"--column: {path} only the columns of a table (.csv) can be renamed")
    try:
        return readers[suffix](path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def log_of(
    path: Path,
    measured: Sequence[Column],
    command: tuple[Column, Column],
    *,
    at_steering_wheel: bool = False,
) -> DriveLog:
    """A log from time, speed, angle, yaw rate and override, and the times and angles of commands.

    Rows with a missing number are left out. Raises InputError when fewer than two are left or when time runs back.
    """
    table = np.column_stack(measured)
    table = table[np.isfinite(table).all(axis=1)]
    orders = np.column_stack(command)
    orders = orders[np.isfinite(orders).all(axis=1)]
    if len(table) < 2:
        raise InputError(f"{path}: no two rows with time, speed, wheel angle and yaw rate")
    back = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if len(back):
        raise InputError(f"{path}: time does not go on after t_s = {table[back[0], 0]:.3f}")
    steps_s = np.diff(table[:, 0])
    if steps_s.sum() > LONGEST_SPAN * len(steps_s) * np.median(steps_s):
        silent_s = table[int(np.argmax(steps_s)), 0]
        raise InputError(
            f"{path}: no rows for {steps_s.max():.0f} s after t_s = {silent_s:.3f}: leave out one part"
        )
    return DriveLog(
        t_s=table[:, 0],
        speed_mps=table[:, 1],
        angle_rad=table[:, 2],
        yaw_rate_radps=table[:, 3],
        driver_override=table[:, 4],
        at_steering_wheel=at_steering_wheel,
        command_t_s=orders[:, 0],
        command_rad=orders[:, 1],
    )


def _from_recording(path: Path) -> DriveLog:
    """States at the time of their measurement, commands at the time of their arrival at the recorder."""
    recorded = read_recording(path, VEHICLE_STATE.key, COMMAND.key)
    measured = attrgetter("t_s", "speed_mps", "road_wheel_angle_rad", "yaw_rate_radps", "driver_override")
    states = [measured(state) for _, state in recorded.of(VEHICLE_STATE)]
    orders = [(arrived_s, command.road_wheel_angle_rad) for arrived_s, command in recorded.of(COMMAND)]
    # Late states are sorted in; of several states of one instant (a waiting simulator) the first counts.
    first = {row[0]: row for row in reversed(states)}
    table = np.array([first[t_s] for t_s in sorted(first)], dtype=np.float64).reshape(-1, 5)  # None: NaN
    given = np.array(orders, dtype=np.float64).reshape(-1, 2)
    log = log_of(path, list(table.T), (given[:, 0], given[:, 1]))
    return replace(log, complete=recorded.complete)


def _from_trace(path: Path) -> DriveLog:
    """A trace of a lock-step run; its commands stand in the row of the tick in which they were given."""
    names = ("t_s", "speed_mps", "road_wheel_angle_rad", "yaw_rate_radps", "command.road_wheel_angle_rad")
    try:
        with np.load(path, allow_pickle=False) as saved:
            columns = [saved[name].astype(np.float64) for name in names]
    except (OSError, KeyError, ValueError, TypeError, EOFError, BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: is no saved trace: {error}") from error
    t_s, *_, command_rad = columns
    return log_of(path, [*columns[:4], np.zeros_like(t_s)], (t_s, command_rad))


def _from_table(path: Path, renamed: Mapping[str, str]) -> DriveLog:
    strange = [name for name in renamed if name not in NAMES]
    if strange:
        raise InputError(f"--column {strange[0]}: no such name; known: {', '.join(NAMES)}")
    header, rows = _cells(path, {*NAMES} - {*renamed.values()})
    found: dict[str, Column] = {}
    at_steering_wheel = False
    for quantity, names in TABLE.items():
        name = next((name for name in names if name in renamed), None)
        name = name or next((name for name in names if name in header), None)
        if name is not None:
            found[quantity] = names[name] * _column(path, header, rows, renamed.get(name, name))
            at_steering_wheel |= name.startswith("steering_wheel")
        elif quantity not in OPTIONAL:
            raise InputError(f"{path}:1: no column {' or '.join(names)}; name it by --column")
        if quantity == "t_s":
            refuse_rounded_times(path, name or "", found["t_s"])
    missing = np.full(len(rows), math.nan)
    override = np.nan_to_num(found.get("driver_override", missing), nan=0.0)
    return log_of(
        path,
        [found["t_s"], found["speed"], found["angle"], found["yaw_rate"], override],
        (found["t_s"], found.get("command", missing)),
        at_steering_wheel=at_steering_wheel,
    )


def _cells(path: Path, known: Collection[str]) -> tuple[list[str], list[Row]]:
    header, *rows = read_rows(path)
    return column_names(header, known), rows


def _column(path: Path, header: list[str], rows: list[Row], name: str) -> Column:
    """Numbers of the column ``name``; a minus before it reverses their sign."""
    sign = -1.0 if name.startswith("-") and name not in header else 1.0
    name = name if sign > 0 else name[1:]
    if name not in header:
        raise InputError(f"{path}:1: no column {name!r}; there are {', '.join(header)}")
    at = header.index(name)
    numbers: list[Any] = []
    for line, row in ((row.line, row.cells) for row in rows):
        cell = row[at].strip() if at < len(row) else ""
        try:
            numbers.append(float(cell) if cell else math.nan)
        except ValueError as error:
            raise InputError(f"{path}:{line}: {name}: expected a number, got {cell!r}") from error
    return sign * np.array(numbers, dtype=np.float64)
