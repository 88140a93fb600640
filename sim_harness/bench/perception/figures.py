"""Figures of the benchmark: rates by condition and by grade, rates and time, confidence and accuracy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.bench.perception.clips import GAP
from sim_harness.bench.perception.scores import TOLERANCE_RAD, Results, given, scored
from sim_harness.world.roads.disturbances import DisturbanceKind
from trepid.config import InputError

Parts = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Estimator -> group of clips -> figure -> value."""
DPI, FINE_DPI = 100, 78  # of a picture, and of one full of numbers: below 200 kB
MOST_LINES = 6
BINS = 10


def draw(folder: Path, results: Results, parts: Parts, ranking: Mapping[str, Mapping[str, Any]]) -> None:
    """``detected.png``, ``grades.png``, ``cost.png`` and ``confidence.png``. Raises InputError."""
    try:
        import matplotlib
    except ImportError as error:
        raise InputError("figures need matplotlib: pip install -e '.[bench]'") from error
    matplotlib.use("Agg")
    order = list(ranking)
    _detected(folder / "detected.png", parts, order)
    _grades(folder / "grades.png", parts, order)
    _cost(folder / "cost.png", ranking)
    _confidence(folder / "confidence.png", results, order)


def _detected(path: Path, parts: Parts, order: Sequence[str]) -> None:
    """Every estimator by every condition: percent of the frames in which it gives the right lane."""
    from matplotlib import pyplot

    clear = [part for part in parts[order[0]] if part.startswith("clear, ")]
    groups = [*clear, *(kind.value for kind in DisturbanceKind if kind.value in parts[order[0]])]
    share = np.array([[parts[name][group]["detected_pct"] for group in groups] for name in order], float)
    figure, axes = pyplot.subplots(figsize=(0.34 * len(groups) + 2.6, 0.21 * len(order) + 2.0))
    picture = axes.imshow(share, cmap="RdYlGn", vmin=0, vmax=100, aspect="auto")
    axes.set_xticks(
        range(len(groups)), [group.replace("_", " ") for group in groups], rotation=60, ha="right"
    )
    axes.set_yticks(range(len(order)), order)
    axes.tick_params(labelsize=7, length=0)
    for row, column in np.ndindex(share.shape):
        axes.text(column, row, f"{share[row, column]:.0f}", ha="center", va="center", fontsize=5)
    axes.set_title("right lane, % of frames; disturbances at grades 1 to 3", fontsize=9)
    figure.colorbar(picture, fraction=0.02, pad=0.01).ax.tick_params(labelsize=6)
    _save(figure, path, dpi=FINE_DPI)


def _grades(path: Path, parts: Parts, order: Sequence[str]) -> None:
    """The best estimators by the grade of every disturbance."""
    from matplotlib import pyplot

    kinds = [kind.value for kind in DisturbanceKind if kind.value in parts[order[0]]]
    figure, all_axes = pyplot.subplots(3, 6, figsize=(12, 5.4), sharex=True, sharey=True)
    for kind, axes in zip(kinds, all_axes.flat, strict=False):
        for name in _best(order):
            known = {g: parts[name].get(f"{kind} {g}", {}).get("detected_pct") for g in range(1, 6)}
            rates = {0: parts[name]["clear"]["detected_pct"]} | {
                g: v for g, v in known.items() if v is not None
            }
            axes.plot(list(rates), list(rates.values()), marker=".", linewidth=1, label=name)
        axes.set_title(kind.replace("_", " "), fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    all_axes.flat[0].legend(fontsize=6, loc="lower left")
    figure.supxlabel("grade, 0: clear", fontsize=8)
    figure.supylabel("right lane, % of frames", fontsize=8)
    _save(figure, path, dpi=FINE_DPI)


def _cost(path: Path, ranking: Mapping[str, Mapping[str, Any]]) -> None:
    """Time per frame and rate of right lanes."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.4))
    for name, row in ranking.items():
        own = name in ("cv", "cnn")
        axes.scatter(row["ms_median"], row["all_detected_pct"], s=18, color="tab:red" if own else "tab:blue")
        axes.annotate(
            name,
            (row["ms_median"], row["all_detected_pct"]),
            fontsize=6,
            xytext=(3, 2),
            textcoords="offset points",
        )
    axes.set_xscale("log")
    axes.set_xlabel("ms of processor time per 320 × 240 frame, median", fontsize=8)
    axes.set_ylabel("right lane, % of all frames", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3, which="both")
    _save(figure, path)


def _confidence(path: Path, results: Results, order: Sequence[str]) -> None:
    """Confidence in ten equally full bins against the share of wheel angles within two degrees."""
    from matplotlib import pyplot

    cases = [case for case in results if case.condition != GAP]
    figure, axes = pyplot.subplots(figsize=(4.6, 4.4))
    axes.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    for name in _best(order):
        looks = scored(results, name, cases)
        looks = looks[given(looks)]
        parts = np.array_split(np.argsort(looks["confidence"], kind="stable"), BINS)
        good = np.abs(looks["angle_rad"]) <= TOLERANCE_RAD
        means = [(looks["confidence"][part].mean(), good[part].mean()) for part in parts if len(part)]
        axes.plot(*zip(*means, strict=True), marker=".", linewidth=1, label=name)
    axes.set_xlabel("confidence", fontsize=8)
    axes.set_ylabel("share of wheel angles within 2°", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    _save(figure, path)


def _best(order: Sequence[str]) -> list[str]:
    """The first estimators of the ranking, and the default ones at any rank."""
    chosen = [name for name in order if name in ("cv", "cnn")]
    return [*chosen, *(name for name in order if name not in chosen)][:MOST_LINES]


def _save(figure: Any, path: Path, *, dpi: int = DPI) -> None:
    from matplotlib import pyplot

    figure.tight_layout()
    figure.savefig(path, dpi=dpi)
    pyplot.close(figure)
