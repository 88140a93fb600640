"""Two recordings, traces, files of stored runs, or folders of them, side by side: ``trepid.compare``."""

from pathlib import Path
from typing import Any

from cockpit.compare.drives import Course, compare_drives, course, side_by_side
from cockpit.compare.runs import compare_runs
from cockpit.logbook.explain_drive import is_recording
from sim_harness.judging.trace_difference import compare_traces
from trepid.config import InputError

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
