"""One lap of the circuit live: every process over Zenoh, as ``trepid drive`` starts them."""

import json
import subprocess
import sys
from typing import Any

from trepid.config import ROOT, InputError

FIGURES = (
    "distance_m",
    "duration_s",
    "departures",
    "interventions",
    "max_lateral_error_m",
    "rms_lateral_error_m",
    "mean_speed_mps",
    "max_fear",
    "mean_fear",
)


def bench_drive() -> dict[str, Any]:
    """Drive the circuit; return scores of the run, latencies [ms], and rate and load of each process."""
    command = [sys.executable, "-m", "trepid", "drive", "--no-dashboard", "--json"]
    ended = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if ended.returncode not in (0, 1):
        raise InputError(f"trepid drive ended with exit code {ended.returncode}")
    row = json.loads(ended.stdout)
    processes = {
        name: {column: process[column] for column in ("rate_hz", "cpu_percent", "restarts")}
        for name, process in row["processes"].items()
    }
    return {
        **{name: row[name] for name in FIGURES},
        "latency [ms]": row["latency_ms"],
        "processes": processes,
    }
