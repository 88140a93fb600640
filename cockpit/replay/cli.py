"""The ``replay`` verb."""

import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trepid.config import InputError
from trepid.loudness import note
from trepid.options import Car

if TYPE_CHECKING:
    from cockpit.replay.difference import Difference
    from cockpit.replay.rerun import Rerun

SHOWN_MODES = 5


def replay(
    recording: Annotated[Path, typer.Argument(metavar="F.mcap", help="Recording of a drive.")],
    rate: Annotated[
        float, typer.Option(min=0.01, max=100.0, help="Onto the bus: times as fast as recorded.")
    ] = 1.0,
    through: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NODE",
            help="Run a node on its recorded inputs instead: supervisor, controller, lead, statistics, an"
            " estimator, or all; may be repeated.",
        ),
    ] = None,
    rules: Annotated[
        Path | None,
        typer.Option(metavar="F.yaml", help="With --through: these rules instead of the recorded ones."),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="F.onnx",
            help="With --through: this driving network instead of the recorded one of the same name; may be"
            " repeated.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="F.mcap", help="With --through: write a recording with the new outputs."),
    ] = None,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="With --through: print JSON only.")] = False,
) -> int:
    """Play a recording onto the bus, or run nodes on its inputs again and show what differs.

    The settings are those of the recorded drive, unless --car, --rules or --estimator gives others. Exit code 1
    when an output differs.
    """
    if through:
        return _again(recording, through, rules=rules, networks=estimator or [], out=out, as_json=as_json)
    if rules is not None or out is not None or as_json or estimator:
        raise InputError(
            "--rules, --estimator, --out and --json need --through: `--through all` runs every node again"
        )
    return _play(recording, rate)


def _again(
    recording: Path,
    through: list[str],
    *,
    rules: Path | None,
    networks: list[str],
    out: Path | None,
    as_json: bool,
) -> int:
    from cockpit.replay.rerun import rerun
    from trepid.recording.writer import check_recording

    if out is not None:
        check_recording(out)
    found = rerun(recording, through, rules=rules, networks=networks, out=out)
    print(json.dumps(_row(found)) if as_json else _text(found))
    return 1 if found.differences else 0


def _play(recording: Path, rate: float) -> int:
    from cockpit.replay.play import play
    from trepid.config import CONFIG_DIR, load
    from trepid.processes.drive_settings import DriveSettings

    vehicle_name = load(CONFIG_DIR / "drive.yaml", DriveSettings).vehicle_name
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(1))
    count = play(
        recording,
        rate=rate,
        vehicle_name=vehicle_name,
        say=lambda text: note(f"trepid replay: {text}"),
        running=lambda: not ended,
    )
    print(f"{count} messages")
    return 0


def _row(found: "Rerun") -> dict[str, Any]:
    """The result for ``--json``."""
    return {
        "frames": found.frames,
        "differences": found.differences,
        "first_difference": found.first.row() if found.first else None,
        "realtime_factor": round(found.drive_s / found.wall_s, 2),
        "topics": {
            key: {
                "compared": one.compared,
                "differences": one.different,
                "first_difference": one.first.row() if one.first else None,
                "same_inputs": not found.doubts[key],
                "doubt": found.doubts[key],
                "greatest": {name: worst.row() for name, worst in one.greatest.items()},
                "modes": [change.row() for change in one.modes],
            }
            for key, one in found.topics.items()
        },
        "left_out": dict(found.left_out),
        "lost": found.lost,
    }


def _text(found: "Rerun") -> str:
    """The result as lines."""
    lines = [
        f"{found.drive_s:.1f} s in {found.wall_s:.1f} s ({found.drive_s / found.wall_s:.0f} times real time),"
        f" {found.frames} frames, {found.differences} outputs differ"
    ]
    if found.lost:
        lines.append(
            f"{found.lost} messages of corrupted parts are lost; steps without their inputs may differ"
        )
    for key, one in found.topics.items():
        differ = "all the same" if not one.different else f"{one.different} differ"
        lines.append(f"{key}: {one.compared} compared, {differ}")
        if one.first is not None:
            lines.append(f"  first {_change(one.first)}")
        lines += [f"  greatest {_change(worst)}" for worst in one.greatest.values()]
        lines += [f"  {_change(change)}" for change in one.modes[:SHOWN_MODES]]
        if len(one.modes) > SHOWN_MODES:
            lines.append(f"  and {len(one.modes) - SHOWN_MODES} more differences of the mode")
        if found.doubts[key]:
            lines.append(f"  not exact: {found.doubts[key]}")
    by_reason: dict[str, list[str]] = {}
    for name, why in found.left_out.items():
        by_reason.setdefault(why, []).append(name)
    lines += [f"not run again: {', '.join(names)}: {why}" for why, names in by_reason.items()]
    return "\n".join(lines)


def _change(one: "Difference") -> str:
    return f"at {one.t_s:.3f} s: {one.field} {_value(one.recorded)}, in the replay {_value(one.replayed)}"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(map(_value, value)) + ")"
    return f"{value:.6g}" if isinstance(value, float) else "none" if value is None else str(value)
