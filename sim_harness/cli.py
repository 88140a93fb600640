"""The ``sim`` verbs: scenarios, and lock-step runs of them."""

import json
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

import sim_harness.report.road_cli
from sim_harness.footage.cli import resimulate_verb
from sim_harness.report.disturbance_sheet import disturbances_verb
from sim_harness.report.lead_sheet import leads_verb
from sim_harness.report.page import Page
from sim_harness.scenarios.sampling import Method, fresh_seed
from sim_harness.scenarios.scenario import Tag, list_scenarios
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
    list[Tag] | None, typer.Option("--tag", help="Only scenarios with this tag; again for another one.")
]
RANDOM = "random"


@app.command("list")
def list_verb(tags: Tags = None, as_json: AsJson = False) -> int:
    """List the scenarios."""
    scenarios = [s for s in list_scenarios() if not tags or set(tags) & set(s.tags)]
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
        Method | None, typer.Option(help="Draw cases from what may `vary` in the scenarios.")
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
        typer.Option(metavar="DIR|F.jsonl|F.parquet", help="Keep each result here as soon as it is there."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Run only what --out does not have yet.")] = False,
    report: Annotated[Path | None, typer.Option(metavar="F.html", help="Write a page on all runs.")] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="F.npz", help="Save the trace of a single run.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="F.png", help="Draw a single run.")] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="Record a single run, as a live drive is.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Run scenarios in lock-step; exit code 1 when one of them fails.

    The same scenario and seed give the same trace, bit for bit, wherever it runs. Rows of --json come in the order
    of scenarios and seeds, lines for people as runs finish.
    """
    refuse(
        {
            "--cases needs --sample": cases is not None and sample is None,
            "--sample draws the seeds itself: --seeds cannot be given too": sample is not None and seeds > 1,
            "--resume needs --out": resume and out is None,
            "--resume cannot go on with seeds that are drawn anew": resume and seed == RANDOM,
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
    """Raise InputError with the first of these sentences that is true."""
    for sentence, is_true in wrong.items():
        if is_true:
            raise InputError(sentence)


def first_seed(text: str) -> int:
    """The seed that ``text`` names, or one that is drawn and told. Raises InputError."""
    if text == RANDOM:
        drawn = fresh_seed()
        print(f"trepid sim: seed {drawn}, drawn now; --seed {drawn} repeats it", file=sys.stderr, flush=True)
        return drawn
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"--seed {text}: expected a whole number from 0 on, or {RANDOM!r}")
    return int(text)


def check_outputs(planned: Plan, *files: Path | None) -> None:
    """Raise InputError unless there is one run to save in ``files``."""
    for file in filter(None, files):
        if len(planned) > 1:
            raise InputError(f"{file}: can hold one run, not {len(planned)}")


def check_folders(*files: Path | None) -> None:
    """Raise InputError unless there is a folder for each file."""
    for file in filter(None, files):
        if not file.parent.is_dir():
            raise InputError(f"{file}: there is no folder {file.parent}")
