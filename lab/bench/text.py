"""Measured values as text: tables of a benchmark, values in few digits, tables as Markdown or in a terminal."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

Row = Mapping[str, Any]
FIGURES = 4  # significant digits shown; JSON has all
MAX_COLUMNS = 7  # a wider table with fewer rows than columns is turned in the terminal
RANKING = {
    "all_detected_pct": "detected",
    "clear_detected_pct": "clear",
    "correctness_pct": "correct",
    "clean_angle_deg_rmse": "wheel °",
    "ece": "ECE",
    "auroc": "AUROC",
    "ms_median": "ms",
}
"""Columns of the ranking of estimators that the terminal shows when it has too many rows to be turned."""


def grids(measured: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Row]]]:
    """The tables among measured values: title, and rows of columns. Rows at the top level make one table."""
    top = {name: row for name, row in measured.items() if isinstance(row, Mapping) and not is_nested(row)}
    if top:
        yield "", top
    for name, table in measured.items():
        if is_nested(table):
            yield name, _join_rows(table)


def _join_rows(table: Mapping[str, Any]) -> Mapping[str, Row]:
    """``table`` with rows that are tables themselves replaced by the rows of those."""
    rows: dict[str, Row] = {}
    for name, row in table.items():
        rows |= (
            {f"{name}, {inner}": values for inner, values in row.items()} if is_nested(row) else {name: row}
        )
    return rows


def is_nested(found: object) -> bool:
    """Whether ``found`` is a table: a mapping whose values are all rows."""
    if not isinstance(found, Mapping) or not found:
        return False
    return all(isinstance(row, Mapping) for row in found.values())


def singles(measured: Mapping[str, Any]) -> dict[str, Any]:
    """The measured values that stand in no table."""
    return {name: value for name, value in measured.items() if not isinstance(value, Mapping)}


def columns_of(rows: Mapping[str, Row]) -> list[str]:
    """The columns with a value in some row, in the order of their first use."""
    columns = dict.fromkeys(column for row in rows.values() for column in row)
    return [column for column in columns if any(row.get(column) is not None for row in rows.values())]


def exchange_axes(rows: Mapping[str, Row]) -> dict[str, Row]:
    """The table with rows and columns exchanged."""
    return {column: {name: row.get(column) for name, row in rows.items()} for column in columns_of(rows)}


def value_text(value: object) -> str:
    """A value in few digits; a dash where there is none."""
    if value is None:
        return "–"
    if isinstance(value, float):
        digits = f"{value:.{FIGURES}g}"
        return f"{float(digits):.0f}" if "e+" in digits else digits
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {value_text(part)}" for name, part in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(value_text, value))
    return str(value)


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown; all columns but the first are aligned to the right."""
    lines = [head, ("---", *("---:" for _ in head[1:])), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def brief(measured: Mapping[str, Any]) -> dict[str, Any]:
    """A short form for the terminal: of a ranking of many estimators the main columns only."""
    ranking = measured.get("ranking", {})
    if len(ranking) <= MAX_COLUMNS:
        return dict(measured)
    kept = {name: {title: row[key] for key, title in RANKING.items()} for name, row in ranking.items()}
    return {"ranking": kept} | {
        k: v for k, v in measured.items() if k not in ("ranking", "detected, percent")
    }


def tables(report: Mapping[str, Any]) -> Iterator[Table]:
    """A table of the machine, and the tables of each benchmark of ``report``."""
    yield _table("measured on", ("", ""), singles(report).items())
    for name, measured in report.items():
        if not isinstance(measured, Mapping):
            continue
        alone = singles(measured)
        if alone:
            yield _table(name, ("", ""), alone.items())
        for title, rows in grids(measured):
            wide = len(columns_of(rows)) > max(MAX_COLUMNS, len(rows))
            yield _grid(f"{name}: {title}" if title else name, exchange_axes(rows) if wide else rows)


def _grid(title: str, rows: Mapping[str, Row]) -> Table:
    columns = columns_of(rows)
    return _table(title, ("", *columns), ((name, *map(row.get, columns)) for name, row in rows.items()))


def _table(title: str, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> Table:
    table = Table(box=None, title=escape(title), title_justify="left", title_style="bold")
    for number, column in enumerate(columns):
        table.add_column(escape(column), justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*(escape(value_text(value)) for value in row))
    return table
