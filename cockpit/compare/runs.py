"""Two files of stored runs (JSON lines of ``trepid sim run --json``) side by side, by scenario and seed."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

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
