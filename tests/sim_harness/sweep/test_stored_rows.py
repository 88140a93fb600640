"""Rows of a long benchmark: computed once, stored one by one, and valid only for the code that computed them."""

import json
import multiprocessing
import os
import random
import signal
import time
from pathlib import Path

import pytest

from sim_harness.sweep import store as module
from sim_harness.sweep.pool import WorkerLost
from sim_harness.sweep.store import Store, stored_rows
from trepid.config import InputError

TASKS = {"one": 1, "two": 2, "three": 3}


def square(number: int) -> dict[str, object]:
    return {"square": number**2}


def square_unless_two(number: int) -> dict[str, object]:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


def square_slowly(number: int) -> dict[str, object]:
    time.sleep(0.005)
    return square(number)


def refuse(number: int) -> dict[str, object]:
    raise AssertionError(f"{number} is stored")


def test_rows_have_the_order_of_the_tasks_and_are_stored(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    assert [row["square"] for row in stored_rows(path, square, TASKS)] == [1, 4, 9]
    assert {json.loads(line)["case"] for line in path.read_text().splitlines()} == TASKS.keys()


def test_stored_rows_are_not_computed_again_and_further_tasks_are_added(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    before = stored_rows(path, square, TASKS)
    assert stored_rows(path, refuse, TASKS) == before
    path.write_text(path.read_text() + '{"case": "four", "co')  # half a line, as a killed writer leaves it
    assert [row["square"] for row in stored_rows(path, square, TASKS | {"four": 4})] == [1, 4, 9, 16]


def test_rows_of_other_code_are_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rows.jsonl"
    stored_rows(path, square, TASKS)
    monkeypatch.setattr(module, "fingerprint", lambda: "another")
    assert [row["square"] for row in stored_rows(path, square, TASKS)] == [1, 4, 9]
    assert len(path.read_text().splitlines()) == 2 * len(TASKS)


def test_a_killed_worker_loses_one_row_and_a_second_call_computes_it(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with pytest.raises(
        WorkerLost, match="1 cases have no result, first two: its process was killed by SIGKILL"
    ):
        stored_rows(path, square_unless_two, TASKS)
    assert len(path.read_text().splitlines()) == 2
    assert [row["square"] for row in stored_rows(path, square, TASKS)] == [1, 4, 9]


@pytest.mark.long
def test_a_study_killed_at_20_random_moments_loses_no_row_and_has_none_twice(tmp_path: Path) -> None:
    tasks = {f"{number} {'x' * 2000}": number for number in range(40)}
    began_s = time.monotonic()
    whole = stored_rows(tmp_path / "whole.jsonl", square_slowly, tasks, jobs=1)
    lasted_s = time.monotonic() - began_s
    moments, cut_short = random.Random(20), 0
    for kill in range(20):
        path = tmp_path / f"{kill}.jsonl"
        study = multiprocessing.get_context("fork").Process(
            target=stored_rows, args=(path, square_slowly, tasks), kwargs={"jobs": 1}
        )
        study.start()
        study.join(moments.uniform(0.0, lasted_s))
        study.kill()
        study.join()
        kept = path.read_bytes().rpartition(b"\n")[0] if path.is_file() else b""
        cut_short += 0 < len(kept.splitlines()) < len(tasks)
        assert stored_rows(path, square_slowly, tasks, jobs=1) == whole, f"kill {kill}"
        found = path.read_bytes()
        cases = [json.loads(line)["case"] for line in found.splitlines()]
        assert found.startswith(kept) and sorted(cases) == sorted(tasks), f"kill {kill}"
    assert cut_short > 0


def test_a_file_in_use_or_with_other_content_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with Store(path), pytest.raises(InputError, match="another sweep is writing"):
        stored_rows(path, square, TASKS)
    path.write_text('{"square": 1}\n')
    with pytest.raises(InputError, match=r"rows\.jsonl:1: not a result"):
        stored_rows(path, square, TASKS)
