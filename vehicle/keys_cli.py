"""The ``keys`` verbs."""

from pathlib import Path
from typing import Annotated

import typer

from trepid.config import parse, read
from trepid.options import Car
from trepid.processes.settings import FILE, ProcessesFile
from trepid.security import LAUNCHER, OBSERVER

app = typer.Typer(no_args_is_help=True)


@app.callback()
def keys() -> None:
    """Group of the verbs, also while there is only one."""


@app.command()
def create(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of the keys, outside version control.")
    ],
    processes: Annotated[
        list[str] | None,
        typer.Option("--process", metavar="NAME", help="A process that processes.yaml does not name."),
    ] = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option("--host", help="Address or name of a machine of the car, if processes run on several."),
    ] = None,
    car: Car = None,
) -> int:
    """Make a certificate authority and a certificate for every process; existing files are kept as they are."""
    from vehicle.certificates import create as create_keys

    roles = [LAUNCHER, OBSERVER, *parse(read(FILE), ProcessesFile, source=FILE).processes, *(processes or [])]
    made = create_keys(folder, roles, hosts or [])
    for path in made:
        print(path)
    if not made:
        print(f"{folder}: all keys exist; nothing to make")
        return 0
    print(f"Set `keys: {folder.resolve()}` in security.yaml of the car. Keep ca.key off the car.")
    return 0
