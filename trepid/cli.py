"""The command line: every verb of Trepid, mounted from the package that does the work.

Exit codes: 0 good, 1 ran and failed its criterion, 2 bad usage, configuration or input (one clear line).
With ``--json`` standard output carries JSON only; progress and logs go to standard error.
"""

import os
import sys
from io import TextIOWrapper

import typer
from typer.exceptions import TyperException

import controller.cli
import perception.cli
import sim_harness.cli
import supervisor.cli
from sim_harness.bench import bench
from sim_harness.live.drive_cli import drive
from sim_harness.training.train import train
from sim_harness.training.train_lead import train_lead
from sim_harness.tuning.cli import tune
from trepid import __version__
from trepid.config import InputError
from trepid.packages import check_packages

app = typer.Typer(
    name="trepid",
    help="A camera lane keeper for research vehicles that knows when to be afraid.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("drive")(drive)
app.add_typer(sim_harness.cli.app, name="sim", help="Run scenarios in lock-step, faster than real time.")
app.command("estimate")(perception.cli.estimate)
app.add_typer(supervisor.cli.app, name="fear", help="Check, show and explain fuzzy rule files.")
supervisor.cli.app.command("tune")(tune)  # by the harness, which the supervisor does not know
app.add_typer(controller.cli.app, name="vehicle", help="The bicycle model with understeer.")
app.command("train")(train)
app.command("train-lead")(train_lead)
app.command("bench")(bench)


@app.callback(invoke_without_command=True)
def root(version: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    """A camera lane keeper for research vehicles that knows when to be afraid."""
    if version:
        typer.echo(f"trepid {__version__}")
        raise typer.Exit


def main() -> int:
    """Run the command line; return the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names may hold what a terminal cannot show
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
        # The reader of our output left, e.g. `| head`: nothing more can be written, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return result if isinstance(result, int) else 0


def _one_line(error: Exception) -> str:
    text = error.format_message() if isinstance(error, TyperException) else str(error)
    return " ".join(text.split())
