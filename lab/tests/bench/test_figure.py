"""The figure of a benchmark: panels with units, and none where nothing can be compared."""

from pathlib import Path

import pytest

from lab.bench.figure import draw, with_unit


@pytest.mark.parametrize(
    ("column", "title"),
    [
        ("median_ms", "median [ms]"),
        ("steps_per_s", "steps [1/s]"),
        ("lateral_mps2", "lateral [m/s²]"),
        ("cpu_percent", "cpu [%]"),
        ("departures", "departures"),
        ("ratio_to_bare_chain", "ratio to bare chain"),
    ],
)
def test_the_title_of_a_panel_gives_the_unit_in_brackets(column: str, title: str) -> None:
    assert with_unit(column) == title


def test_a_table_with_different_numbers_becomes_a_figure(tmp_path: Path) -> None:
    draw({"cv": {"median_ms": 1.0}, "cnn": {"median_ms": 2.0}}, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_equal_numbers_and_single_rows_give_no_figure(tmp_path: Path) -> None:
    draw({"cv": {"departures": 0}, "cnn": {"departures": 0}}, tmp_path / "a.png")
    draw({"cv": {"median_ms": 1.0}}, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()
