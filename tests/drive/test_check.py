"""The check of a real car in a process of its own."""

from pathlib import Path

import pytest

from cockpit.car.init import Like, write_car
from drive.check import check_car, check_car_apart
from drive.open_road import OpenRoad
from drive.plan import plan_processes
from trepid.config import CAR, InputError
from trepid.processes.settings import load_processes


@pytest.fixture
def shuttle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_car(tmp_path / "mycar", Like.SHUTTLE)
    monkeypatch.setenv(CAR, str(tmp_path / "mycar"))
    return tmp_path / "mycar"


def test_the_process_of_its_own_finds_what_the_check_finds(shuttle: Path) -> None:
    specs = plan_processes(load_processes(), OpenRoad())
    assert check_car_apart(specs) == check_car(specs)


def test_the_error_of_the_check_arrives_with_its_place(shuttle: Path) -> None:
    specs = plan_processes(load_processes(), OpenRoad())
    rules = shuttle / "fear.yaml"
    rules.write_text(rules.read_text().replace("\nrules:", "\nrulse:", 1))
    errors = []
    for check in (check_car, check_car_apart):
        with pytest.raises(InputError, match=r"mycar/fear\.yaml:\d+:1: unknown field 'rulse'") as caught:
            check(specs)
        errors.append(str(caught.value))
    assert errors[0] == errors[1]
