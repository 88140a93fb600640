"""Tables in all dialects: one content, many ways to write it."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.config import InputError
from trepid.recording.csv_file import (
    Row,
    column_names,
    read_rows,
    refuse_halved_numbers,
    refuse_rounded_times,
    seconds_of_date,
)

HEADER = ["t_s", "image", "angle"]
ROWS = [[f"{0.05 * n:.3f}", f"{n}.jpg", f"{math.sin(n):.4f}"] for n in range(30)]


def cells(path: Path) -> list[list[str]]:
    return [row.cells for row in read_rows(path)]


def write_csv(path: Path, separator: str, *, comma: bool = False, encoding: str = "utf-8") -> Path:
    with path.open("w", newline="", encoding=encoding) as file:
        writer = csv.writer(file, delimiter=separator)
        writer.writerow(HEADER)
        for t_s, image, angle in ROWS:
            numbers = [t_s, angle] if not comma else [t_s.replace(".", ","), angle.replace(".", ",")]
            writer.writerow([numbers[0], image, numbers[1]])
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
def test_a_table_reads_the_same_in_every_dialect(
    tmp_path: Path, separator: str, comma: bool, encoding: str
) -> None:
    assert cells(write_csv(tmp_path / "a.csv", separator, comma=comma, encoding=encoding)) == [HEADER, *ROWS]


@pytest.mark.parametrize("form", ["{:>8} {:>12} {:>10}", "{} {} {}", "{}   {}  {} "])
def test_a_table_with_blanks_between_its_cells_reads_the_same(tmp_path: Path, form: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(form.format(*row) for row in (HEADER, *ROWS)))
    assert cells(path) == [HEADER, *ROWS]


def test_blanks_divide_no_cell_of_a_table_with_another_separator(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,remark\n1,in the rain\n2,in the sun\n")
    assert cells(path) == [["time", "remark"], ["1", "in the rain"], ["2", "in the sun"]]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("1970-01-02T00:00:00.250Z", 86400.25),
        ("1970-01-02 00:00:00,250", 86400.25),
        ("1970-01-02T02:00:00+02:00", 86400.0),
        ("1970-01-02T00:00", 86400.0),
        ("86400.25", None),
        ("1970-01-02", None),
        ("1970-13-02T00:00:00", None),
    ],
)
def test_a_date_with_a_time_is_that_many_seconds_since_the_epoch(text: str, found: float | None) -> None:
    assert seconds_of_date(text) == found


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20), st.sampled_from([";", "\t", "|"]))
def test_decimal_commas_change_no_number(tmp_path_factory, values: list[float], separator: str) -> None:
    path = tmp_path_factory.mktemp("t") / "a.csv"
    lines = [f"{n:.4f}{separator}{value:.4f}" for n, value in enumerate(values)]
    path.write_text("\n".join([f"n{separator}v", *(line.replace(".", ",") for line in lines)]))
    assert [float(row[1]) for row in cells(path)[1:]] == [float(f"{value:.4f}") for value in values]


@pytest.mark.parametrize(
    "header",
    ["T_S,IMAGE,Angle", ' t_s , Image, "ANGLE" ', '"T_s", "image", "angle"', "\u00a0t_s,image,angle "],
)
def test_names_of_columns_count_in_any_case_with_blanks_and_quotes(tmp_path: Path, header: str) -> None:
    path = write_csv(tmp_path / "a.csv", ",")
    path.write_text(path.read_text().replace(",".join(HEADER), header))
    first, *rows = read_rows(path)
    assert column_names(first, {"t_s", "image", "angle"}) == HEADER
    assert [row.cells for row in rows] == ROWS


def test_a_name_that_is_there_in_its_own_letters_is_not_taken_twice() -> None:
    assert column_names(Row(1, ["T_S", "t_s", "Speed"]), {"t_s", "speed"}) == ["T_S", "t_s", "speed"]


def test_a_web_page_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("<!DOCTYPE html>\n<html><body>404</body></html>")
    with pytest.raises(InputError, match=r"a\.csv:1:1: is a web page: download the file itself"):
        read_rows(tmp_path / "a.csv")


def test_a_first_line_can_state_the_separator_and_lines_stay_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("sep=;\nt_s;note\n0,5;a, b and c\n\n1,5;\n")
    rows = read_rows(path)
    assert [(row.line, row.cells) for row in rows] == [
        (2, ["t_s", "note"]),
        (3, ["0.5", "a, b and c"]),
        (5, ["1.5", ""]),
    ]


@pytest.mark.parametrize(
    "text",
    [
        "# made, by, a tool\nt_s,v\n0,1\n",
        "% Octave\n\n# unit: s\nt_s,v\n# lap 2\n0,1\n",
        "sep=;\n# a;b\nt_s;v\n0;1\n",
        "# made by\n# t_s,v\n0,1\n",
        "#t_s;v\n0;1\n",
        "\n,\nt_s,v\n ,\n0,1\n,\n",
    ],
)
def test_comments_and_empty_rows_are_no_rows_but_a_header_may_stand_in_a_comment(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    rows = read_rows(path)
    assert [[cell.strip() for cell in row.cells] for row in rows] == [["t_s", "v"], ["0", "1"]]
    assert text.split("\n")[rows[-1].line - 1].startswith("0")


def test_a_quotation_mark_that_is_not_closed_swallows_no_rows(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('t_s,v\n0,1\n1,"2\n2,3\n3,"4"\n')
    with pytest.raises(InputError, match=r"a\.csv:3: a quotation mark that ends in line 5 or not at all"):
        read_rows(path)


def test_a_minus_of_typesetting_is_a_minus(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,v\n0,\u22121.5\n", encoding="utf-8")
    assert cells(path)[1] == ["0", "-1.5"]


def test_rows_with_a_separator_at_their_end_have_no_further_cell(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2,\n3,4,\n,,\n")
    assert cells(path) == [["a", "b"], ["1", "2"], ["3", "4"]]


def test_a_comma_that_may_divide_thousands_stays_as_it_is(tmp_path: Path) -> None:
    amounts = ["1,234", "5,678"]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["v;w", *(f"{amount};1" for amount in amounts)]))
    assert [row[0] for row in cells(path)[1:]] == amounts


def test_a_column_with_points_keeps_its_commas_beside_one_with_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("v;w\n0,5;1.5\n0,25;2,5\n")
    assert cells(path)[1:] == [["0.5", "1.5"], ["0.25", "2,5"]]


def test_decimal_commas_between_commas_are_refused_by_their_name(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,image,angle\n" + "".join(f"0,{n},{n}.jpg,-0,{n}\n" for n in range(10, 20)))
    with pytest.raises(
        InputError, match=r"a\.csv:2: 5 cells in 3 columns: decimal commas; save the table with"
    ):
        read_rows(path)


def test_the_columns_of_a_table_without_header_may_be_known_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{n}.jpg, 0,{n}, 1\n" for n in range(10, 20)))
    rows = read_rows(path)
    with pytest.raises(InputError, match="4 cells in 3 columns: decimal commas"):
        refuse_halved_numbers(path, rows, 3)


def test_one_row_with_too_many_cells_condemns_no_table(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n3,4\n5,6,7\n")
    assert cells(path)[-1] == ["5", "6", "7"]


def test_times_that_a_spreadsheet_has_rounded_are_refused_by_their_column() -> None:
    stamps = np.array([float(f"{1.767225600e18 + 5e7 * n:.5E}") for n in range(600)])
    with pytest.raises(InputError, match="timestamp_ns: 600 rows have 1 time: rounded"):
        refuse_rounded_times(Path("a.csv"), "timestamp_ns", stamps)
    refuse_rounded_times(Path("a.csv"), "timestamp_ns", 1.767225600e18 + 5e7 * np.arange(600))


def test_routes_may_have_the_same_times() -> None:
    t_s, routes = np.tile(np.arange(10.0), 4), [f"{n // 10}" for n in range(40)]
    refuse_rounded_times(Path("a.csv"), "t_s", t_s, routes)
    with pytest.raises(InputError, match="40 rows have 10 times"):
        refuse_rounded_times(Path("a.csv"), "t_s", t_s)


@pytest.mark.parametrize("text", ["", "\n\n", ",,\n,,\n"])
def test_an_empty_table_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError, match="is empty"):
        read_rows(path)


def column(path: Path, text: str, at: int = 0) -> list[str]:
    path.write_text(text, encoding="utf-8")
    return [row[at] for row in cells(path)[1:]]


@pytest.mark.parametrize(
    "written",
    [
        "1,234.5;950.25;12,345",  # English
        "1.234,5;950,25;12.345",  # German
        "1 234,5;950,25;12 345",  # French, with spaces
        "1\u202f234,5;950,25;12\u00a0345",  # as Excel and Python write it
        "1'234.5;950.25;12'345",  # Swiss
        "1\u2019234.5;950.25;12\u2019345",
    ],
)
def test_marks_after_thousands_change_no_number(tmp_path: Path, written: str) -> None:
    text = "timestamp_ms;t\n" + "".join(f"{number};a\n" for number in written.split(";"))
    assert [float(number) for number in column(tmp_path / "a.csv", text)] == [1234.5, 950.25, 12345.0]


@given(st.lists(st.floats(-1e7, 1e7), min_size=3, max_size=20))
def test_numbers_of_one_language_are_read_as_they_were_or_not_at_all(
    tmp_path_factory, values: list[float]
) -> None:
    path = tmp_path_factory.mktemp("t") / "a.csv"
    english = [f"{value:,.2f}" for value in values]
    german = [number.translate(str.maketrans(",.", ".,")) for number in english]
    for numbers in (english, german):
        found = column(path, "speed;t_s\n" + "".join(f"{number};0\n" for number in numbers))
        assert [float(number) for number in found] == [float(f"{value:.2f}") for value in values]


def test_a_number_that_may_have_two_values_is_refused_where_the_table_has_decimal_commas(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match=r"a.csv:2: '1.050' may have a point after thousands.*line 2 has"):
        column(tmp_path / "a.csv", "ms;v\n1.050;0,5\n1.100;0,6\n")
    assert column(tmp_path / "a.csv", "s;v\n0.050;0,5\n1.100;0,6\n") == ["0.050", "1.100"]


def test_two_forms_of_numbers_in_one_table_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.csv:3: a comma after thousands, and decimal commas in line 2"):
        column(tmp_path / "a.csv", "ms;v\n900.5;0,5\n1,100.5;0,6\n")


def test_names_with_spaces_between_digits_stay(tmp_path: Path) -> None:
    assert column(tmp_path / "a.csv", "route;v\n1 100;5\nlap 2;6\n") == ["1 100", "lap 2"]
