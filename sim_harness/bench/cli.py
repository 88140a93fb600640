"""The ``bench`` verb."""

import json
import secrets
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from sim_harness.bench.catalogue import BENCHMARKS, GROUPS, PERCEPTION, named
from sim_harness.bench.perception.options import PerceptionOptions
from sim_harness.bench.perception.report import brief
from sim_harness.bench.results import Result, save
from sim_harness.bench.text import tables
from sim_harness.bench.timing import machine
from trepid.config import InputError

PERCEPTION_ONLY = "--estimators, --quick, --repeats, --jobs, --keep-frames, --parts, --data, --out"


def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...", help="Benchmarks, or control, fear, follow for a group; --list prints them."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of all random numbers; default: a fresh one, which is printed.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    list_only: Annotated[bool, typer.Option("--list", help="Print the benchmarks and stop.")] = False,
    save_in: Annotated[
        Path | None,
        typer.Option(
            "--save", metavar="DIR", help="Write NAME.json, NAME.md and NAME.png; docs/results is one."
        ),
    ] = None,
    estimators: Annotated[
        str, typer.Option(help="perception: names, separated by commas; default: all.")
    ] = "",
    quick: Annotated[bool, typer.Option(help="perception: a seventh of the clips.")] = False,
    repeats: Annotated[int, typer.Option(min=1, help="perception: number of passes over the clips.")] = 1,
    jobs: Annotated[int, typer.Option(min=1, help="perception: number of processes.")] = 1,
    keep_frames: Annotated[
        bool,
        typer.Option(help="perception: keep the rendered frames (0.7 GB) for the next run with this seed."),
    ] = False,
    parts: Annotated[
        str, typer.Option(help="perception: set, real, drive, separated by commas.")
    ] = "set,real",
    data: Annotated[
        Path | None,
        typer.Option(help="perception: the real sets; default: TREPID_DATA, else ../shared/data."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="perception: folder for tables and figures.")] = None,
) -> int:
    """Measure time and accuracy of the parts, relative to a peer in the same run."""
    if list_only:
        for name, benchmark in BENCHMARKS.items():
            print(f"{name:22} {benchmark.summary}")
        return 0
    for name in names or []:
        if name not in BENCHMARKS and name not in GROUPS:
            raise InputError(f"no benchmark {name!r}; there are {', '.join((*BENCHMARKS, *GROUPS))}")
    wanted = [member for name in names or [] for member in named(name)]
    wanted = wanted or [name for name, benchmark in BENCHMARKS.items() if benchmark.by_default]
    if save_in is not None and not save_in.is_dir():
        raise InputError(f"{save_in}: there is no such folder")
    seed = secrets.randbits(32) if seed is None else seed
    options = PerceptionOptions(
        seed=seed,
        estimators=_listed(estimators),
        quick=quick,
        repeats=repeats,
        jobs=jobs,
        keep_frames=keep_frames,
        out=out,
        data=data,
        parts=_listed(parts),
    )
    if PERCEPTION not in wanted and options != PerceptionOptions(seed=seed):
        raise InputError(f"{PERCEPTION_ONLY} are options of the benchmark perception")
    report: dict[str, Any] = machine() | {"seed": seed}
    for name in wanted:
        typer.echo(f"bench {name} ...", err=True)
        benchmark = BENCHMARKS[name]
        measured = benchmark.measure(options) if name == PERCEPTION else benchmark.measure(seed)
        report[name] = measured if as_json or name != PERCEPTION else brief(measured)
        if save_in is not None:
            given = ["--seed", str(seed)] if benchmark.seeded else []
            save(Result.of(name, measured, arguments=given), save_in)
    if as_json:
        print(json.dumps(report))
        return 0
    console = Console()
    for table in tables(report):
        console.print(table, "")
    return 0


def _listed(text: str) -> tuple[str, ...]:
    """The names in a list separated by commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip())
