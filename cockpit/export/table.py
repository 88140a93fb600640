"""A drive as a table: one row per camera frame, or at a fixed rate; CSV and Parquet.

A row holds the newest message of each topic that had arrived by its time, and never a later one. The estimates from
a frame arrive after its capture, so that they are in a later row; the columns ``…_frame_t_s`` hold the capture time
of the frame that a value goes back to.
"""

import csv
import math
from bisect import bisect_right
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cockpit.export.drive import Drive
from trepid.config import InputError
from trepid.topics import COMMAND, DECISION, LEAD_VEHICLE, VEHICLE_STATE, Topic, estimate_topic

STATE = ("speed_mps", "road_wheel_angle_rad", "yaw_rate_radps", "driver_override")
JUDGED = ("fear", "level", "cause", "mode", "stop", "speed_cap_mps")
PATH = ("lateral_offset_m", "heading_error_rad", "curvature_1pm")
COMMANDED = ("road_wheel_angle_rad", "speed_mps", "accel_mps2")
LEAD = ("distance_m", "lateral_m", "speed_mps", "confidence")
ESTIMATED = ("road_wheel_angle_rad", *PATH, "confidence")
TEXTS = frozenset({"level", "cause", "mode", "stop", "path_source"})
Value = float | int | str | None
Table = dict[str, list[Value]]
"""Name of a column -> a value per row; None: missing."""


def times(drive: Drive, rate_hz: float | None) -> list[float]:
    """Times of the rows [s]: the captures of the frames, or ``rate_hz`` times a second between first and last."""
    first_s, last_s = drive.frames_s[0], drive.frames_s[-1]
    if rate_hz is None:
        return drive.frames_s
    return [first_s + k / rate_hz for k in range(int((last_s - first_s) * rate_hz + 1e-6) + 1)]


def table(drive: Drive, at_s: Iterable[float]) -> Table:
    """The rows at the times ``at_s`` of the recorder. ``t_s`` counts from the start of the drive [s]."""
    rows = [_row(drive, t_s) for t_s in at_s]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _row(drive: Drive, at_s: float) -> dict[str, Value]:
    frame = bisect_right(drive.frames_s, at_s) - 1
    row: dict[str, Value] = {"t_s": round(at_s - drive.zero_s, 6), "frame": frame if frame >= 0 else None}

    def add(topic: Topic[Any], fields: Iterable[str], prefix: str = "") -> Any:
        message = drive.newest(topic, at_s)
        row.update({prefix + name: _value(getattr(message, name, None)) for name in fields})
        return message

    def frame_of(message: Any) -> Value:
        t_s = getattr(message, "t_s", None)
        return None if t_s is None else round(t_s - drive.zero_s, 6)

    add(VEHICLE_STATE, STATE)
    decision = add(DECISION, JUDGED)
    add(DECISION, PATH, "path_")
    row["path_source"] = _value(getattr(decision, "path_source", None))
    row["decision_frame_t_s"] = frame_of(decision)
    add(COMMAND, COMMANDED, "command_")
    add(LEAD_VEHICLE, LEAD, "lead_")
    for name in drive.estimators:
        row[f"{name}_frame_t_s"] = frame_of(add(estimate_topic(name), ESTIMATED, f"{name}_"))
    return row


def _value(value: Any) -> Value:
    """A cell of the table; None for NaN."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, bool):
        return int(value)
    return str(value) if isinstance(value, str) else value


def write_csv(rows: Table, out: Path) -> None:
    """Write the table; a missing value is an empty cell."""
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(rows)
        writer.writerows(zip(*rows.values(), strict=True))


def check_parquet(out: Path) -> None:
    """Raise InputError unless pyarrow is installed."""
    if find_spec("pyarrow") is None:
        raise InputError(f"{out}: Parquet needs pyarrow: pip install 'trepid[report]', or name a .csv file")


def write_parquet(rows: Table, out: Path) -> None:
    """Write the table; a missing value is null, which pandas reads as NaN. Needs pyarrow."""
    import pyarrow as pa
    import pyarrow.parquet

    kinds = {name: pa.string() if name in TEXTS else pa.float64() for name in rows} | {"frame": pa.int64()}
    columns = {name: pa.array(values, kinds[name]) for name, values in rows.items()}
    pyarrow.parquet.write_table(pa.table(columns), out)
