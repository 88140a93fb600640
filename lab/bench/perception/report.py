"""Results of the benchmark as files: tables in Markdown and CSV, figures, and all of it in JSON."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.bench.perception.clips import GAP
from lab.bench.perception.scores import TOLERANCE_RAD, Results, given_frames, score_clips
from lab.bench.text import Row, columns_of, is_nested, markdown_table, value_text
from sim_harness.world.roads.disturbances import DisturbanceKind
from trepid.config import InputError

Table = Mapping[str, Row]
"""Row -> column -> value."""
Parts = Mapping[str, Mapping[str, Row]]
"""Estimator -> group of clips -> figure -> value."""
COLUMNS = {
    "all_detected_pct": "detected",
    "clear_detected_pct": "clear",
    "marked_detected_pct": "marked",
    "unmarked_detected_pct": "unmarked",
    "rain_detected_pct": "rain",
    "snow_detected_pct": "snow",
    "night_detected_pct": "night",
    "tree_shadows_detected_pct": "tree shadows",
    "glare_detected_pct": "glare",
    "correctness_pct": "correct when given",
    "clean_offset_m_rmse": "offset m",
    "clean_heading_deg_rmse": "heading °",
    "clean_angle_deg_rmse": "wheel °",
    "gap_drift_m_median": "gap drift m",
    "ece": "ECE",
    "auroc": "AUROC",
    "ms_median": "ms",
    "times_bare_chain": "× bare chain",
}
"""Columns of the ranking in Markdown; CSV has all."""
OWN = ("cv", "cnn")
DPI, FINE_DPI = 100, 78  # of a picture, and of one full of numbers: below 200 kB
MOST_LINES = 6
BINS = 10


def write(folder: Path, found: Mapping[str, Any], parts: Table) -> None:
    """The tables as .md and .csv, all of it as bench.json. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "bench.json").write_text(
            json.dumps({**found, "figures by condition": parts}, indent=1), encoding="utf-8"
        )
        for name, table in found.items():
            if is_nested(table):
                _write_table(folder / _file_name(name), table, COLUMNS if name == "ranking" else {})
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error


def _write_table(path: Path, table: Table, titles: Mapping[str, str]) -> None:
    """PATH.csv with all columns, PATH.md with the columns ``titles`` (name -> heading), or with all of them."""
    columns = columns_of(table)
    with path.with_suffix(".csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["", *columns])
        writer.writerows([name, *map(row.get, columns)] for name, row in table.items())
    titles = titles or dict(zip(columns, columns, strict=True))
    rows = [[name, *(value_text(row.get(column)) for column in titles)] for name, row in table.items()]
    path.with_suffix(".md").write_text(markdown_table(["", *titles.values()], rows) + "\n", encoding="utf-8")


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).strip("_").replace("__", "_")


def draw(folder: Path, results: Results, parts: Parts, ranking: Table) -> None:
    """``detected.png``, ``grades.png``, ``cost.png`` and ``confidence.png``."""
    order = list(ranking)
    _write_detections(folder / "detected.png", parts, order)
    _grades(folder / "grades.png", parts, order)
    _cost(folder / "cost.png", ranking)
    _confidence(folder / "confidence.png", results, order)


def _write_detections(path: Path, parts: Parts, order: Sequence[str]) -> None:
    """Every estimator by every condition: percent of the frames in which it gives the right lane."""
    clear = [part for part in parts[order[0]] if part.startswith("clear, ")]
    groups = [*clear, *_kinds(parts, order)]
    share = np.array([[parts[name][group]["detected_pct"] for group in groups] for name in order], float)
    figure = Figure(figsize=(0.34 * len(groups) + 2.6, 0.21 * len(order) + 2.0), layout="constrained")
    axes = figure.subplots()
    picture = axes.imshow(share, cmap="RdYlGn", vmin=0, vmax=100, aspect="auto")
    titles = [group.replace("_", " ") for group in groups]
    axes.set_xticks(range(len(groups)), titles, rotation=60, ha="right")
    axes.set_yticks(range(len(order)), order)
    axes.tick_params(labelsize=7, length=0)
    for row, column in np.ndindex(share.shape):
        axes.text(column, row, f"{share[row, column]:.0f}", ha="center", va="center", fontsize=5)
    axes.set_title("right lane, % of frames; disturbances at grades 1 to 3", fontsize=9)
    figure.colorbar(picture, fraction=0.02, pad=0.01).ax.tick_params(labelsize=6)
    figure.savefig(path, dpi=FINE_DPI)


def _grades(path: Path, parts: Parts, order: Sequence[str]) -> None:
    """The best estimators by the grade of every disturbance."""
    figure = Figure(figsize=(12, 5.4), layout="constrained")
    panels = figure.subplots(3, 6, sharex=True, sharey=True).flat
    for kind, axes in zip(_kinds(parts, order), panels, strict=False):
        for name in _best(order):
            rates = {0: parts[name]["clear"]["detected_pct"]}
            rates |= {
                grade: parts[name][f"{kind} {grade}"]["detected_pct"]
                for grade in range(1, 6)
                if f"{kind} {grade}" in parts[name]
            }
            axes.plot(list(rates), list(rates.values()), marker=".", linewidth=1, label=name)
        axes.set_title(kind.replace("_", " "), fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=6, loc="lower left")
    figure.supxlabel("grade, 0: clear", fontsize=8)
    figure.supylabel("right lane, % of frames", fontsize=8)
    figure.savefig(path, dpi=FINE_DPI)


def _cost(path: Path, ranking: Table) -> None:
    """Time per frame and rate of right lanes."""
    figure = Figure(figsize=(7, 4.4), layout="constrained")
    axes = figure.subplots()
    for name, row in ranking.items():
        place = row["ms_median"], row["all_detected_pct"]
        axes.scatter(*place, s=18, color="tab:red" if name in OWN else "tab:blue")
        axes.annotate(name, place, fontsize=6, xytext=(3, 2), textcoords="offset points")
    axes.set_xscale("log")
    _label(axes, "ms of processor time per 320 × 240 frame, median", "right lane, % of all frames")
    figure.savefig(path, dpi=DPI)


def _confidence(path: Path, results: Results, order: Sequence[str]) -> None:
    """Confidence in ten equally full bins against the share of wheel angles within two degrees."""
    cases = [case for case in results if case.condition != GAP]
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    for name in _best(order):
        looks = score_clips(results, name, cases)
        looks = looks[given_frames(looks)]
        parts = np.array_split(np.argsort(looks["confidence"], kind="stable"), BINS)
        good = np.abs(looks["angle_rad"]) <= TOLERANCE_RAD
        means = [(looks["confidence"][part].mean(), good[part].mean()) for part in parts if len(part)]
        axes.plot(*zip(*means, strict=True), marker=".", linewidth=1, label=name)
    axes.legend(fontsize=7)
    _label(axes, "confidence", "share of wheel angles within 2°")
    figure.savefig(path, dpi=DPI)


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3, which="both")


def _kinds(parts: Parts, order: Sequence[str]) -> list[str]:
    return [kind.value for kind in DisturbanceKind if kind.value in parts[order[0]]]


def _best(order: Sequence[str]) -> list[str]:
    """The default estimators at any rank, then the first ones of the ranking."""
    chosen = [name for name in order if name in OWN]
    return [*chosen, *(name for name in order if name not in chosen)][:MOST_LINES]
