"""The ``compare`` verb."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from trepid.config import InputError


def compare(
    one: Annotated[Path, typer.Argument(metavar="A", help="Recording (.mcap) or stored runs (.jsonl).")],
    other: Annotated[Path, typer.Argument(metavar="B", help="Another file of the same kind.")],
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw fear, speed and lateral offset of two recordings, e.g. both.png."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the comparison as JSON.")] = False,
) -> int:
    """Compare two recordings, or two files of stored runs, side by side.

    The exit code is 0 when both were compared, also where they differ.
    """
    from cockpit.compare.drives import compare_drives, courses
    from cockpit.compare.runs import compare_runs
    from cockpit.figure_style import save
    from cockpit.logbook.explain_drive import is_recording

    for path in (one, other):
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    kinds = {is_recording(one), is_recording(other)}
    if len(kinds) == 2:
        raise InputError(
            f"{one} and {other}: a recording and stored runs cannot be compared; give two of a kind"
        )
    if True in kinds:
        found, drives = compare_drives(one, other)
        if picture is not None:
            save(courses(drives, (f"A {one.name}", f"B {other.name}")), picture)
    elif picture is not None:
        raise InputError(f"--picture {picture}: only two recordings are drawn")
    else:
        found = compare_runs(one, other)
    found = {"a": str(one), "b": str(other), **found}
    typer.echo(json.dumps(found) if as_json else "\n".join(_text(found)))
    return 0


def _text(found: dict[str, Any]) -> Iterator[str]:
    yield f"A {found['a']}\nB {found['b']}"
    if found["kind"] == "runs":
        yield from _runs(found)
        return
    yield f"{'':32}{'A':>12}{'B':>12}{'B - A':>12}"
    for row in found["figures"]:
        yield f"{row['name']:32}" + "".join(f"{_value(row[name]):>12}" for name in ("a", "b", "change"))
    first = found["first_difference"]
    if first is None:
        yield "No decision differs in mode, cause, fear or speed cap."
    else:
        changes = ", ".join(f"{name} {_value(a)} -> {_value(b)}" for name, (a, b) in first["fields"].items())
        yield f"First difference at {first['t_s']:.2f} s: {changes}"


def _runs(found: dict[str, Any]) -> Iterator[str]:
    for run in found["changed"]:
        yield f"{run['scenario']} seed {run['seed']}:"
        for name, (a, b) in run["changed"].items():
            yield f"  {name}: {_value(a)} -> {_value(b)}"
    for file in ("a", "b"):
        for name in found[f"only_{file}"]:
            yield f"only in {file.upper()}: {name}"
    yield f"{found['compared']} runs compared, {len(found['changed'])} differ"


def _value(value: Any) -> str:
    if value is None:
        return "unknown"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
