"""The store of rows: every whole line survives, one process writes, and each row belongs to its code."""

import pytest

from sim_harness.sweep.store import Store
from trepid.config import InputError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / "rows.jsonl"


def test_a_row_belongs_to_its_case_and_its_code(path):
    with Store(path) as store:
        store.add("a", "old", {"x": 1})
        store.add("a", "new", {"x": 2.5})
        assert store.get("a", "old") == {"x": 1}
    with Store(path) as store:
        assert (store.get("a", "old"), store.get("a", "new")) == ({"x": 1}, {"x": 2.5})
        assert store.get("a", "other") is store.get("b", "new") is None
        assert store.newest == {"a": {"case": "a", "code": "new", "x": 2.5}}


@pytest.mark.parametrize("kept", range(1, 24, 7))
def test_a_half_written_last_line_is_cut_off(path, kept):
    with Store(path) as store:
        store.add("a", "c", {"x": 1})
        store.add("b", "c", {"x": 2})
    whole, half = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(whole + half[:kept])
    with Store(path) as store:
        assert (store.get("a", "c"), store.get("b", "c")) == ({"x": 1}, None)
        store.add("c", "c", {"x": 3})
    with Store(path) as store:
        assert store.newest.keys() == {"a", "c"}


def test_one_process_at_a_time_writes_to_a_file(path):
    with Store(path), pytest.raises(InputError, match="another sweep is writing to it"):
        Store(path)
    with Store(path):
        pass


@pytest.mark.parametrize("text", ["nonsense\n", '{"a": 1}\n', "[]\n", "\n", '{"case": "a", "code": "c"}\n'])
def test_another_file_is_refused_with_its_line_and_stays_as_it_is(tmp_path, text):
    path = tmp_path / "notes.jsonl"
    path.write_text(text)
    for _ in range(2):  # the refused file is not left locked
        with pytest.raises(InputError, match=r"notes\.jsonl:1: not a result"):
            Store(path, fields={"x"})
    assert path.read_text() == text
