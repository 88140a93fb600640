"""``trepid fear explain RECORDING``: every slow-down of a drive, or the story of one."""

import json
from pathlib import Path

import typer

from cockpit.logbook.moment import moment_figure
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import overview, story
from cockpit.logbook.story_text import listed, told
from cockpit.pictures.style import save
from trepid.config import InputError

MAGIC = b"\x89MCAP"


def is_recording(path: Path) -> bool:
    """Whether ``path`` is, or is called, an MCAP file."""
    if path.suffix == ".mcap":
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # who reads it as a rule file will say what is wrong with it


def explain_drive(
    path: Path, at_s: float | None, *, rules: Path | None, picture: Path | None, as_json: bool
) -> bool:
    """Print why the drive slowed down at ``at_s``, or where it did at all; False when it did not.

    Raises InputError when ``path`` holds no decisions, or ``at_s`` is not in it.
    """
    drive = recall(path, rules)
    if at_s is None:
        return _list(drive, picture=picture, as_json=as_json)
    try:
        answer = story(drive, at_s)
    except ValueError as error:
        raise InputError(f"{path}: --at {at_s:g}: {error}") from error
    typer.echo(json.dumps(answer) if as_json else told(answer))
    if picture is not None:
        if answer["slowed_by"] is None:
            raise InputError(f"--picture {picture}: there is no slow-down to draw")
        save(moment_figure(drive, answer), picture)
    return answer["slowed_by"] is not None


def _list(drive: Recall, *, picture: Path | None, as_json: bool) -> bool:
    if picture is not None:
        raise InputError(f"--picture {picture}: of which moment? Say --at")
    found = overview(drive)
    if as_json:
        for slow_down in found:
            typer.echo(json.dumps(slow_down))
    else:
        typer.echo(listed(drive.recorded, found))
    return bool(found)
