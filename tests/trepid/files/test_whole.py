"""Files that are written whole or not at all."""

import pytest

from trepid.files.whole import replacing, write_whole


def test_a_file_is_replaced_by_its_new_content_and_nothing_is_left_beside_it(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b"old")
    write_whole(path, b"new")
    assert path.read_bytes() == b"new" and [*tmp_path.iterdir()] == [path]


def test_an_error_while_writing_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="half"), replacing(path) as fresh:
        fresh.write_bytes(b"ha")
        raise ValueError("half")
    assert path.read_bytes() == b"old" and [*tmp_path.iterdir()] == [path]
