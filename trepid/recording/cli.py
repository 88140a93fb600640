"""The ``record`` verbs."""

import time
from pathlib import Path
from typing import Annotated

import typer

from trepid.recording.ring import join_secured_parts, kept_name, ring_of, secure_parts
from trepid.recording.writer import check_recording

app = typer.Typer(no_args_is_help=True)


@app.callback()
def record() -> None:
    """Recordings of the last minutes, which every drive writes."""


@app.command()
def keep(
    out: Annotated[
        Path | None,
        typer.Option(metavar="F.mcap", help="The new recording; default: a name in the user's state folder."),
    ] = None,
    endpoint: Annotated[
        str | None, typer.Option(help="Zenoh endpoint of the drive, where several run.")
    ] = None,
) -> None:
    """Keep the last minutes of the running drive, or of the last one, as one recording, and print its name."""
    if out is not None:
        check_recording(out)
    safe = secure_parts(ring_of(endpoint))
    path = kept_name("by-hand", now_s=time.time()) if out is None else out
    join_secured_parts(safe, path)
    print(path)
