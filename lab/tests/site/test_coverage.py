"""docs/coverage.md is generated, holds every entry of the inventory once, and names what exists."""

import re
from collections import Counter

import pytest

from lab.site.coverage import PAGE, InventoryEntry, page, rows
from trepid.config import ROOT

INVENTORY = {"P": 10, "A": 26, "B": 32, "T": 6, "S": 19, "N": 23, "D": 9, "M": 9, "E": 13}
INVENTORY |= {"O": 10, "F": 17, "V": 10, "H": 7}
"""Number of entries of each family, which are numbered from 1 on."""
RESULTS = (ROOT / "lab" / "results" / "README.md").read_text(encoding="utf-8")


def test_the_page_is_that_of_the_table() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m lab.site.coverage"


def test_every_entry_of_the_inventory_has_one_row() -> None:
    wanted = {f"{family}{n:02d}" for family, count in INVENTORY.items() for n in range(1, count + 1)}
    found = Counter(row.id for row in rows())
    assert wanted == set(found) and set(found.values()) == {1}


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.id)
def test_code_test_and_result_of_an_entry_exist_or_a_reason_is_given(row: InventoryEntry) -> None:
    for path in filter(None, (row.code, row.test)):
        assert (ROOT / path).exists(), path
    assert bool(row.code) == bool(row.test)
    assert not row.result or re.search(rf"^## {row.result}$", RESULTS, re.MULTILINE), row.result
    assert row.code or row.reason


def test_a_remark_leaves_an_entry_done_and_a_reservation_does_not() -> None:
    row = InventoryEntry("A01", "what", "code", "test", "", "")
    assert row.state == "done" == row._replace(reason="note: as asked").state
    assert row._replace(reason="one lane only").state == "in part"
    assert row._replace(code="", test="", reason="left out").state == "open"


CITED = {*(98, 99, 100, 104, 140), *range(108, 128), *(137, 138, 139, 141)}
"""References of N12 in the review."""


def test_every_design_that_the_review_cites_is_taken_or_declined_with_a_reason() -> None:
    text = (ROOT / "docs" / "techniques.md").read_text(encoding="utf-8")
    table = text.partition("(inventory N12)")[2]
    rows = [line.strip("|").split("|") for line in table.splitlines() if re.match(r"\| .*\[\d+\]", line)]
    named = [int(number) for cells in rows for number in re.findall(r"\[(\d+)\]", cells[1])]
    assert sorted(named) == sorted(CITED) and all(cells[2].strip() and cells[3].strip() for cells in rows)
