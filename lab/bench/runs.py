"""Benchmarks of the whole car as a user starts it: one lap live, and the suite of scenarios in lock-step."""

import json
import statistics
import subprocess
import sys
from typing import Any

from trepid.config import CONFIG_DIR, ROOT, InputError

TRACKED = ("mini", "rc-car")  # ready cars with tracks of their own

SCORES = (
    *("distance_m", "duration_s", "departures", "interventions", "max_lateral_error_m"),
    *("rms_lateral_error_m", "mean_speed_mps", "max_fear", "mean_fear"),
)
Row = dict[str, Any]


def bench_drive() -> Row:
    """Drive the circuit; return scores of the run, latencies [ms], and rate and load of each process."""
    (row,) = trepid("drive", "--no-dashboard")
    processes = {
        name: {column: process[column] for column in ("rate_hz", "cpu_percent", "restarts")}
        for name, process in row["processes"].items()
    }
    return {
        **{name: row[name] for name in SCORES},
        "latency [ms]": row["latency_ms"],
        "processes": processes,
    }


def bench_suite(seed: int, *, jobs: int = 2) -> Row:
    """Run all scenarios and the tracks of the small cars; return totals, and the same figures by tag and by car."""
    options = ("--seed", str(seed), "--jobs", str(jobs))
    rows = trepid("sim", "run", "all", *options)
    tags = {row["name"]: row["tags"] for row in trepid("sim", "list")}
    known = sorted({tag for of_one in tags.values() for tag in of_one})
    by_tag = {tag: figures([row for row in rows if tag in tags[row["scenario"]]]) for tag in known}
    of_cars = {car: run_tracks(car, *options) for car in TRACKED}
    every = [*rows, *(row for tracks in of_cars.values() for row in tracks)]
    return {
        "scenarios": {"all": figures(rows), **by_tag},
        "tracks": {car: figures(tracks) for car, tracks in of_cars.items()},
        "failed": [row["scenario"] for row in every if row["status"] != "passed"],
    }


def run_tracks(car: str, *options: str) -> list[Row]:
    """Run the scenarios in the folder of a ready car."""
    folder = CONFIG_DIR / "cars" / car
    names = sorted(path.stem for path in (folder / "scenarios").glob("*.yaml"))
    return trepid("sim", "run", *names, "--car", str(folder), *options)


def figures(rows: list[Row]) -> Row:
    """Counts over runs, and the median of their tracking errors."""
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


def trepid(*words: str) -> list[Row]:
    """The lines of JSON that a verb prints. Raises InputError when it does not run to its end."""
    command = [sys.executable, "-m", "trepid", *words, "--json"]
    ended = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if ended.returncode not in (0, 1):
        raise InputError(f"trepid {' '.join(words)} ended with exit code {ended.returncode}")
    return [json.loads(line) for line in ended.stdout.splitlines()]
