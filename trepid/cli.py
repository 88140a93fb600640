"""The command line: every verb of Trepid, mounted from the package that implements it.

Exit codes: 0 good, 1 ran and failed its criterion, 2 bad usage, configuration or input (one clear line).
With ``--json`` standard output carries JSON only; progress and logs go to standard error.
"""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from io import TextIOWrapper
from typing import Any

import typer
from rich.markup import escape
from typer.core import TyperGroup
from typer.exceptions import TyperException

from trepid import __version__
from trepid.config import InputError
from trepid.packages import check_packages


def _drive(mount: typer.Typer) -> None:
    from sim_harness.live.drive_cli import drive

    mount.command("drive")(drive)


def _sim(mount: typer.Typer) -> None:
    import sim_harness.cli

    mount.add_typer(
        sim_harness.cli.app, name="sim", help="Run scenarios in lock-step, faster than real time."
    )


def _estimate(mount: typer.Typer) -> None:
    import perception.cli

    mount.command("estimate")(perception.cli.estimate)


def _camera(mount: typer.Typer) -> None:
    import perception.camera.cli

    mount.add_typer(
        perception.camera.cli.app, name="camera", help="Calibrate a camera: its lens and how it is mounted."
    )


def _fear(mount: typer.Typer) -> None:
    import cockpit.rulebook.cli
    from sim_harness.tuning.cli import tune

    cockpit.rulebook.cli.app.command("tune")(tune)
    mount.add_typer(cockpit.rulebook.cli.app, name="fear", help="Check, show and explain fuzzy rule files.")


def _vehicle(mount: typer.Typer) -> None:
    import controller.cli

    mount.add_typer(controller.cli.app, name="vehicle", help="The bicycle model with understeer.")


def _train(mount: typer.Typer) -> None:
    from learning.lane.train import train

    mount.command("train")(train)


def _train_lead(mount: typer.Typer) -> None:
    from learning.lead.train import train_lead

    mount.command("train-lead")(train_lead)


def _bench(mount: typer.Typer) -> None:
    from sim_harness.bench.cli import bench

    mount.command("bench")(bench)


VERBS: dict[str, Callable[[typer.Typer], None]] = {
    "drive": _drive,
    "sim": _sim,
    "estimate": _estimate,
    "camera": _camera,
    "fear": _fear,
    "vehicle": _vehicle,
    "train": _train,
    "train-lead": _train_lead,
    "bench": _bench,
}


class Mounted(Mapping[str, Any]):
    """The verbs by name, each imported at its first use."""

    def __getitem__(self, name: str) -> Any:  # a command of Typer, whose type is private
        return _mounted(name)

    def __iter__(self) -> Iterator[str]:
        return iter(VERBS)

    def __len__(self) -> int:
        return len(VERBS)


@cache
def _mounted(name: str) -> Any:  # a command of Typer, whose type is private
    mount = typer.Typer()
    VERBS[name](mount)
    command = typer.main.get_group(mount).commands[name]
    _escape_help(command)
    return command


def _escape_help(command: Any) -> None:
    """Escape the help of ``command`` and below: Rich takes a unit such as [m] for a style and drops it."""
    for described in (command, *command.params):
        if getattr(described, "help", None):
            described.help = escape(described.help)
    for child in getattr(command, "commands", {}).values():
        _escape_help(child)


class Verbs(TyperGroup):
    """The group of all verbs, each imported when it is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings | {"commands": Mounted()})


app = typer.Typer(
    cls=Verbs,
    name="trepid",
    help="A camera lane keeper for research vehicles, with a fuzzy supervisor of its estimates.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def root(version: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    """A camera lane keeper for research vehicles, with a fuzzy supervisor of its estimates."""
    if version:
        typer.echo(f"trepid {__version__}")
        raise typer.Exit


def main() -> int:
    """Run the command line; return the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names may contain characters that the terminal cannot print
            stream.reconfigure(errors="backslashreplace")
    try:
        check_packages()
        result = app(standalone_mode=False)
    except (InputError, TyperException) as error:
        print(f"trepid: {_one_line(error)}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        return 130
    except BrokenPipeError:
        # The reader of the output has ended, e.g. `| head`: discard all further output, also at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return result if isinstance(result, int) else 0


def _one_line(error: Exception) -> str:
    text = error.format_message() if isinstance(error, TyperException) else str(error)
    return " ".join(text.split())
