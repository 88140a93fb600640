"""The ``sim`` verbs: scenarios and their lock-step runs."""

import json
import sys
import textwrap
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import sim_harness.report.road_cli
from sim_harness.api import sweep
from sim_harness.footage.cli import resimulate_verb
from sim_harness.lockstep.closed_loop import check_configuration, run
from sim_harness.report.disturbance_sheet import disturbances_verb
from sim_harness.report.lead_sheet import leads_verb
from sim_harness.scenarios.boundary import TOLERANCE, Limit, limits
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.sampling import Case, Method, fresh_seed
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenario, scenario_schema
from sim_harness.sweep.outcome import ClusterLost
from sim_harness.sweep.plan import no_tagged, select, with_tags
from sim_harness.sweep.show import Display
from sim_harness.sweep.sweep import RunFiles
from trepid.config import INTERRUPTED, InputError, parse_overrides, refuse
from trepid.loudness import note
from trepid.options import Car, Changes, Chosen, RawImages

app = typer.Typer(no_args_is_help=True, add_completion=False)
app.command("resimulate")(resimulate_verb)
app.command("disturbances")(disturbances_verb)
app.command("leads")(leads_verb)
app.add_typer(
    sim_harness.report.road_cli.app, name="road", help="Show roads; read and write OpenDRIVE files."
)
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON Lines.")]
Tags = Annotated[
    list[str] | None, typer.Option("--tag", help="Only scenarios with this tag; may be repeated.")
]
RANDOM = "random"
LISTED = ("name", "tags", "description", "duration_s")


@app.command("schema")
def schema_verb() -> int:
    """Print the JSON schema of scenario files, for editors."""
    print(scenario_schema(), end="")
    return 0


@app.command("list")
def list_verb(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[S...]", help="Show these scenarios with all of their text."),
    ] = None,
    tags: Tags = None,
    car: Car = None,
    as_json: AsJson = False,
) -> int:
    """List the scenarios: name, tags and description, wrapped at the width of a terminal, else one a line."""
    scenarios = with_tags(list(select(names, [], {}).scenarios) if names else list_scenarios(), tags or [])
    if not scenarios:
        raise InputError(no_tagged(tags or []))
    if as_json:
        for scenario in scenarios:
            print(json.dumps({field: getattr(scenario, field) for field in LISTED}))
    elif names:
        for scenario in scenarios:
            tag_names = ", ".join(scenario.tags)
            print(f"{scenario.name} ({tag_names}; at most {scenario.duration_s:g} s): {scenario.description}")
    else:
        width = Console().width if sys.stdout.isatty() else None
        for scenario in scenarios:
            print(scenario_text(scenario, width))
    return 0


