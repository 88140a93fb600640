"""The page of lab/results and the table of the README are generated from the stored rows."""

import re
from pathlib import Path

import pytest

from lab.bench.readme import BEGIN, END, ROWS, table, write_table
from lab.bench.results import page, save, section, stored_results
from trepid.config import ROOT, InputError

RESULTS = ROOT / "lab" / "results"
STORED = stored_results(RESULTS)
PAGE = (RESULTS / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", STORED)
def test_a_page_is_generated_from_its_rows(name: str) -> None:
    assert f"\n\n{section(STORED[name], RESULTS)}\n" in PAGE


def test_rows_without_common_columns_get_a_page_and_no_figure(tmp_path: Path) -> None:
    for name in ("logbook", "page"):
        save(STORED[name], tmp_path)
    assert {path.name for path in tmp_path.glob("*.png")} == {"page.png"}
    written = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "(page.png)" in written and "(logbook.png)" not in written


def test_a_page_shows_all_results_of_its_folder_each_once(tmp_path: Path) -> None:
    for name in ("page", "logbook", "page"):
        save(STORED[name], tmp_path)
    lines = (tmp_path / "README.md").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith("## ")] == ["## page", "## logbook"]


def test_a_page_that_is_none_of_results_is_not_overwritten(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text("mine")
    with pytest.raises(InputError, match=r"README.md: is no page of results"):
        save(STORED["page"], tmp_path)
    assert readme.read_text() == "mine" and list(tmp_path.iterdir()) == [readme]


def test_the_index_lists_the_stored_results() -> None:
    assert page(STORED, RESULTS) == PAGE


def test_the_table_of_the_readme_is_generated_from_the_rows() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    measured = {name: result.measured for name, result in STORED.items()}
    assert text.split(BEGIN)[1].split(END)[0].strip() == table(measured)


def test_every_row_of_the_readme_has_a_stored_result() -> None:
    assert {name for name, _, _ in ROWS} <= set(STORED)


def test_a_limit_of_the_readme_leaves_counts_of_stored_results_to_the_table() -> None:
    limits = (ROOT / "README.md").read_text(encoding="utf-8").split("## Known limits")[1].split("\n## ")[0]
    sentences = re.split(r"(?<=\.)\s", limits)
    measured = [one for one in sentences if "lab/results" in one]
    assert measured and not [one for one in measured if re.search(r"\b(in|of) \d+\b", one)]


def test_a_new_result_changes_the_table_and_nothing_else(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write_table(readme, {"fear-inference": {"8 inputs, 5 sets, 40 rules": {"median_us": 20.0, "ratio": 900}}})
    text = readme.read_text()
    assert text.startswith(f"before\n{BEGIN}\n| what |") and text.endswith(f"{END}\nafter\n")
    assert "20 µs median, 900 times as fast" in text and "old" not in text
