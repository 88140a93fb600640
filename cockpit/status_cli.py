"""The verbs ``status`` and ``service``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trepid.config import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from cockpit.attach import State

COLUMNS = {
    "name": "name",
    "pid": "pid",
    "rate_hz": "Hz",
    "age_s": "age s",
    "cpu_percent": "cpu %",
    "restarts": "restarts",
    "message": "message",
}
"""Field of a process -> heading: short ones, without `alive`, so that 80 columns leave room."""
MESSAGE_WIDTH = 20  # at least; a longer message is wrapped


def status(
    endpoint: Annotated[
        str | None, typer.Option(help="Zenoh endpoint of the drive, where several run.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per process.")] = False,
) -> int:
    """Show the processes of a running drive: up, rate, age of the last heartbeat, CPU, restarts, message.

    Exit code 1 when something is wrong with a process; standard error names it.
    """
    from cockpit.attach import PATIENCE_S, report_of, states
    from trepid.processes.register import choose, running

    drive = choose(endpoint, running())
    report = report_of(drive)
    if report is None:
        raise InputError(
            f"the drive {drive.what} (pid {drive.pid}, {drive.endpoint}) sent no report for {PATIENCE_S:.0f} s; "
            f"`kill {drive.pid}` ends it with all its processes"
        )
    found = states(report)
    culprits = [state for state in found if state.problem]
    if as_json:
        for state in found:
            print(json.dumps(state.row))
    else:
        from rich.console import Console

        print(f"{drive.what} at {drive.endpoint}: {report.message}")
        Console().print(table(found))
        if drive.page:
            print(f"live page: {drive.page}")
    for state in culprits:
        words = f": {state.row['message']}" if state.row["message"] else ""
        typer.echo(f"culprit: process {state.row['name']} {state.problem}{words}", err=True)
    return 1 if culprits else 0


def table(found: "list[State]") -> "Table":
    """The processes as a table."""
    from rich.table import Table
    from rich.text import Text

    made = Table(box=None, pad_edge=False)
    for name, heading in COLUMNS.items():
        if name == "message":
            made.add_column(heading, min_width=MESSAGE_WIDTH, overflow="fold")
        else:
            made.add_column(heading, justify="left" if name == "name" else "right", no_wrap=True)
    for state in found:
        row = state.row if state.row["alive"] else state.row | {"message": _not_running(state.row["message"])}
        cells = ["-" if row[name] is None else str(row[name]) for name in COLUMNS]
        made.add_row(*map(Text, cells), style="red" if state.problem else None)
    return made


def _not_running(message: str) -> str:
    return f"not running: {message}" if message else "not running"


def service(
    car: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the car.")],
    out: Annotated[Path, typer.Option(help="Folder for the units.")] = Path(),
    user: Annotated[
        bool, typer.Option("--user", help="Units of a user's systemd instead of the system's.")
    ] = False,
) -> int:
    """Write a systemd unit that drives a car, with readiness and watchdog notifications."""
    from cockpit.service import write_units

    for path in write_units(car, out, user=user):
        print(path)
    return 0
