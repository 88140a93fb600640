"""The ``sim`` verbs: scenarios and their lock-step runs."""

import json
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import sim_harness.report.road_cli
from sim_harness.footage.cli import resimulate_verb
from sim_harness.lockstep.configuration import check_configuration
from sim_harness.report.disturbance_sheet import disturbances_verb
from sim_harness.report.lead_sheet import leads_verb
from sim_harness.report.page import Page
from sim_harness.scenarios.sampling import Method, fresh_seed
from sim_harness.scenarios.scenario import Scenario, Tag, list_scenarios
from sim_harness.scenarios.schema import schema_verb
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.limits_cli import limits_verb
from sim_harness.sweep.plan import Plan, by_sampling, by_seeds, plan, select
from sim_harness.sweep.plan_store import PlanStore
from sim_harness.sweep.show import Report, Show
from sim_harness.sweep.sweep import Workforce, saving, workforce
from trepid.config import InputError, parse_overrides

app = typer.Typer(no_args_is_help=True, add_completion=False)
app.command("schema")(schema_verb)
app.command("resimulate")(resimulate_verb)
app.command("limits")(limits_verb)
app.command("disturbances")(disturbances_verb)
app.command("leads")(leads_verb)
app.add_typer(
    sim_harness.report.road_cli.app, name="road", help="Show roads; read and write OpenDRIVE files."
)
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON Lines.")]
Tags = Annotated[
    list[Tag] | None, typer.Option("--tag", help="Only scenarios with this tag; may be repeated.")
]
RANDOM = "random"
LISTED = ("name", "tags", "description", "duration_s")


@app.command("list")
def list_verb(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[S...]", help="Show these scenarios with all of their text."),
    ] = None,
    tags: Tags = None,
    as_json: AsJson = False,
) -> int:
    """List the scenarios, one a line and shortened to the width of the terminal."""
    scenarios = list(select(names, [], {}).scenarios) if names else list_scenarios()
    scenarios = [s for s in scenarios if not tags or set(tags) & set(s.tags)]
    if as_json:
        for scenario in scenarios:
            print(json.dumps({field: getattr(scenario, field) for field in LISTED}))
    elif names:
        for scenario in scenarios:
            tag_names = ", ".join(scenario.tags)
            print(f"{scenario.name} ({tag_names}; at most {scenario.duration_s:g} s): {scenario.description}")
    else:
        for scenario in scenarios:
            print(scenario_line(scenario, Console().width))
    return 0


def scenario_line(scenario: Scenario, width: int) -> str:
    """Name, tags and description of a scenario, cut to ``width`` characters."""
    tag_names = ",".join(scenario.tags)
    line = f"{scenario.name:<22} {tag_names:<14} {scenario.description}"
    return line if len(line) <= width else line[: width - 1] + "…"


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
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Another value for a field of the scenarios."),
    ] = None,
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
        bool, typer.Option("--resume", help="Run only the cases that --out does not hold.")
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
    as_json: AsJson = False,
) -> int:
    """Run scenarios in lock-step; exit code 1 when a run fails.

    The same scenario and seed give the same trace, bit for bit, on any process or machine of the same type. Rows of
    --json have the order of scenarios and seeds; other lines appear as runs finish.
    """
    refuse(
        {
            "--cases needs --sample": cases is not None and sample is None,
            "--sample draws the seeds itself: --seeds cannot be given too": sample is not None and seeds > 1,
            "--resume needs --out": resume and out is None,
            "--resume needs fixed seeds: --seed random cannot be given too": resume and seed == RANDOM,
            "--cluster has its own processes: --jobs cannot be given too": cluster is not None and jobs > 1,
        }
    )
    first = first_seed(seed)
    selection = select(sources or [], tags or [], parse_overrides(settings or []))
    if sample is None:
        planned = plan(by_seeds(selection.scenarios, range(first, first + seeds)))
    else:
        planned = plan(by_sampling(selection.scenarios, sample, cases, seed=first))
    check_outputs(planned, trace, picture, record)
    check_folders(report, trace, picture, record)
    check_configuration(case.scenario for case in planned.values())
    work: Workforce = workforce(jobs=min(jobs, len(planned)), cluster=cluster, detailed=report is not None)
    if trace or picture or record:
        work = partial(saving, trace=trace, picture=picture, record=record, detailed=report is not None)
    page = Report(path=report, page=Page("trepid sim run"), command=selection.command) if report else None
    with ExitStack() as stack:
        store = (
            stack.enter_context(PlanStore(out, planned, code=fingerprint(), resume=resume)) if out else None
        )
        return Show(planned, work, store=store, report=page, as_json=as_json).run()


def refuse(wrong: dict[str, bool]) -> None:
    """Raise InputError with the first sentence whose value is true."""
    for sentence, is_true in wrong.items():
        if is_true:
            raise InputError(sentence)


def first_seed(text: str) -> int:
    """The seed that ``text`` gives, or a random one, which is printed. Raises InputError."""
    if text == RANDOM:
        drawn = fresh_seed()
        print(
            f"trepid sim: seed {drawn}, drawn at random; --seed {drawn} repeats it",
            file=sys.stderr,
            flush=True,
        )
        return drawn
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"--seed {text}: expected a whole number from 0 on, or {RANDOM!r}")
    return int(text)


def check_outputs(planned: Plan, *files: Path | None) -> None:
    """Raise InputError when ``files`` are given for more than one run."""
    for file in filter(None, files):
        if len(planned) > 1:
            raise InputError(f"{file}: can hold one run, not {len(planned)}")


def check_folders(*files: Path | None) -> None:
    """Raise InputError unless the folder of each file exists."""
    for file in filter(None, files):
        if not file.parent.is_dir():
            raise InputError(f"{file}: there is no folder {file.parent}")
