"""The tables of the live page: one of the drives in turns, one of the browser, each with columns of its own."""

import pytest

from lab.bench.live import page
from lab.bench.text import columns_of, grids, singles


def row(p99_ms: float, cpu_percent: float) -> page.Row:
    return {
        "latency_ms": {"frame_to_command": {"p99": p99_ms}},
        "processes": {"page": {"cpu_percent": cpu_percent}},
    }


def test_drives_and_browser_are_two_tables_in_which_every_cell_has_a_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        page, "drive_with_page", lambda *, viewed: row(22.0, 9.0) if viewed else row(20.0, 1.0)
    )
    monkeypatch.setattr(page, "browse", lambda: {"pictures": 149, page.SHARE: 7.9})
    measured = page.bench_page()
    assert singles(measured) == {"p99 with a viewer, relative to without": 1.1}
    tables = dict(grids(measured))
    assert [list(rows) for rows in tables.values()] == [[page.ALONE, page.VIEWED], ["Chromium"]]
    for rows in tables.values():
        assert all(set(cells) == set(columns_of(rows)) for cells in rows.values())


def test_the_ratio_is_that_of_drives_next_to_each_other() -> None:
    arms = {page.ALONE: [row(10.0, 1.0), row(40.0, 3.0), row(20.0, 2.0)]}
    arms[page.VIEWED] = [row(11.0, 8.0), row(44.0, 9.0), row(30.0, 7.0)]
    found = page.compare_arms(arms)
    assert found["p99 with a viewer, relative to without"] == 1.1
    assert found["drives in turns"][page.ALONE] == {page.SHARE: 2.0, "frame to command, p99 [ms]": 20.0}
