"""The ``drive`` verb."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from sim_harness.live.drive import DriveSettings, Show
from sim_harness.live.drive import drive as drive_scenario
from sim_harness.live.drive_log import DriveLog
from sim_harness.live.drive_status import Warnings, driving_line, status
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import CONFIG_DIR, load, parse_overrides
from trepid.processes.launch import Fleet

PLAIN_PERIOD_S = 2.0  # between lines when standard error is no terminal


def drive(
    scenario: Annotated[str, typer.Option(help="Scenario name or file.")] = "circuit",
    duration: Annotated[float | None, typer.Option(min=1.0, help="Stop after this long [s].")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and noise.")] = 0,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Another value for a field of the scenario."),
    ] = None,
    dashboard: Annotated[bool, typer.Option(help="Live status in the terminal.")] = True,
    record: Annotated[Path | None, typer.Option(help="Record every topic to this MCAP file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> int:
    """Drive with all processes (camera, perception, supervisor, controller, vehicle) over Zenoh."""
    what = load_scenario(scenario, parse_overrides(changes or []))
    what.check()
    if duration is not None:
        what = what.shortened(duration)
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    with shown(dashboard) as show:
        row = drive_scenario(what, settings, seed=seed, show=show, record=record)
    if as_json:
        print(json.dumps(row))
    else:
        Console().print(summary(row))
    return 0 if row["status"] == "passed" else 1


@contextmanager
def shown(dashboard: bool) -> Iterator[Show]:
    """Display of the drive on standard error: a live table in a terminal, else a line every few seconds.

    Without the table, each new warning or error of a process is a line of its own.
    """
    console = Console(stderr=True)
    if dashboard and console.is_terminal:
        with Live(console=console, auto_refresh=False, transient=True) as live:
            yield lambda log, fleet, elapsed_s: live.update(
                status(log, fleet, elapsed_s=elapsed_s), refresh=True
            )
        return
    printed_s = -PLAIN_PERIOD_S
    warnings = Warnings()

    def show(log: DriveLog, fleet: Fleet, elapsed_s: float) -> None:
        nonlocal printed_s
        for line in warnings.new(log.diagnostics.values()):
            print(line, file=sys.stderr, flush=True)
        if elapsed_s - printed_s >= PLAIN_PERIOD_S or elapsed_s < printed_s:
            printed_s = elapsed_s
            print(driving_line(log, elapsed_s=elapsed_s).plain, file=sys.stderr, flush=True)

    yield show


def summary(row: dict[str, Any]) -> Table:
    """The result as a table."""
    verdict = "[green]passed[/]" if row["status"] == "passed" else "[red]failed[/]"
    table = Table(title=f"{row['scenario']} (seed {row['seed']}): {verdict}", title_justify="left", box=None)
    table.add_column("what", style="dim")
    table.add_column("value")
    for reason in row["reasons"]:
        table.add_row("reason", f"[red]{reason}[/]")
    for key, value in row.items():
        if key in ("scenario", "seed", "status", "reasons", "processes", "latency_ms"):
            continue
        table.add_row(key, _text(value))
    for name, load_ in row.get("processes", {}).items():
        table.add_row(f"process {name}", ", ".join(f"{key} {value}" for key, value in load_.items()))
    for name, times in row.get("latency_ms", {}).items():
        table.add_row(f"{name} ms", _text(times))
    return table


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return "-" if value is None else str(value)
