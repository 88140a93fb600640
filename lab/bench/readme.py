"""The table of measured figures in the README, filled from the stored results of benchmarks."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Measured = Mapping[str, Any]
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"


def _lap(m: Measured) -> str:
    return (
        f"{m['departures']} departures, {m['interventions']} interventions, {m['mean_speed_mps']:.1f} m/s mean,"
        f" at most {m['max_lateral_error_m']:.2f} m off (rms {m['rms_lateral_error_m']:.2f} m)"
    )


def _latency(m: Measured) -> str:
    latency = m["latency [ms]"]["frame_to_command"]
    return f"{latency['p50']:.0f} ms median, {latency['p99']:.0f} ms p99"


def _pipeline(m: Measured) -> str:
    times = m["from the published frame [ms]"]
    ways = (times["a process each"], times["one process"])
    return "; ".join(
        f"{way['frame_to_command p50']:.1f} ms median, {way['frame_to_command p99']:.1f} ms p99"
        for way in ways
    )


def _newcomer(m: Measured) -> str:
    return (
        f"{m['time [s]']['driving']:.0f} s, of which {m['time [s]']['environment ready']:.0f} s to install;"
        f" {m['disk [MB]']['clone and environment']:.0f} MB on disk"
    )


def _suite(m: Measured) -> str:
    every = m["scenarios"]["all"]
    return (
        f"{every['passed']} of {every['runs']} pass, {every['departures']} departures,"
        f" {every['collisions']} collisions in {every['distance [km]']:.1f} km"
    )


def _hard_drives(m: Measured) -> str:
    return f"departures: {m['supervised: departures']}; nuisances: {m['nuisance slow-downs on clean roads']}"


def _beyond_sight(m: Measured) -> str:
    rows = m["vehicles beyond the sight"].values()
    return (
        f"{sum(row['collisions'] for row in rows)} collisions in {sum(row['cases'] for row in rows)} drives,"
        f" at most {max(row['greatest_decel_mps2'] for row in rows):.1f} m/s² of braking"
    )


def _lockstep(m: Measured) -> str:
    rendered, true = m["rendering_and_both_estimators"], m["true_sight"]
    return f"{rendered['realtime_factor']:.1f} and {true['realtime_factor']:.0f} times real time"


def _estimators(m: Measured) -> str:
    rows = ", ".join(
        f"{m[name]['median_ms']:.2f}" for name in ("cv", "cnn", "image_statistics", "bare_canny_chain")
    )
    return f"{rows} ms median"


def _inference(m: Measured) -> str:
    ours = m["8 inputs, 5 sets, 40 rules"]
    return f"{ours['median_us']:.0f} µs median, {ours['ratio']} times as fast"


ROWS: tuple[tuple[str, str, Callable[[Measured], str]], ...] = (
    ("drive", "one lap live, seven processes over Zenoh, 1141 m, bends to R = 15 m", _lap),
    ("drive", "published frame to command, in that lap", _latency),
    ("pipeline", "published frame to command at 30 Hz: a process each; one process", _pipeline),
    ("newcomer", "from the clone to a car that drives; clone and environment", _newcomer),
    ("suite", "all scenarios in lock-step, each once", _suite),
    ("fear-supervision", "hard drives under supervision; slow-downs on clean roads", _hard_drives),
    (
        "within-sight",
        "standing and slow vehicles in fog, rain, by night, beyond crests and walls, at 5 to 25 m/s",
        _beyond_sight,
    ),
    (
        "lockstep",
        "the lap in lock-step on one core: rendered with both estimators; with the true lane",
        _lockstep,
    ),
    ("fear-inference", "inference of 8 inputs and 40 rules; relative to scikit-fuzzy", _inference),
    ("estimators", "320×240 frame: CV, CNN, image statistics, a plain Canny and Hough chain", _estimators),
)
"""Benchmark, meaning of its figure, and function that reads the figure from its result."""


def table(results: Mapping[str, Measured]) -> str:
    """The table in Markdown, a row for every entry of ROWS whose benchmark has a stored result."""
    lines = ["| what | measured | command |", "|---|---|---|"]
    lines += [
        f"| {what} | {read(results[name])} | [`trepid bench {name}`](lab/results/README.md#{name}) |"
        for name, what, read in ROWS
        if name in results
    ]
    return "\n".join(lines)


def write_table(readme: Path, results: Mapping[str, Measured]) -> None:
    """Replace the text between the markers in ``readme``. Raises ValueError where they are missing."""
    text = readme.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    readme.write_text(f"{before}{BEGIN}\n{table(results)}\n{END}{after}", encoding="utf-8")
