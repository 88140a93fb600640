"""The ``compare`` verb."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from trepid.config import InputError


def compare(
    one: Annotated[
        Path,
        typer.Argument(
            metavar="A", help="Recording (.mcap), trace (.npz), stored runs (.jsonl), or a folder of them."
        ),
    ],
    other: Annotated[Path, typer.Argument(metavar="B", help="Another one of the same kind.")],
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw fear, speed and lateral offset of two recordings or traces, e.g. both.png."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="F.html", help="Write a page with figures, units and meanings.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the comparison as JSON.")] = False,
) -> int:
    """Compare two recordings, traces, files of stored runs, or folders of them, side by side.

    Two traces are equal where their trace_sha256 are. The exit code is 0 when both were compared, also where they
    differ.
    """
    from sim_harness.compare.api import common_kind, compare_paths
    from sim_harness.compare.drives import courses
    from trepid.images.figure_style import save

    kind = common_kind(one, other)
    if report is not None and report.exists():
        raise InputError(f"{report}: exists already and is kept; give another name")
    if picture is not None and kind not in ("recordings", "traces"):
        raise InputError(f"--picture {picture}: only two recordings or two traces are drawn")
    found, drawn = compare_paths(one, other, kind)
    names = (f"A {one.name}", f"B {other.name}")
    if picture is not None and drawn is not None:
        save(courses(drawn, names), picture)
    if report is not None:
        from sim_harness.compare.page import write_page

        figure = None if drawn is None else courses(drawn, names)
        write_page(report, found, list(_summary(found)), _meanings(kind), figure)
    typer.echo(json.dumps(found) if as_json else "\n".join(_text(found)))
    return 0


def _meanings(kind: str) -> Mapping[str, str]:
    if kind == "recordings":
        from sim_harness.compare.drives import MEANINGS

        return MEANINGS
    from sim_harness.judging.metrics import MEANINGS as OF_RUNS

    return OF_RUNS


def _text(found: dict[str, Any]) -> Iterator[str]:
    from sim_harness.compare.page import value_text

    yield f"A {found['a']}\nB {found['b']}"
    if "figures" in found:
        yield f"{'':32}{'A':>12}{'B':>12}{'B - A':>12}"
    for row in found.get("figures", ()):
        yield f"{row['name']:32}" + "".join(f"{value_text(row[name]):>12}" for name in ("a", "b", "change"))
    for run in found.get("changed", ()):
        yield f"{run['scenario']} seed {run['seed']}:"
        for name, (a, b) in run["changed"].items():
            yield f"  {name}: {value_text(a)} -> {value_text(b)}"
    yield from _summary(found)


def _summary(found: dict[str, Any]) -> Iterator[str]:
    """The lines beside the tables."""
    kind = found["kind"]
    if kind == "runs":
        for file in ("a", "b"):
            for name in found[f"only_{file}"]:
                yield f"only in {file.upper()}: {name}"
        changed, equal = len(found["changed"]), found["equal_traces"]
        yield f"{found['compared']} runs compared, {changed} differ, {equal} have equal traces (trace_sha256)"
    elif kind == "folders":
        for pair in found["pairs"]:
            yield f"{pair['name']}: {_difference(pair)}"
        for file in ("a", "b"):
            for name in found[f"only_{file}"]:
                yield f"only in {file.upper()}: {name}"
        # files of different lengths differ, also where all that is common is equal
        differ = sum(not pair["equal"] for pair in found["pairs"])
        yield f"{len(found['pairs'])} pairs compared, {differ} differ"
    else:
        yield _difference(found)


def _difference(found: dict[str, Any]) -> str:
    """The first difference of two recordings or traces in a line."""
    from sim_harness.compare.page import value_text

    first = found["first_difference"]
    if first is not None:
        changes = ", ".join(
            f"{name} {value_text(a)} -> {value_text(b)}" for name, (a, b) in first["fields"].items()
        )
        return f"First difference at {first['t_s']:.2f} s: {changes}"
    if found["kind"] == "recordings":
        return _common(found)
    if found["equal"]:
        return f"The traces are equal: trace_sha256 {found['trace_sha256'][0]}"
    a, b = found["samples"]
    return f"No common sample differs; {a} and {b} samples, or other columns"


def _common(found: dict[str, Any]) -> str:
    """What two recordings without a difference have in common, in a line."""
    if found["equal"]:
        return "No decision differs in mode, cause, fear or speed cap."
    a, b = (f"from {first_s:.2f} to {last_s:.2f} s" for first_s, last_s in found["spans_s"])
    ends = f"A has decisions {a}, B {b}"
    if found["common_s"] is None:
        return f"Nothing was compared, because there is no common time: {ends}"
    first_s, last_s = found["common_s"]
    return f"No decision of the common {last_s - first_s:.2f} s differs in mode, cause, fear or speed cap; {ends}"
