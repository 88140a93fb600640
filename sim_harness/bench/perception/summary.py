"""Results on the harness set as nested tables."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_harness.bench.perception.clips import GAP
from sim_harness.bench.perception.scores import (
    MAIN_CONDITIONS,
    Results,
    correct,
    figures,
    gap_figures,
    groups,
    one_line_figures,
    scored,
    times_ms,
)

Row = dict[str, float | None]
SHOWN = ("all", "clear", "marked", "unmarked")
WORST = 12


def parts_of(results: Results, names: Sequence[str]) -> dict[str, dict[str, Row]]:
    """The figures of every estimator in every group of clips."""
    parts = groups(results)
    return {
        name: {part: figures(scored(results, name, cases)) for part, cases in parts.items()} for name in names
    }


def summary(results: Results, parts: dict[str, dict[str, Row]]) -> dict[str, Any]:
    """``ranking``: the main figures of every estimator, best first; ``detected``: percent by condition; and the
    worst clips of the first estimator."""
    ranking = {name: main_figures(results, name, rows) for name, rows in parts.items()}
    order = sorted(ranking, key=lambda name: -(ranking[name]["all_detected_pct"] or 0.0))
    detected = {part: {name: parts[name][part]["detected_pct"] for name in order} for part in parts[order[0]]}
    first = next(iter(parts))
    return {
        "ranking": {name: ranking[name] for name in order},
        "detected, percent": detected,
        f"worst clips of {first}, percent detected": worst(results, first),
    }


def main_figures(results: Results, name: str, parts: dict[str, Row]) -> Row:
    """One row: rates by condition, errors, confidence, time."""
    row: Row = {f"{part}_detected_pct": parts[part]["detected_pct"] for part in SHOWN if part in parts}
    row["correctness_pct"] = parts["all"]["correctness_pct"]
    row["given_pct"] = parts["all"]["given_pct"]
    row |= {f"{part}_detected_pct": parts[part]["detected_pct"] for part in MAIN_CONDITIONS if part in parts}
    clean = parts.get("clean", {})
    for key in ("offset_m", "heading_deg", "curvature_1pm", "width_pct", "angle_deg"):
        row[f"clean_{key}_rmse"] = clean.get(f"{key}_rmse")
        row[f"clean_{key}_rmse_when_right"] = clean.get(f"{key}_rmse_when_right")
        row[f"clean_{key}_median"] = clean.get(f"{key}_median")
    row["unmarked_boundary_m_rmse"] = parts.get("unmarked", {}).get("boundary_m_rmse")
    row |= gap_figures(results, name) | one_line_figures(results, name)
    row["ece"], row["auroc"] = parts["all"]["ece"], parts["all"]["auroc"]
    return row | times_ms(results, name)


def worst(results: Results, name: str) -> dict[str, float]:
    """The clips with the lowest share of right frames, and that share in percent."""
    rates = {
        case.key: 100 * float(np.mean(correct(scored(results, name, [case]))))
        for case in results
        if case.condition != GAP
    }
    return dict(sorted(rates.items(), key=lambda item: item[1])[:WORST])
