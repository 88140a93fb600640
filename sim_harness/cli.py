"""The ``sim`` verbs: scenarios and lock-step runs."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import cv2
import typer
from rich.console import Console
from rich.table import Table

import sim_harness.roads.cli
from sim_harness.lockstep.closed_loop import run, run_many
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenarios
from sim_harness.scenarios.schema import schema_verb
from trepid.config import InputError, parse_overrides

app = typer.Typer(no_args_is_help=True, add_completion=False)
app.command("schema")(schema_verb)
app.add_typer(sim_harness.roads.cli.app, name="road", help="Roads to and from OpenDRIVE files.")
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON Lines.")]


@app.command("list")
def list_verb(as_json: AsJson = False) -> int:
    """List the scenarios."""
    scenarios = list_scenarios()
    if as_json:
        for scenario in scenarios:
            fields = ("name", "tags", "description", "duration_s")
            print(json.dumps({field: getattr(scenario, field) for field in fields}))
        return 0
    table = Table(box=None)
    for heading in ("scenario", "tags", "at most", "description"):
        table.add_column(heading, overflow="fold")
    for scenario in scenarios:
        table.add_row(
            scenario.name, ", ".join(scenario.tags), f"{scenario.duration_s:g} s", scenario.description
        )
    Console().print(table)
    return 0


@app.command("run")
def run_verb(
    sources: Annotated[list[str], typer.Argument(metavar="S...", help="Scenario names, .yaml or .py files.")],
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Run this many seeds, from --seed on.")] = 1,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
    trace: Annotated[Path | None, typer.Option(help="Save the trace of a single run as .npz.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Draw a single run as .png.")] = None,
    as_json: AsJson = False,
) -> int:
    """Run scenarios in lock-step; exit code 1 when one of them fails."""
    overrides = parse_overrides(settings or [])
    scenarios = [scenario for source in sources for scenario in load_scenarios(source, overrides)]
    for scenario in scenarios:
        scenario.check()
    total = len(scenarios) * seeds
    rows = run_many(scenarios, range(seed, seed + seeds), jobs=jobs)
    if trace is not None or picture is not None:
        check_outputs(total, trace, picture)
        rows = run_and_save(scenarios[0], seed, trace, picture)
    failed = 0
    for number, row in enumerate(rows, start=1):
        failed += row["status"] == "failed"
        if as_json:
            print(json.dumps(row), flush=True)
        print(f"[{number}/{total}] {one_line(row)}", file=sys.stderr if as_json else sys.stdout, flush=True)
    return 1 if failed else 0


def check_outputs(total: int, *paths: Path | None) -> None:
    """Raise InputError unless there is one run to save, and a folder for each file."""
    for path in filter(None, paths):
        if total > 1:
            raise InputError(f"{path}: can hold one run, not {total}")
        if not path.parent.is_dir():
            raise InputError(f"{path}: there is no folder {path.parent}")


def run_and_save(
    scenario: Scenario, seed: int, trace: Path | None, picture: Path | None
) -> Iterator[dict[str, Any]]:
    """The row of one run, after its trace and picture are saved."""
    result = run(scenario, seed=seed)
    if trace is not None:
        result.trace.save(trace)
    if picture is not None:
        from sim_harness.report.picture import draw

        if not cv2.imwrite(str(picture), draw(scenario, result.trace, seed=seed)):
            raise InputError(f"{picture}: cannot be written as an image")
    yield result.row()


def one_line(row: dict[str, Any]) -> str:
    """A run in a line for people."""
    text = (
        f"{row['scenario']} seed {row['seed']}: {row['status']}, {row['distance_m']:.0f} m in"
        f" {row['duration_s']:.1f} s, error max {row['max_lateral_error_m']:.2f} m rms"
        f" {row['rms_lateral_error_m']:.2f} m, departures {row['departures']}, interventions"
        f" {row['interventions']}, {row['realtime_factor']:.1f}x real time"
    )
    return text + "".join(f"\n    {reason}" for reason in row["reasons"])
