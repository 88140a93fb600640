"""Results of the benchmark as files: tables in Markdown and CSV, all of it in JSON."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from trepid.config import InputError

Table = Mapping[str, Mapping[str, Any]]
"""Row -> column -> value."""

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
FEW = 7  # estimators whose columns fit side by side
TERMINAL = {
    "all_detected_pct": "detected",
    "clear_detected_pct": "clear",
    "correctness_pct": "correct",
    "clean_angle_deg_rmse": "wheel °",
    "ece": "ECE",
    "auroc": "AUROC",
    "ms_median": "ms",
}


def write(folder: Path, found: Mapping[str, Any], parts: Table) -> None:
    """``ranking``, ``detected`` and the real sets as .md and .csv, all of it as bench.json. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_json(folder / "bench.json", {**found, "figures by condition": parts})
        for name, table in found.items():
            if _is_table(table):
                _write_csv(folder / f"{_file_name(name)}.csv", table)
                text = markdown(table, COLUMNS if name == "ranking" else None)
                (folder / f"{_file_name(name)}.md").write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error


def _is_table(found: Any) -> bool:
    return (
        isinstance(found, Mapping) and bool(found) and all(isinstance(row, Mapping) for row in found.values())
    )


def markdown(table: Table, titles: Mapping[str, str] | None = None) -> str:
    """A table with the columns ``titles`` (name -> heading), or all of them; numbers with three figures."""
    columns = dict(titles or {name: name for name in _columns(table)})
    lines = ["| |" + "|".join(columns.values()) + "|", "|---|" + "---:|" * len(columns)]
    lines += [f"|{name}|" + "|".join(shown(row.get(c)) for c in columns) + "|" for name, row in table.items()]
    return "\n".join(lines) + "\n"


def shown(value: Any) -> str:
    """A number with three figures, a dash for none."""
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.1f}" if abs(value) >= 10 else f"{value:.2g}"


def _columns(table: Table) -> Sequence[str]:
    return list(dict.fromkeys(column for row in table.values() for column in row))


def _write_csv(path: Path, table: Table) -> None:
    columns = _columns(table)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["", *columns])
        writer.writerows([name, *(row.get(column) for column in columns)] for name, row in table.items())


def _write_json(path: Path, found: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(found, indent=1), encoding="utf-8")


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).strip("_").replace("__", "_")


def brief(found: Mapping[str, Any]) -> dict[str, Any]:
    """A short form for the terminal: of many estimators the main columns only, and failures of the first one."""
    ranking = found.get("ranking", {})
    if len(ranking) <= FEW:
        return dict(found)
    kept = {name: {title: row[key] for key, title in TERMINAL.items()} for name, row in ranking.items()}
    left_out = ("detected, percent",)
    return {"ranking": kept} | {k: v for k, v in found.items() if k != "ranking" and k not in left_out}
