"""Two recordings, traces, files of stored runs, or folders of them, side by side: ``trepid.compare``."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

from cockpit.logbook.explain_drive import is_recording
from sim_harness.compare.drives import Course, compare_drives, course, side_by_side
from sim_harness.compare.traces import compare_traces
from trepid.config import InputError, read_text

MACHINE = ("realtime_factor",)  # depends on the machine, not on the drive
Run = dict[str, Any]
Key = tuple[str, int, int]


def read_runs(path: Path) -> dict[Key, Run]:
    """Runs by scenario, seed and occurrence. Raises InputError with the line that is no run."""
    found: dict[Key, Run] = {}
    seen: Counter[tuple[str, int]] = Counter()
    for number, line in enumerate(read_text(path).split("\n"), 1):
        if not line.strip():
            continue
        try:
            run = json.loads(line)
            name, seed = str(run["scenario"]), int(run["seed"])
            str(run["status"])
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise InputError(f"{path}:{number}: not a run; give lines of 'trepid sim run --json'") from error
        found[name, seed, seen[name, seed]] = run
        seen[name, seed] += 1
    if not found:
        raise InputError(f"{path}: no runs; give lines of 'trepid sim run --json'")
    return found


def compare_runs(one: Path, other: Path) -> dict[str, Any]:
    """The runs of both files: those whose status or figures changed, and those of one file only, for JSON."""
    first, second = read_runs(one), read_runs(other)
    changed = []
    for key in (key for key in first if key in second):
        a, b = first[key], second[key]
        names = [name for name in dict.fromkeys((*a, *b)) if name not in MACHINE]
        figures = {name: [a.get(name), b.get(name)] for name in names if a.get(name) != b.get(name)}
        if figures:
            changed.append({"scenario": key[0], "seed": key[1], "changed": figures})
    hashes = [
        (first[key].get("trace_sha256"), second[key].get("trace_sha256")) for key in first if key in second
    ]
    return {
        "kind": "runs",
        "equal_traces": sum(a is not None and a == b for a, b in hashes),
        "compared": len(first.keys() & second.keys()),
        "changed": changed,
        "only_a": [f"{key[0]} seed {key[1]}" for key in first if key not in second],
        "only_b": [f"{key[0]} seed {key[1]}" for key in second if key not in first],
    }


RUNS = "runs.jsonl"  # in the folder of `trepid sim run --out`
SUFFIXES = (".mcap", ".npz")  # of the files that a folder is compared by
WORDS = {"recordings": "recordings", "traces": "traces", "runs": "stored runs", "folders": "folders"}


def compare(one: str | Path, other: str | Path) -> dict[str, Any]:
    """What differs between two paths of a kind, as ``trepid compare --json`` prints it.

    ``a`` and ``b`` are the paths, ``kind`` is ``recordings``, ``traces``, ``runs`` or ``folders``. Recordings and
    traces have ``equal``, ``first_difference`` (``t_s`` from the start [s], and the fields with both values; None
    without one) and ``figures`` (rows with ``name``, ``a``, ``b``, ``change``). Stored runs have the runs that
    ``changed``, those ``only_a`` and ``only_b``, and the numbers ``compared`` and ``equal_traces``. Folders have
    ``pairs`` of files of the same name, ``only_a`` and ``only_b``. Raises InputError.
    """
    paths = Path(one), Path(other)
    found, _ = compare_paths(*paths, common_kind(*paths))
    return found


def common_kind(one: Path, other: Path) -> str:
    """The kind of both paths. Raises InputError where they differ in kind."""
    kinds = [kind_of(path) for path in (one, other)]
    if kinds[0] != kinds[1]:
        what = " and ".join(WORDS[kind] for kind in kinds)
        raise InputError(f"{one} and {other}: {what} cannot be compared; give two of a kind")
    return kinds[0]


def kind_of(path: Path) -> str:
    """The kind of a file or folder: a key of WORDS. Raises InputError."""
    if path.is_dir():
        if (path / RUNS).is_file():
            return "runs"
        if any(file.suffix in SUFFIXES for file in path.iterdir()):
            return "folders"
        raise InputError(f"{path}: holds neither {RUNS} nor files {' or '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.suffix == ".npz":
        return "traces"
    return "recordings" if is_recording(path) else "runs"


def compare_paths(one: Path, other: Path, kind: str) -> tuple[dict[str, Any], tuple[Course, Course] | None]:
    """The comparison of two paths of a kind, for JSON, and what is drawn of them. Raises InputError."""
    names = {"a": str(one), "b": str(other)}
    if kind == "recordings":
        found, (a, b) = compare_drives(one, other)
        return {**names, **found}, (course(a), course(b))
    if kind == "traces":
        found, traces = compare_traces(one, other)
        found["figures"] = side_by_side(*found.pop("scores"))
        columns = ("decision.fear", "speed_mps", "lateral_offset_m")
        drawn = [(t["t_s"] - t["t_s"][0], *(t[name] for name in columns)) for t in traces]
        return {**names, **found}, (drawn[0], drawn[1])
    if kind == "folders":
        return {**names, **_folders(one, other)}, None
    files = [path / RUNS if path.is_dir() else path for path in (one, other)]
    return {**names, **compare_runs(*files)}, None


def _folders(one: Path, other: Path) -> dict[str, Any]:
    """Every pair of files of the same name."""
    first, second = (
        {file.name for file in folder.iterdir() if file.suffix in SUFFIXES} for folder in (one, other)
    )
    pairs = []
    for name in sorted(first & second):
        found, _ = compare_paths(one / name, other / name, kind_of(one / name))
        pairs.append({**found, "name": name})
    return {
        "kind": "folders",
        "pairs": pairs,
        "only_a": sorted(first - second),
        "only_b": sorted(second - first),
    }
