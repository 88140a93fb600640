"""Rows of a long bench: worked out once, kept at once, and only good for the code that made them."""

import json
from pathlib import Path

import pytest

from sim_harness.sweep import kept
from sim_harness.sweep.kept import kept_rows
from trepid.config import InputError

TASKS = {"one": 1, "two": 2, "three": 3}


def square(number: int) -> dict[str, object]:
    return {"square": number**2}


def refuse(number: int) -> dict[str, object]:
    raise AssertionError(f"{number} is on file")


def test_rows_come_in_the_order_of_the_tasks_and_are_on_file(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    assert [row["square"] for row in kept_rows(path, square, TASKS)] == [1, 4, 9]
    assert {json.loads(line)["case"] for line in path.read_text().splitlines()} == TASKS.keys()


def test_what_is_on_file_is_not_done_again_and_more_tasks_add_to_it(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    before = kept_rows(path, square, TASKS)
    assert kept_rows(path, refuse, TASKS) == before
    path.write_text(path.read_text() + '{"case": "four", "co')  # killed while it wrote
    assert [row["square"] for row in kept_rows(path, square, TASKS | {"four": 4})] == [1, 4, 9, 16]


def test_rows_of_other_code_are_done_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rows.jsonl"
    kept_rows(path, square, TASKS)
    monkeypatch.setattr(kept, "fingerprint", lambda: "another")
    assert {row["code"] for row in kept_rows(path, square, TASKS)} == {"another"}
    assert len(path.read_text().splitlines()) == 2 * len(TASKS)


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"square": 1}\n')
    with pytest.raises(InputError, match=r"rows\.jsonl:1: not a result"):
        kept_rows(path, square, TASKS)
