"""Benchmarks in the terminal: contestants next to each other, and no figure left out."""

from rich.console import Console

from lab.bench.text import RANKING, brief, columns_of, tables

RESULT = {
    "machine": "two cores",
    "seed": 5,
    "laws": {"mpc": {"worst [m]": 0.0123456, "lost": 0}, "stanley": {"worst [m]": None, "lost": 3}},
    "plain": {"frames per second": 553.21},
}


def text_of(result):
    console = Console(width=100)
    with console.capture() as captured:
        for table in tables(result):
            console.print(table)
    return captured.get()


def test_contestants_are_rows_and_measures_columns_with_their_units():
    lines = text_of(RESULT).splitlines()
    head = next(i for i, line in enumerate(lines) if "worst [m]" in line)
    assert lines[head].split() == ["worst", "[m]", "lost"]
    assert lines[head + 1].split() == ["mpc", "0.01235", "0"]
    assert lines[head + 2].split() == ["stanley", "–", "3"]


def test_many_measures_stand_below_each_other():
    many = {f"at {n} m/s": float(n) for n in range(20)}
    lines = text_of({"grid": {"ours": many, "theirs": many}}).splitlines()
    assert any(line.split() == ["ours", "theirs"] for line in lines)
    assert any(line.split() == ["at", "19", "m/s", "19", "19"] for line in lines)


def test_a_table_with_more_rows_than_columns_is_never_turned():
    rows = {f"row {n}": {f"column {m}": n for m in range(9)} for n in range(30)}
    assert any(line.startswith(" row 29 ") for line in text_of({"faults": {"sim": rows}}).splitlines())


def test_a_column_without_any_value_is_left_out():
    assert columns_of({"a": {"x": None, "y": None, "z": 0}, "b": {"x": 1, "y": None}}) == ["x", "z"]


def test_plain_figures_are_listed_with_the_machine():
    text = text_of(RESULT)
    assert "two cores" in text and "553.2" in text


def test_in_a_terminal_many_estimators_have_few_columns():
    row = dict.fromkeys(RANKING, 1.0)
    found = {"ranking": {str(n): row for n in range(9)}, "detected, percent": {}, "drive": {}}
    assert set(brief(found)["ranking"]["0"]) == set(RANKING.values())
    assert set(brief(found)) == {"ranking", "drive"}
    few = {"ranking": {"cv": row}, "detected, percent": {}}
    assert brief(few) == few
