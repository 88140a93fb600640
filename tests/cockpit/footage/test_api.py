"""The Python interface of the estimators."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from cockpit.footage.api import in_car
from trepid.config import CAR, car_folder, using_car


@pytest.fixture(autouse=True)
def no_car(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CAR, raising=False)


def cars_of(folder: Path) -> Iterator[Path | None]:
    """The car in use before, within and after a recording of the car in ``folder``."""
    yield car_folder()
    with using_car(folder):
        yield car_folder()
        yield car_folder()
    yield car_folder()


def test_the_car_of_a_recording_is_in_use_inside_and_that_of_the_caller_between_two_frames(
    tmp_path: Path,
) -> None:
    inside, between = [], []
    for one in in_car(None, cars_of(tmp_path)):
        inside.append(one)
        between.append(car_folder())
    assert inside == [None, tmp_path, tmp_path, None] and between == [None] * 4


def test_two_drives_that_are_read_in_turn_keep_their_own_cars(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    pairs = list(zip(in_car(None, cars_of(first)), in_car(None, cars_of(second)), strict=True))
    assert pairs[1:3] == [(first, second)] * 2 and car_folder() is None


def test_a_reading_that_is_given_up_leaves_the_car_of_the_caller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = in_car(None, cars_of(tmp_path))
    next(found)
    next(found)
    monkeypatch.setenv(CAR, str(tmp_path.parent))
    found.close()  # type: ignore[attr-defined]
    assert car_folder() == tmp_path.parent
