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
