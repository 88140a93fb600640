"""The pages of docs/results and the table of the README are generated from their stored rows."""

from pathlib import Path

import pytest

from lab.bench.readme import BEGIN, END, ROWS, table, write_table
from lab.bench.results import index, page, save, stored
from trepid.config import ROOT

RESULTS = ROOT / "docs" / "results"
STORED = stored(RESULTS)


@pytest.mark.parametrize("name", STORED)
def test_a_page_is_generated_from_its_rows(name: str) -> None:
    assert (RESULTS / f"{name}.md").read_text(encoding="utf-8") == page(STORED[name], RESULTS)


def test_rows_without_common_columns_get_a_page_and_no_figure(tmp_path: Path) -> None:
    for name in ("logbook", "page"):
        save(STORED[name], tmp_path)
    assert {path.name for path in tmp_path.glob("*.png")} == {"page.png"}
    assert ".png" not in (tmp_path / "logbook.md").read_text(encoding="utf-8")


def test_the_index_lists_the_stored_results() -> None:
    assert (RESULTS / "README.md").read_text(encoding="utf-8") == index(STORED)


def test_the_table_of_the_readme_is_generated_from_the_rows() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    measured = {name: result.measured for name, result in STORED.items()}
    assert text.split(BEGIN)[1].split(END)[0].strip() == table(measured)


def test_every_row_of_the_readme_has_a_stored_result() -> None:
    assert {name for name, _, _ in ROWS} <= set(STORED)


def test_a_new_result_changes_the_table_and_nothing_else(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write_table(readme, {"fear-inference": {"8 inputs, 5 sets, 40 rules": {"median_us": 20.0, "ratio": 900}}})
    text = readme.read_text()
    assert text.startswith(f"before\n{BEGIN}\n| what |") and text.endswith(f"{END}\nafter\n")
    assert "20 µs median, 900 times as fast" in text and "old" not in text
