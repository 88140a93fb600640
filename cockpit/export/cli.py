"""The ``export`` verb."""

import json
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trepid.config import InputError
from trepid.loudness import note, warn
from trepid.options import Car

if TYPE_CHECKING:
    from cockpit.export.drive import Drive

SPOKEN_S = 2.0  # between two reports of the progress


class Format(StrEnum):
    """The formats of an export."""

    CSV = "csv"
    PARQUET = "parquet"
    VIDEO = "video"
    FIGURE = "figure"
    TUB = "tub"
    LEROBOT = "lerobot"
    FOXGLOVE = "foxglove"


SUFFIXES = {
    ".csv": Format.CSV,
    ".parquet": Format.PARQUET,
    ".mp4": Format.VIDEO,
    ".png": Format.FIGURE,
    ".svg": Format.FIGURE,
    ".pdf": Format.FIGURE,
    ".mcap": Format.FOXGLOVE,
    "": Format.TUB,
}


def export(
    recording: Annotated[Path, typer.Argument(metavar="F.mcap", help="Recording of a drive.")],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="New file, by its suffix: .csv, .parquet, .mp4 (video with overlay), .png, .svg or .pdf (figure);"
            " .mcap (for Foxglove and Lichtblick); or a new folder: tub of donkeycar, with --to lerobot a LeRobot"
            " data set. It is never overwritten.",
        ),
    ],
    to: Annotated[Format | None, typer.Option("--to", help="The format, whatever the suffix.")] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=1000.0,
            help="Rows or video frames per second [Hz], e.g. 20; default: a row per camera frame, and the usual"
            " rate of the images. For tables and videos.",
        ),
    ] = None,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> int:
    """Export a recording as table, video, figure, tub of donkeycar, LeRobot data set, or for Foxglove.

    A row holds the newest message of each topic at its time, and never a later one. The settings are those of the
    recorded car, unless --car gives others.
    """
    from cockpit.export.drive import Drive
    from cockpit.export.place import new_place
    from cockpit.export.table import check_parquet
    from trepid.recording.images import recorded_car

    kind = _format(out, to)
    if rate is not None and kind in (Format.TUB, Format.LEROBOT, Format.FOXGLOVE):
        raise InputError(f"--rate is for tables and videos: the format {kind} has the times of the recording")
    if kind in (Format.PARQUET, Format.LEROBOT):
        check_parquet(out)
    with new_place(out) as work:
        drive = Drive(recording)
        note(f"trepid export: {len(drive.frames_s)} camera frames")
        with recorded_car(drive.recorded):
            counts = _write_export(drive, work, kind, rate)
    if not drive.recorded.complete:
        warn("trepid export: the recording is cut short; exported up to its last whole chunk")
    if drive.lost:
        parts, messages = len(drive.lost), sum(drive.lost.values())
        warn(f"trepid export: {messages} messages of {parts} corrupted parts are lost; exported without them")
    for key, count in drive.impossible.items():
        warn(f"trepid export: {key}: {count} messages with an impossible capture time give no frame")
    summary = {
        "file": str(out),
        "format": str(kind),
        **counts,
        "from_s": round(drive.frames_s[0] - drive.zero_s, 6),
        "to_s": round(drive.frames_s[-1] - drive.zero_s, 6),
        "complete": drive.recorded.complete,
        "corrupted_parts": len(drive.lost),
        "lost": sum(drive.lost.values()),
        "malformed": dict(drive.recorded.malformed),
        "impossible": drive.impossible,
    }
    print(json.dumps(summary) if as_json else f"{out}: {counts['rows']} {_UNITS[kind]}")
    return 0


_UNITS = {
    Format.CSV: "rows",
    Format.PARQUET: "rows",
    Format.VIDEO: "video frames",
    Format.FIGURE: "moments",
    Format.TUB: "records",
    Format.LEROBOT: "frames",
    Format.FOXGLOVE: "messages added",
}


def _format(out: Path, to: Format | None) -> Format:
    """The format of the export. Raises InputError for an unknown suffix, or one that the format cannot have."""
    suffix = out.suffix.lower()
    if to is None:
        if suffix not in SUFFIXES:
            known = ", ".join(filter(None, SUFFIXES))
            raise InputError(
                f"{out}: unknown suffix {suffix}; known: {known}, or none for a tub; or give --to"
            )
        return SUFFIXES[suffix]
    if to in {Format.VIDEO, Format.FIGURE, Format.FOXGLOVE} and SUFFIXES.get(suffix) is not to:
        fitting = ", ".join(name for name, kind in SUFFIXES.items() if kind is to)
        raise InputError(f"{out}: the suffix of a {to} is {fitting}")
    return to


def _write_export(drive: "Drive", work: Path, kind: Format, rate_hz: float | None) -> dict[str, Any]:
    """Write the export to ``work``; its number of rows, and what was left out."""
    from cockpit.export import table

    if kind is Format.TUB:
        from cockpit.export.frames import of_drive
        from cockpit.export.tub import write_tub
        from trepid.car.vehicle import Vehicle
        from trepid.config import CONFIG_DIR, load

        lock_rad = load(CONFIG_DIR / "vehicle.yaml", Vehicle).max_road_wheel_angle_rad
        records = write_tub(of_drive(drive, _progress()), work, lock_rad=lock_rad)
        return {"rows": records, "left_out": len(drive.image_s) - records}
    if kind is Format.LEROBOT:
        from cockpit.export.frames import of_drive, rate_of
        from cockpit.export.lerobot import write_lerobot

        task = drive.recorded.notes.get("what") or "drive"  # a real car notes no scenario
        frames = of_drive(drive, _progress())
        found = write_lerobot(frames, work, rate_hz=rate_of(drive.image_s), task=task)
        return {"rows": found, "left_out": len(drive.image_s) - found}
    if kind is Format.FOXGLOVE:
        from cockpit.foxglove.convert import write_viewable

        return {"rows": write_viewable(drive.recorded, work, _progress())}
    if kind is Format.VIDEO:
        from cockpit.export.film import write_film

        return {"rows": write_film(drive, work, rate_hz, _progress())}
    rows = table.table(drive, table.times(drive, rate_hz))
    if kind is Format.FIGURE:
        from cockpit.export.figure import write_figure

        write_figure(rows, drive.estimators, work, drive.recorded.notes.get("what", drive.path.name))
    else:
        (table.write_csv if kind is Format.CSV else table.write_parquet)(rows, work)
    counts = {"rows": len(rows["t_s"])}
    return counts if kind is Format.FIGURE else counts | {"columns": list(rows)}


def _progress() -> Callable[[float], None]:
    """A function that prints the share that is done, every SPOKEN_S."""
    spoken_s = time.monotonic()

    def report_share(share: float) -> None:
        nonlocal spoken_s
        if time.monotonic() - spoken_s >= SPOKEN_S:
            spoken_s = time.monotonic()
            note(f"trepid export: {share:.0%}")

    return report_share
