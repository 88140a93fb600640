"""The ``bench`` verb."""

import inspect
import json
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from lab.bench.age import ages
from lab.bench.catalogue import BENCHMARKS, BY_DEFAULT, GROUPS, function, names_of
from lab.bench.results import Result, check_folder, machine, save, stored_results
from lab.bench.text import brief, tables
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.scenario import list_scenarios
from trepid.config import ROOT, InputError
from trepid.loudness import note
from trepid.spelling import did_you_mean_or_list

CONTINUED_SEED = 1


def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="Benchmarks, or control, fear, follow, study for a group; --list prints them.",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Seed of all random numbers; default: a random one, which is printed; 1 for benchmarks that"
            " continue an interrupted run (imitation, live, most studies)."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    list_only: Annotated[bool, typer.Option("--list", help="Print the benchmarks and stop.")] = False,
    stored: Annotated[
        bool,
        typer.Option(
            help="Print the stored results: date, commit, and whether they are older than the code; then stop."
        ),
    ] = False,
    save_in: Annotated[
        Path | None,
        typer.Option(
            "--save", metavar="DIR", help="Write NAME.json, NAME.png and README.md; lab/results is one."
        ),
    ] = None,
    estimators: Annotated[
        str,
        typer.Option(
            help="perception: names, separated by commas; default: all. real: beside cv and cnn; also: all."
            " tracks, tiles, floors: instead of tape. memory: also, or files of driving networks."
        ),
    ] = "",
    quick: Annotated[
        bool,
        typer.Option(
            help="perception, real, imitation, fear-severity, sight, people, tracks, tiles, hills, junctions,"
            " study-rules, study-trunks: a part of it; fear-supervision: the supervised car alone;"
            " study-conditions: one seed."
        ),
    ] = False,
    repeats: Annotated[
        int | None, typer.Option(min=1, help="perception: number of passes over the clips; default: 1.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="perception, imitation, fear-severity, sight, within-sight, people, tracks, tiles, hills, "
            "junctions, resimulation, "
            "measured-faults, study-samplers, study-areas, study-shrinking, study-conditions, study-rules, "
            "suite: processes; faults: drives; default: 1, suite 2.",
        ),
    ] = None,
    keep_frames: Annotated[
        bool,
        typer.Option(help="perception: keep the rendered frames (0.7 GB) for the next run with this seed."),
    ] = False,
    parts: Annotated[
        str, typer.Option(help="perception: set, drive, separated by commas; default: set.")
    ] = "",
    data: Annotated[
        Path | None,
        typer.Option(
            help="Benchmarks on data sets: their folder; default: TREPID_DATA, else ../shared/data."
        ),
    ] = None,
    sets: Annotated[
        str, typer.Option(help="real, imitation: folders of sets, separated by commas; default: all.")
    ] = "",
    out: Annotated[
        Path | None, typer.Option(help="perception: folder for tables and figures; real: for pictures.")
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="faults, logbook, people: number of each, default 100; live: of scenarios, default 20; "
            "fear-severity: of roads, default 2; hills: of stops and of roads; junctions: of drives; "
            "study-rules: of seeds, default 5; "
            "within-sight: of rendered cases, default 300.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=20.0, help="soak: length of the drive [s]; default: 1800.")
    ] = None,
    wires: Annotated[str, typer.Option(help="faults: sim, can, separated by commas; default: both.")] = "",
    faults: Annotated[
        str,
        typer.Option(
            help="faults: names, separated by commas; fear-severity: of disturbances and faults; default: all."
        ),
    ] = "",
    against: Annotated[
        str,
        typer.Option(
            metavar="COMMIT",
            help="renderer, lockstep: computing time beside that of another commit, in turns; not stored.",
        ),
    ] = "",
) -> int:
    """Measure time and accuracy of the parts, relative to a peer in the same run."""
    if list_only:
        print("\n".join(f"{name:22} {benchmark.summary}" for name, benchmark in BENCHMARKS.items()))
        return 0
    if stored:
        print_stored(as_json=as_json)
        return 0
    wanted = benchmarks(names or BY_DEFAULT)
    if save_in is not None:
        if against:
            raise InputError("--against measures a difference and is not stored: leave out --save")
        check_folder(save_in)
    if seed is None:
        seed = CONTINUED_SEED if any(BENCHMARKS[name].continued for name in wanted) else secrets.randbits(32)
    options: dict[str, Any] = dict(
        estimators=_split_names(estimators),
        parts=_split_names(parts),
        data=data,
        out=out,
        sets=_split_names(sets),
        against=against,
    )
    options |= dict(quick=quick, repeats=repeats, jobs=jobs, keep_frames=keep_frames)
    options |= dict(count=count, duration=duration, wires=_split_names(wires), faults=_split_names(faults))
    taken = taken_options(wanted, {name: value for name, value in options.items() if value}, seed)
    check_configuration(list_scenarios())
    of_run = machine() | {"seed": seed}
    measured = {name: run(name, taken[name], save_in) for name in wanted}
    show(of_run, measured, as_json=as_json)
    return 0


def print_stored(*, as_json: bool) -> None:
    """Print date, commit and age of the stored results, as JSON Lines or as lines."""
    results = stored_results(ROOT / "lab" / "results")
    sentences = ages({name: one.commit for name, one in results.items()})
    for name, one in results.items():
        age = sentences.get(name, "")
        if as_json:
            print(json.dumps({"benchmark": name, "date": one.date, "commit": one.commit, "age": age}))
        else:
            print(f"{name:22} {one.date}  {one.commit:9} {age}".rstrip())


def benchmarks(names: Sequence[str]) -> list[str]:
    """The benchmarks of the names and of the groups among them; ``study NAME`` is ``study-NAME``.

    Raises InputError for an unknown name.
    """
    if names[0] == "study" and names[1:]:
        names = [f"study-{name}" for name in names[1:]]
    for name in names:
        if name not in BENCHMARKS and name not in GROUPS:
            hint = did_you_mean_or_list(name, (*BENCHMARKS, *GROUPS), "trepid bench --list")
            raise InputError(f"no benchmark {name!r}; {hint}")
    return [member for name in names for member in names_of(name)]


def run(name: str, options: dict[str, Any], folder: Path | None) -> Any:
    """The result of a benchmark, stored in ``folder`` if one is given."""
    note(f"bench {name} ...")
    measured = function(name)(**options)
    if folder is not None:
        save(Result.of(name, measured, options=options), folder)
    return measured


def show(of_run: dict[str, Any], measured: dict[str, Any], *, as_json: bool) -> None:
    """Print the machine and the results as JSON, or in short as tables."""
    if as_json:
        print(json.dumps(of_run | measured))
        return
    console = Console()
    for table in tables(of_run | {name: brief(found) for name, found in measured.items()}):
        console.print(table, "")


def taken_options(wanted: list[str], given: Mapping[str, Any], seed: int) -> dict[str, dict[str, Any]]:
    """For each benchmark the options that are parameters of it. Raises InputError for an option of none."""
    parameters = {name: inspect.signature(function(name)).parameters for name in wanted}
    for option in given:
        if not any(option in known for known in parameters.values()):
            raise InputError(f"--{option.replace('_', '-')} is no option of bench {', '.join(wanted)}")
    options = {"seed": seed, **given}
    return {
        name: {option: value for option, value in options.items() if option in known}
        for name, known in parameters.items()
    }


def _split_names(text: str) -> tuple[str, ...]:
    """The names in a list separated by commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip())
