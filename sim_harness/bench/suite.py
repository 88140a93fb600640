"""The suite of scenarios, each once, as ``trepid sim run all`` runs them."""

import json
import statistics
import subprocess
import sys
from typing import Any

from trepid.config import ROOT, InputError

JOBS = 2
Row = dict[str, Any]


def bench_suite(seed: int) -> dict[str, Any]:
    """Run all scenarios; return totals, and the same figures for each tag."""
    command = [
        sys.executable,
        "-m",
        "trepid",
        "sim",
        "run",
        "all",
        "--seed",
        str(seed),
        "--jobs",
        str(JOBS),
        "--json",
    ]
    ended = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if ended.returncode not in (0, 1):
        raise InputError(f"trepid sim run all ended with exit code {ended.returncode}")
    rows = [json.loads(line) for line in ended.stdout.splitlines()]
    listed = subprocess.run(
        [sys.executable, "-m", "trepid", "sim", "list", "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    tags = {row["name"]: row["tags"] for row in map(json.loads, listed.stdout.splitlines())}
    known = sorted({tag for of_one in tags.values() for tag in of_one})
    by_tag = {tag: figures([row for row in rows if tag in tags[row["scenario"]]]) for tag in known}
    return {
        "scenarios": {"all": figures(rows), **by_tag},
        "failed": [r["scenario"] for r in rows if r["status"] != "passed"],
    }


def figures(rows: list[Row]) -> Row:
    """Counts over runs, and the median and the largest of their tracking errors and jerks."""
    errors_m = [row["max_lateral_error_m"] for row in rows if row["max_lateral_error_m"] is not None]
    return {
        "runs": len(rows),
        "passed": sum(row["status"] == "passed" for row in rows),
        "departures": sum(row["departures"] or 0 for row in rows),
        "interventions": sum(row["interventions"] or 0 for row in rows),
        "collisions": sum(row["collisions"] or 0 for row in rows),
        "distance [km]": round(sum(row["distance_m"] or 0.0 for row in rows) / 1000, 2),
        "max. error, median [m]": round(statistics.median(errors_m), 3) if errors_m else None,
    }
