"""``trepid fear explain RECORDING``: every slow-down of a drive, or the explanation of a moment."""

import json
from pathlib import Path

import typer

from cockpit.logbook.moment import moment_figure
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import overview, story
from cockpit.logbook.story_text import overview_text, story_text
from trepid.config import InputError
from trepid.images.figure_style import save

MAGIC = b"\x89MCAP"


def is_recording(path: Path) -> bool:
    """Whether ``path`` is an MCAP file by its name or its first bytes."""
    if path.suffix == ".mcap":
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # the reader of rule files reports the error


def explain_drive(
    path: Path, at_s: float | None, *, rules: Path | None, picture: Path | None, as_json: bool
) -> bool:
    """Print the explanation of the moment ``at_s``, or all slow-downs; False when there is no slow-down to list.

    Raises InputError when ``path`` holds no decisions, or ``at_s`` is not in it.
    """
    drive = recall(path, rules)
    if at_s is None:
        return _list(drive, picture=picture, as_json=as_json)
    try:
        answer = story(drive, at_s)
    except ValueError as error:
        raise InputError(f"{path}: --at {at_s:g}: {error}") from error
    typer.echo(json.dumps(answer) if as_json else story_text(answer))
    if picture is not None:
        save(moment_figure(drive, answer), picture)
    return True


def _list(drive: Recall, *, picture: Path | None, as_json: bool) -> bool:
    if picture is not None:
        raise InputError(f"--picture {picture}: of which moment? Give --at")
    found = overview(drive)
    if as_json:
        for slow_down in found:
            typer.echo(json.dumps(slow_down))
    else:
        typer.echo(overview_text(drive.recorded, found))
    return bool(found)
