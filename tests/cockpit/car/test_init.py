"""``trepid init`` writes the folder of a car: every field as a comment, those of the template active."""

import re
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from cockpit.car.init import FILES, Like, merge, template_files, write_car
from trepid.car.vehicle import Vehicle
from trepid.cli import main
from trepid.config import CAR, CONFIG_DIR, WHOLE_FILES, load, read, use_car

FIELD_FILES = [name for name in FILES if name not in WHOLE_FILES and (CONFIG_DIR / name).is_file()]
PLAIN = YAML(typ="safe")

DEFAULT = """\
# What the file is.
a_m: 1.0   # a metre
block:
  b_s: 2.0
  c_s: 3.0  # three seconds
  # of the next

# The list.
items:
  - {x: 1}
  - {x: 2}
"""


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, "")  # restored after the test
    return tmp_path / "mycar"


def uncomment(text: str) -> str:
    """The text after every edit that the header invites to."""
    return re.sub(r"(?m)^#(?=\s*(?:[\w.\"'-]+\s*:|- |[}\]]))(?! )|^#(?=  )", "", text)


def test_every_field_becomes_a_comment() -> None:
    text = merge(DEFAULT, "")
    assert PLAIN.load(text) is None
    assert "#a_m: 1.0   # a metre" in text
    assert PLAIN.load(uncomment(text)) == PLAIN.load(DEFAULT)


def test_a_field_of_the_template_stands_active_below_its_default() -> None:
    text = merge(DEFAULT, "# mine\na_m: 5.0  # measured\n")
    assert "#a_m: 1.0   # a metre\na_m: 5.0  # measured\n" in text
    assert PLAIN.load(text) == {"a_m": 5.0}


def test_a_field_in_a_block_leaves_the_others_of_the_block_comments() -> None:
    text = merge(DEFAULT, "block:\n  c_s: 9.0\n  new_s: 1.0\n")
    assert PLAIN.load(text) == {"block": {"c_s": 9.0, "new_s": 1.0}}
    assert "#  b_s: 2.0" in text and "#  c_s: 3.0  # three seconds" in text


def test_a_list_is_replaced_as_a_whole_and_a_new_field_is_kept() -> None:
    text = merge(DEFAULT, "items:\n  - {x: 7}\nfurther: [1]\n")
    assert PLAIN.load(text) == {"items": [{"x": 7}], "further": [1]}


@pytest.mark.parametrize("like", list(Like))
def test_a_new_car_is_that_of_its_template_on_the_defaults(like: Like, car: Path) -> None:
    write_car(car, like)
    own = template_files(like)
    assert own, "the template is not empty"
    for name in FIELD_FILES:
        given = PLAIN.load(own[name].read_text()) if name in own else None
        assert PLAIN.load((car / name).read_text()) == given, name
    use_car(car)
    assert load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m > 0


@pytest.mark.parametrize("name", FIELD_FILES)
def test_a_file_of_a_new_car_shows_every_field_with_its_default(name: str, car: Path) -> None:
    write_car(car, Like.SIM)
    text = (car / name).read_text()
    for line in (CONFIG_DIR / name).read_text().splitlines():
        assert line in text if line.lstrip().startswith("#") else f"#{line}" in text or not line.strip()


def test_a_car_without_changes_has_the_settings_of_the_defaults(car: Path) -> None:
    before = {name: read(CONFIG_DIR / name) for name in FIELD_FILES if name != "drive.yaml"}
    write_car(car, Like.SIM)
    use_car(car)
    assert {name: read(CONFIG_DIR / name) for name in before} == before


def test_an_uncommented_field_takes_effect(car: Path) -> None:
    write_car(car, Like.SIM)
    text = (car / "vehicle.yaml").read_text()
    (car / "vehicle.yaml").write_text(text.replace("#wheelbase_m: 1.75", "wheelbase_m: 2.25"))
    use_car(car)
    assert load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m == 2.25


def run(*words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["trepid", *words])
    return main()


def test_the_verb_says_what_comes_next(
    car: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("init", str(car), "--like", "shuttle", monkeypatch=monkeypatch) == 0
    assert f"trepid doctor --car {car}" in capsys.readouterr().out
    assert (car / "vehicle.yaml").is_file()


@pytest.mark.parametrize("taken", ["a file in it", "a file"])
def test_what_exists_is_never_overwritten(
    taken: str, car: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = car / "notes.txt" if taken == "a file in it" else car
    mine.parent.mkdir(exist_ok=True)
    mine.write_text("mine")
    assert run("init", str(car), "--like", "sim", monkeypatch=monkeypatch) == 2
    assert f"{car}: exists and is not an empty folder" in capsys.readouterr().err
    assert mine.read_text() == "mine"


def test_an_unknown_template_is_refused(
    car: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("init", str(car), "--like", "boat", monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert "'boat'" in error and "shuttle" in error
    assert not car.exists()
