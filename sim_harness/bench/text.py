"""What a benchmark measured, as tables in the terminal."""

from collections.abc import Iterable, Iterator
from typing import Any

from rich.markup import escape
from rich.table import Table

FIGURES = 4  # shown of a number; JSON has them all
MOST_COLUMNS = 7  # measures beside each other; more stand below each other


def tables(result: dict[str, Any]) -> Iterator[Table]:
    """The machine and one table a benchmark: contestants as rows where they share their measures."""
    yield _list("measured on", {k: v for k, v in result.items() if not isinstance(v, dict)})
    for name, measured in result.items():
        if isinstance(measured, dict):
            rows = {row: m for row, m in measured.items() if isinstance(m, dict)}
            rest = {k: v for k, v in measured.items() if k not in rows}
            if rest:
                yield _list(name, rest)
            if rows:
                yield _grid(name, rows)


def _list(title: str, measured: dict[str, Any]) -> Table:
    table = _table(title, ("", ""))
    for what, value in measured.items():
        table.add_row(escape(what), _shown(value))
    return table


def _grid(title: str, rows: dict[str, dict[str, Any]]) -> Table:
    """Rows by columns, turned round where the measures are many."""
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    if len(columns) > MOST_COLUMNS:
        turned = {column: {name: row.get(column) for name, row in rows.items()} for column in columns}
        rows, columns = turned, list(rows)
    table = _table(title, ("", *columns))
    for name, row in rows.items():
        table.add_row(escape(name), *(_shown(row.get(column)) for column in columns))
    return table


def _table(title: str, columns: Iterable[str]) -> Table:
    table = Table(box=None, title=escape(title), title_justify="left", title_style="bold")
    for number, column in enumerate(columns):
        table.add_column(escape(column), justify="right" if number else "left", overflow="fold")
    return table


def _shown(value: object) -> str:
    """A measure in few figures; what was not measured as a dash."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.{FIGURES}g}"
    if isinstance(value, dict):
        return escape(", ".join(f"{name} {_shown(part)}" for name, part in value.items()))
    if isinstance(value, list | tuple):
        return escape(", ".join(_shown(part) for part in value))
    return escape(str(value))
