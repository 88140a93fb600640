"""Tables of text in the dialects of spreadsheets and of all countries, read to one form.

Separator: comma, semicolon, tab or bar, whichever divides most lines alike, or what a first line such as ``sep=;``
of a spreadsheet says. Decimal mark: a comma in columns without decimal points, where the table has cells such as
``0,12``; these get a point. What has two meanings, such as decimal commas between commas, is refused by its name.
"""

import csv
import io
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trepid.config import InputError, read_text
from trepid.loudness import detail
from trepid.types import Column

SEPARATORS = (",", ";", "\t", "|")  # of two that fit alike the first
SAMPLED = 200  # lines that tell the separator
ROUNDED = 3  # rows a time, on average: rounded times
_STATED = re.compile(r"\"?sep=(.)\"?", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_POINT_NUMBER = re.compile(r"\s*[+-]?\d*\.\d+(?:[eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:,\d{3})+\s*")
_HALVES = re.compile(r"(?:^|,)\s*[+-]?\d+,\d+\s*(?:,|$)")


@dataclass(frozen=True, slots=True)
class Row:
    """The cells of a row, and the line where it ends."""

    line: int
    cells: list[str]


def read_rows(path: Path) -> list[Row]:
    """The rows of the table in ``path``, its header among them, without blank lines; numbers have decimal points.

    Raises InputError when the file cannot be read or is empty, and for decimal commas in cells that commas divide.
    """
    text = read_text(path, windows=True)
    first, _, rest = text.partition("\n")
    stated = _STATED.fullmatch(first.strip())
    separator, skipped = (stated[1], 1) if stated else (_separator(text), 0)
    reader = csv.reader(io.StringIO(rest if stated else text), delimiter=separator)
    try:
        rows = [
            Row(reader.line_num + skipped, cells)
            for cells in reader
            if "".join(cells[:1]).strip() or cells[1:]
        ]
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num + skipped}: cannot be read: {error}") from error
    while rows and not "".join(rows[-1].cells).strip():
        del rows[-1]  # the empty rest of a sheet
    if not rows:
        raise InputError(f"{path}: is empty")
    for row in rows[1:]:
        while len(row.cells) > len(rows[0].cells) and not row.cells[-1].strip():
            del row.cells[-1]  # after a separator at the end of the line
    refuse_halved_numbers(path, rows, len(rows[0].cells))
    if separator != ",":
        detail(f"trepid: {path}: cells divided by {separator!r}")
    return _with_points(rows)


def refuse_halved_numbers(path: Path, rows: list[Row], columns: int) -> None:
    """Raise InputError where most rows have more cells than ``columns``: commas in and between numbers."""
    halved = [row for row in rows if len(row.cells) > columns and _HALVES.search(",".join(row.cells))]
    if 2 * len(halved) > len(rows):
        raise InputError(
            f"{path}:{halved[0].line}: {len(halved[0].cells)} cells in {columns} columns: decimal commas; save the"
            " table with decimal points, or with ';' between the cells"
        )


def refuse_rounded_times(path: Path, name: str, values: Column, routes: Sequence[str] = ()) -> None:
    """Raise InputError where the column ``name`` gives ROUNDED rows or more the same time.

    Spreadsheets round a long time to six digits. With ``routes`` times are compared within each route.
    """
    moments = zip(values.tolist(), routes, strict=True) if len(routes) else values.tolist()
    different = len(set(moments))
    if len(values) > 1 and ROUNDED * different <= len(values):
        times = "1 time" if different == 1 else f"{different} times"
        raise InputError(
            f"{path}: {name}: {len(values)} rows have {times}: rounded, as by a spreadsheet;"
            " take the table as it was before"
        )


def _separator(text: str) -> str:
    lines = [line for line in text.split("\n") if line.strip()][:SAMPLED]

    def fit(separator: str) -> tuple[bool, int]:
        """Whether most lines have as many cells as the first, and that number."""
        widths = [len(row) for row in csv.reader(lines, delimiter=separator)] or [0]
        return widths[0] > 1 and 2 * widths.count(widths[0]) > len(widths), widths[0]

    try:
        return max(SEPARATORS, key=fit)
    except csv.Error:  # of quotes that do not match this separator; the reading of the whole file names it
        return SEPARATORS[0]


def _with_points(rows: list[Row]) -> list[Row]:
    """The rows with points for decimal commas, where the table has these."""
    columns: dict[int, list[str]] = defaultdict(list)
    for row in rows:
        for at, cell in enumerate(row.cells):
            if "," in cell or "." in cell:
                columns[at].append(cell)
    pointless = [at for at, cells in columns.items() if not any(map(_POINT_NUMBER.fullmatch, cells))]
    sure = any(
        _COMMA_NUMBER.fullmatch(cell) and not _THOUSANDS.fullmatch(cell)
        for at in pointless
        for cell in columns[at]
    )
    for row in rows if sure else ():
        for at in pointless:
            if at < len(row.cells) and _COMMA_NUMBER.fullmatch(row.cells[at]):
                row.cells[at] = row.cells[at].replace(",", ".")
    return rows
