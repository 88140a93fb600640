"""Tables of text in the dialects of spreadsheets and of all countries, read to one form.

Separator: comma, semicolon, tab or bar, whichever divides most lines alike, else blanks, or what a first line such
as ``sep=;`` of a spreadsheet says. Decimal mark: a comma in columns without decimal points, where the table has
cells such as ``0,12`` or ``1.234,5``; these get a point. Marks after thousands are dropped, as in ``1 234,5``.
What has two meanings, such as decimal commas between commas, is refused by its name. Lines that begin with ``#`` or
``%`` are comments, but the last one before the rows is the header where it has their cells, as NumPy writes it.
"""

import csv
import io
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from trepid.config import InputError, read_text
from trepid.loudness import detail
from trepid.types import Column

SEPARATORS = (",", ";", "\t", "|")  # of two that fit alike the first
BLANK = " "  # between cells that none of these divides, as NumPy and pandas write them
SAMPLED = 200  # lines that tell the separator
ROUNDED = 3  # rows a time, on average: rounded times
MPS_PER_MPH = 0.44704  # exact, by the international mile
_COMMENT = ("#", "%")
_MINUS = "\u2212"  # as some programs write negative numbers
_STATED = re.compile(r"\"?sep=(.)\"?", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_POINT_NUMBER = re.compile(r"\s*[+-]?\d*\.\d+(?:[eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:,\d{3})+\s*")
_SPACES = "[ \u00a0\u202f'\u2019]"  # after thousands: also those without a break, and apostrophes
_SPACED = re.compile(rf"\s*[+-]?[1-9]\d{{0,2}}(?:{_SPACES}\d{{3}})+(?:[.,]\d+)?\s*")
_AFTER_COMMAS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:,\d{3})+\.\d+\s*")
_AFTER_POINTS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})+,\d+\s*")
_POINTS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})+\s*")
_NUMBER = re.compile(r"\s*[+-]?[\d.,]*\d[.,]?(?:[eE][+-]?\d+)?\s*|")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
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
    text = read_text(path, windows=True).replace(_MINUS, "-")
    first, _, rest = text.partition("\n")
    stated = _STATED.fullmatch(first.strip())
    text = _without_comments(f"\n{rest}" if stated else text, stated[1] if stated else None)
    separator = stated[1] if stated else _separator(text)
    if separator == BLANK:
        text = "\n".join(line.strip() for line in text.split("\n"))
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    rows: list[Row] = []
    before = 0
    try:
        for cells in reader:
            if reader.line_num > before + 1:
                where = f"{path}:{before + 1}"
                raise InputError(
                    f"{where}: a quotation mark that ends in line {reader.line_num} or not at all"
                )
            before = reader.line_num
            if "".join(cells).strip():  # not the empty rows of a sheet
                rows.append(Row(reader.line_num, cells))
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: cannot be read: {error}") from error
    if not rows:
        raise InputError(f"{path}: is empty")
    for row in rows[1:]:
        while len(row.cells) > len(rows[0].cells) and not row.cells[-1].strip():
            del row.cells[-1]  # after a separator at the end of the line
    refuse_halved_numbers(path, rows, len(rows[0].cells))
    if separator != ",":
        detail(f"trepid: {path}: cells divided by {separator!r}")
    return _with_points(path, rows)


def _without_comments(text: str, separator: str | None) -> str:
    """``text`` with empty lines for its comments; a header after a mark of a comment is kept without the mark."""
    lines = text.split("\n")
    written = [number for number, line in enumerate(lines) if line.strip()]
    comments = [number for number in written if lines[number].lstrip().startswith(_COMMENT)]
    above = comments[: next((at for at, number in enumerate(written) if number not in comments[: at + 1]), 0)]
    header = None
    if above and len(above) < len(written):
        named = lines[above[-1]].lstrip().lstrip("".join(_COMMENT))
        first = lines[written[len(above)]]
        by = separator or _separator(f"{first}\n{first}")
        cells = next(csv.reader([first], delimiter=by))
        if len(next(csv.reader([named], delimiter=by), [])) == len(cells) > 1 and any(
            _NUMBER.fullmatch(cell) for cell in cells if cell.strip()
        ):
            header = above[-1], named
    for number in comments:
        lines[number] = ""
    if header:
        lines[header[0]] = header[1]
    return "\n".join(lines)


def column_names(header: Row, known: Collection[str]) -> list[str]:
    """The names in ``header`` without blanks, and those of ``known`` in their own letters, not in capitals."""
    names = [name.strip() for name in header.cells]
    plain = {name.lower(): name for name in known}
    own = [plain.get(name.lower(), name) for name in names]
    return [name if found in names else found for name, found in zip(names, own, strict=True)]


