"""Scenarios and roads of the car are found by name, and its files count for stored results."""

import json
from pathlib import Path

import pytest

from sim_harness.sweep.fingerprint import fingerprint
from trepid.cli import app
from trepid.config import CAR, CONFIG_DIR, car_folder, default_names, use_car

ROAD = (CONFIG_DIR / "roads" / "straight.yaml").read_text()
SCENARIO = "description: of this car\ntags: [nominal]\nroad: yard\nduration_s: 1\n"


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scenario and a road of its own; the environment is as before after the test."""
    monkeypatch.setenv(CAR, "")
    folder = tmp_path / "car"
    for name in ("scenarios", "roads"):
        (folder / name).mkdir(parents=True)
    (folder / "roads" / "yard.yaml").write_text(ROAD)
    (folder / "scenarios" / "yard.yaml").write_text(SCENARIO)
    return folder


def test_a_scenario_of_the_car_is_found_by_name(car: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app(["sim", "list", "yard", "--json", "--car", str(car)], standalone_mode=False) == 0
    assert car_folder() == car.resolve()
    assert json.loads(capsys.readouterr().out)["description"] == "of this car"


def test_the_names_of_a_folder_are_those_of_the_defaults_and_of_the_car(car: Path) -> None:
    before = default_names("roads")
    use_car(car)
    try:
        assert default_names("roads") == sorted([*before, "yard"])
    finally:
        use_car(None)


def test_the_fingerprint_of_the_code_covers_the_files_of_the_car(
    car: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without = fingerprint("trepid/bounds.py")
    monkeypatch.setenv(CAR, str(car))
    assert fingerprint("trepid/bounds.py") != without
