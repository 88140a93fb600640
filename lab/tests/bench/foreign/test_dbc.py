"""The count of DBC files: a fault spoils its own message only, and layouts are compared with those of cantools."""

from pathlib import Path

from lab.bench.foreign import dbc
from lab.bench.foreign.dbc import COLUMNS, count_file

GOOD = 'BO_ 10 GOOD: 8 XXX\n SG_ A : 0|8@1+ (0.5,0) [0|0] "" XXX\n SG_ B : 15|8@0- (1,-4) [0|0] "" XXX\n\n'
MULTIPLEXED = (
    'BO_ 11 PARTS: 8 XXX\n SG_ S M : 0|8@1+ (1,0) [0|0] "" XXX\n SG_ C m0 : 8|8@1+ (1,0) [0|0] "" XXX\n'
    ' SG_ D m1 : 8|8@1+ (1,0) [0|0] "" XXX\n\n'
)
OVERLAP = 'BO_ 12 BAD: 8 XXX\n SG_ E : 0|8@1+ (1,0) [0|0] "" XXX\n SG_ F : 4|8@1+ (1,0) [0|0] "" XXX\n\n'


def counts(folder: Path, *messages: str) -> dict[str, int]:
    path = folder / "car.dbc"
    path.write_text('VERSION ""\n\nBU_: XXX\n\n' + "".join(messages))
    found = count_file(path)
    return {name: found[name] for name in COLUMNS}


def test_a_sound_file_is_usable_and_whole(tmp_path: Path) -> None:
    found = counts(tmp_path, GOOD, MULTIPLEXED)
    assert found == dict(
        files=1,
        by_cantools=1,
        by_cantools_unchecked=1,
        without_messages=0,
        usable=1,
        whole=1,
        messages=2,
        loaded=2,
        differ=0,
    )


def test_a_file_with_one_bad_message_is_usable_and_not_whole(tmp_path: Path) -> None:
    found = counts(tmp_path, GOOD, OVERLAP)
    assert (found["by_cantools"], found["by_cantools_unchecked"]) == (0, 1)
    assert (found["usable"], found["whole"], found["messages"], found["loaded"]) == (1, 0, 2, 1)


def test_a_layout_other_than_that_of_cantools_is_counted(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(dbc, "_layout_of", lambda file, name: {})
    assert counts(tmp_path, GOOD)["differ"] == 1


def test_a_file_without_messages_is_none_that_loads(tmp_path: Path) -> None:
    found = counts(tmp_path)
    assert (found["without_messages"], found["usable"], found["whole"]) == (1, 0, 0)