def scenario_text(scenario: Scenario, width: int | None) -> str:
    """Name, tags and the whole description, in lines of at most ``width`` characters; None: in one line."""
    head = f"{scenario.name:<22} {','.join(scenario.tags):<14} "
    line = head + scenario.description
    if width is None:
        return line
    indent = " " * min(len(head), width // 2)
    return textwrap.fill(line, width, subsequent_indent=indent, break_on_hyphens=False)


@app.command("run")
def run_verb(
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="[S...]", help="Scenario names, .yaml or .py files, or `all`."),
    ] = None,
    tags: Tags = None,
    seed: Annotated[
        str, typer.Option(metavar="N|random", help="The first seed; `random` draws one and prints it.")
    ] = "0",
    seeds: Annotated[int, typer.Option(min=1, help="Run this many seeds, from --seed on.")] = 1,
    settings: Changes = None,
    chosen: Chosen = None,
    sample: Annotated[
        Method | None, typer.Option(help="Draw cases from the ranges under `vary` in the scenarios.")
    ] = None,
    cases: Annotated[
        int | None,
        typer.Option(min=1, help="Cases of each scenario with --sample; default: a whole grid, else 100."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on the Dask cluster with this scheduler.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR|F.jsonl|F.parquet", help="Store every result here as it is finished."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Run only cases that --out does not hold.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="F.html", help="Write a page about all runs.")
    ] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="F.npz", help="Save the trace of a single run.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="F.png", help="Draw a single run.")] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="Record a single run in the format of a live drive.")
    ] = None,
    raw_images: RawImages = False,
    car: Car = None,
    as_json: AsJson = False,
) -> int:
    """Run scenarios in lock-step; exit code 1 when a run fails.

    The same scenario and seed give the same trace, bit for bit, on any process or machine of the same type. Rows of
    --json have the order of scenarios and seeds; other lines appear as runs finish.
    """
    refuse("--raw-images needs --record", raw_images and record is None)
    refuse("--resume needs --out", resume and out is None)
    refuse("--resume needs fixed seeds: --seed random cannot be given too", resume and seed == RANDOM)
    refuse("--cluster has its own processes: --jobs cannot be given too", cluster is not None and jobs > 1)
    overrides = {**parse_overrides(settings or []), **changes_of(chosen)}
    selection = select(sources or [], tags or [], overrides)
    refuse("--cases needs --sample", cases is not None and sample is None)
    refuse("--sample draws the seeds itself: --seeds cannot be given too", sample is not None and seeds > 1)
    display = Display(as_json=as_json)
    try:
        sweep(
            selection,
            seeds=seeds,
            sample=sample,
            cases=cases,
            seed=first_seed(seed),
            jobs=jobs,
            cluster=cluster,
            out=out,
            resume=resume,
            report=report,
            files=RunFiles(trace=trace, picture=picture, record=record, raw_images=raw_images),
            watch=display,
        )
    except KeyboardInterrupt:
        if not display.has_plan:
            raise
        display.report_end("interrupted: ")
        return INTERRUPTED
    except ClusterLost as error:
        display.report_end(f"{error}; ")
        return 1
    finally:
        display.print_rest()
    return display.report_end()


def first_seed(text: str) -> int:
    """The seed that ``text`` gives, or a random one, which is printed. Raises InputError."""
    if text == RANDOM:
        drawn = fresh_seed()
        note(f"trepid sim: seed {drawn}, drawn at random; --seed {drawn} repeats it")
        return drawn
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"--seed {text}: expected a whole number from 0 on, or {RANDOM!r}")
    return int(text)


@app.command("limits")
def limits_verb(
    source: Annotated[str, typer.Argument(metavar="S", help="A scenario name or .yaml file.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed from which the seed of the cases is derived.")] = 0,
    tolerance: Annotated[
        float, typer.Option(min=1e-4, max=0.5, help="Resolution as a share of the range.")
    ] = TOLERANCE,
    corners: Annotated[int, typer.Option(min=0, help="Number of random corners to search as well.")] = 0,
    settings: Changes = None,
    car: Car = None,
    as_json: AsJson = False,
) -> int:
    """Search the limit of each range in `vary` at which the scenario fails; exit code 1 when no case passes."""
    scenario = load_scenario(source, parse_overrides(settings or []))
    if not scenario.vary:
        raise InputError(f"scenario {scenario.name}: no ranges under vary")
    check_configuration([scenario])
    any_passes = False
    for limit in limits(scenario, passes, seed=seed, tolerance=tolerance, corners=corners):
        any_passes |= limit.passes is not None
        print(json.dumps(limit.row()) if as_json else sentence(limit), flush=True)
    return 0 if any_passes else 1


def passes(case: Case) -> bool:
    """Run a case, report it on standard error, return whether it passed."""
    result = run(case.scenario, seed=case.seed)
    values = ", ".join(f"{name} = {value}" for name, value in case.parameters.items())
    note(f"{'failed' if result.reasons else 'passed'}: {values}")
    return not result.reasons


def sentence(limit: Limit) -> str:
    """A limit as one line of text."""
    if limit.fails is None:
        return f"{limit.ray}: passes to the end of the range"
    if limit.passes is None:
        return f"{limit.ray}: no case passes"
    good, bad = limit.passes.parameters, limit.fails.parameters
    changes = [f"{name} between {good[name]} and {bad[name]}" for name in good if good[name] != bad[name]]
    return f"{limit.ray}: passes, then fails, with {', '.join(changes)}"