def seconds_of_date(text: str) -> float | None:
    """The time since the Unix epoch that a date and time by ISO 8601 states [s], in UTC where it has no offset."""
    if not _DATE.match(text):
        return None
    try:
        stated = datetime.fromisoformat(text.replace(",", "."))
    except ValueError:
        return None
    return (stated if stated.tzinfo else stated.replace(tzinfo=UTC)).timestamp()


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
    lines = [line.strip(BLANK) for line in text.split("\n") if line.strip()][:SAMPLED]

    def fit(separator: str) -> tuple[bool, int]:
        """Whether most lines have as many cells as the first, and that number."""
        cells = csv.reader(lines, delimiter=separator, skipinitialspace=True)
        widths = [len(row) for row in cells] or [0]
        return widths[0] > 1 and 2 * widths.count(widths[0]) > len(widths), widths[0]

    try:
        best = max(SEPARATORS, key=fit)
        return BLANK if not fit(best)[0] and fit(BLANK)[0] else best
    except csv.Error:  # of quotes that do not match this separator; the reading of the whole file names it
        return SEPARATORS[0]


def _with_points(path: Path, rows: list[Row]) -> list[Row]:
    """The rows with points for decimal commas, where the table has these, and without marks after thousands."""
    columns: dict[int, list[Row]] = defaultdict(list)
    for row in rows:
        for at, cell in enumerate(row.cells):
            if "," in cell or "." in cell or _SPACED.fullmatch(cell):
                columns[at].append(row)
    for at, marked in columns.items():
        if _is_of_numbers(rows, at):
            _rewrite(marked, at, _SPACED, lambda cell: re.sub(_SPACES, "", cell.strip()))
    commas = [line for at, marked in columns.items() for line in _comma_lines(marked, at)]
    points = [line for at in columns for line in _lines(columns[at], at, _AFTER_COMMAS)]
    if commas and points:
        what = f"a comma after thousands, and decimal commas in line {commas[0]}: write one form of numbers"
        raise InputError(f"{path}:{points[0]}: {what}")
    for at, marked in columns.items():
        if commas:
            _points_for_commas(path, marked, at, commas[0])
        elif points:
            for form in (_AFTER_COMMAS, _THOUSANDS):
                _rewrite(marked, at, form, lambda cell: cell.replace(",", ""))
    return rows


def _comma_lines(rows: list[Row], at: int) -> list[int]:
    """The lines whose cell ``at`` has a decimal comma for sure."""
    found = _lines(rows, at, _AFTER_POINTS)
    if not _lines(rows, at, _POINT_NUMBER):
        groups = _lines(rows, at, _THOUSANDS)
        found += [line for line in _lines(rows, at, _COMMA_NUMBER) if line not in groups]
    return found


def _lines(rows: list[Row], at: int, form: re.Pattern[str]) -> list[int]:
    """The lines whose cell ``at`` has ``form``."""
    return [row.line for row in rows if form.fullmatch(row.cells[at])]


def _rewrite(rows: list[Row], at: int, form: re.Pattern[str], plain: Callable[[str], str]) -> None:
    """Let the cells ``at`` of ``form`` be as ``plain`` writes them."""
    for row in rows:
        if form.fullmatch(row.cells[at]):
            row.cells[at] = plain(row.cells[at])


def _is_of_numbers(rows: list[Row], at: int) -> bool:
    """Whether the cells ``at`` are numbers or empty, but for that of the first row."""
    cells = [row.cells[at] for row in rows[1:] if at < len(row.cells)]
    return all(_NUMBER.fullmatch(cell) or _SPACED.fullmatch(cell) for cell in cells)


def _points_for_commas(path: Path, rows: list[Row], at: int, comma_line: int) -> None:
    """Write the cells ``at`` of a table with decimal commas, as in line ``comma_line``, with points.

    A cell such as ``1.234`` beside numbers with commas in its column has a point after thousands, and beside points
    as in ``0.05`` a decimal point. Where the column has neither, InputError is raised.
    """
    groups, pointed = _lines(rows, at, _POINTS), _lines(rows, at, _POINT_NUMBER)
    commas = _lines(rows, at, _COMMA_NUMBER) + _lines(rows, at, _AFTER_POINTS)
    if groups and len(groups) == len(pointed):
        if not commas:
            cell = next(row.cells[at] for row in rows if row.line == groups[0])
            what = f"{cell.strip()!r} may have a point after thousands or a decimal point"
            raise InputError(
                f"{path}:{groups[0]}: {what}; line {comma_line} has decimal commas: write one form"
            )
        _rewrite(rows, at, _POINTS, lambda cell: cell.replace(".", ""))
        pointed = []
    if not pointed:
        _rewrite(rows, at, _COMMA_NUMBER, lambda cell: cell.replace(",", "."))
    _rewrite(rows, at, _AFTER_POINTS, lambda cell: cell.replace(".", "").replace(",", "."))
