"""The folder of a car overrides the defaults field by field, and errors name the file that holds the field."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest
from pydantic import ConfigDict

from trepid.car.vehicle import Vehicle
from trepid.config import (
    CAR,
    CONFIG_DIR,
    InputError,
    Settings,
    default_file,
    load,
    parse_overrides,
    read,
    resource,
    use_car,
)

VEHICLE = CONFIG_DIR / "vehicle.yaml"


class RenamedSection(Settings):
    """A section of ``supervisor.yaml`` with a former name."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    former_names: ClassVar = {"sightings": ("validation",)}
    validation: dict[str, Any]


@pytest.fixture
def car(tmp_path: Path) -> Iterator[Path]:
    before = os.environ.get(CAR)
    use_car(tmp_path)
    yield tmp_path
    os.environ.pop(CAR)
    if before is not None:
        os.environ[CAR] = before


def write(car: Path, text: str) -> None:
    (car / "vehicle.yaml").write_text(text)


def test_a_field_of_the_car_overrides_that_field_alone(car: Path) -> None:
    default = load(VEHICLE, Vehicle)
    write(car, "wheelbase_m: 2.9\n")
    assert load(VEHICLE, Vehicle) == default.model_copy(update={"wheelbase_m": 2.9})


def test_a_file_outside_the_defaults_is_not_overridden(
    car: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    write(car, "wheelbase_m: 2.9\n")
    mine = tmp_path_factory.mktemp("mine") / "vehicle.yaml"
    mine.write_text(VEHICLE.read_text())
    assert load(mine, Vehicle).wheelbase_m == 1.75


def test_null_removes_a_field_of_the_default(car: Path) -> None:
    write(
        car,
        "understeer_gradient_rad_per_mps2: null\n"
        "chassis: {mass_kg: 900, cg_to_front_m: 0.8, front_stiffness_nprad: 8e4, rear_stiffness_nprad: 9e4}\n",
    )
    assert load(VEHICLE, Vehicle).chassis is not None


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("# mine\nsteering_ratio: -1\n", "{car}/vehicle.yaml:2:1: steering_ratio"),
        (
            "wheelbase: 2.9\n",
            "{car}/vehicle.yaml:1:1: unknown field 'wheelbase'; did you mean 'wheelbase_m'?",
        ),
        ("chassis: {mass_kg: 1}\n", "{car}/vehicle.yaml:1:1: 'chassis.cg_to_front_m' is missing"),
    ],
)
def test_an_error_in_a_field_of_the_car_is_located_in_its_file(car: Path, text: str, where: str) -> None:
    write(car, text)
    with pytest.raises(InputError) as error:
        load(VEHICLE, Vehicle)
    assert str(error.value).startswith(where.format(car=car))


def test_an_error_in_the_defaults_is_located_there(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(car, "wheelbase_m: 2.9\n")
    bad = VEHICLE.read_text().replace("steering_ratio: 16.0", "steering_ratio: 0")
    monkeypatch.setattr("trepid.config.read_text", lambda path: bad if path == VEHICLE else path.read_text())
    with pytest.raises(InputError, match=rf"^{VEHICLE}:\d+:1: steering_ratio"):
        load(VEHICLE, Vehicle)


def test_set_overrides_the_car(car: Path) -> None:
    write(car, "wheelbase_m: 2.9\n")
    assert load(VEHICLE, Vehicle, overrides=parse_overrides(["wheelbase_m=3.1"])).wheelbase_m == 3.1


def test_a_change_of_the_cars_file_is_read(car: Path) -> None:
    for wheelbase_m in (2.9, 3.0):
        write(car, f"wheelbase_m: {wheelbase_m}\n")
        assert load(VEHICLE, Vehicle).wheelbase_m == wheelbase_m


def test_rules_and_files_in_folders_are_replaced_as_a_whole(car: Path) -> None:
    assert default_file("fear.yaml") == CONFIG_DIR / "fear.yaml"
    (car / "fear.yaml").write_text("a: 1\n")
    (car / "roads").mkdir()
    (car / "roads" / "town.yaml").write_text("b: 2\n")
    assert default_file("fear.yaml") == car / "fear.yaml"
    assert default_file("roads/town.yaml") == car / "roads" / "town.yaml"
    assert "inputs" in read(CONFIG_DIR / "fear.yaml")


def test_a_resource_of_the_car_replaces_the_shipped_one(car: Path) -> None:
    weights = Path("perception/weights/steer_net.onnx")
    assert resource(weights).exists()
    (car / weights).parent.mkdir(parents=True)
    (car / weights).touch()
    assert resource(weights) == car / weights


def test_a_file_that_overrides_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "vehcile.yaml").write_text("wheelbase_m: 2.9\n")
    with pytest.raises(InputError, match=r"vehcile\.yaml: overrides no file of the defaults; did you mean"):
        use_car(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        use_car(tmp_path / "missing")


def test_processes_started_later_use_the_car(car: Path) -> None:
    write(car, "wheelbase_m: 2.9\n")
    code = (
        "from trepid.config import CONFIG_DIR, load; from trepid.car.vehicle import Vehicle;"
        "print(load(CONFIG_DIR / 'vehicle.yaml', Vehicle).wheelbase_m)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "2.9"


def test_a_section_under_its_former_name_overrides_its_fields_alone(
    car: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = CONFIG_DIR / "supervisor.yaml"
    default = load(settings, RenamedSection).validation
    (car / "supervisor.yaml").write_text("sightings: {fresh_s: 0.2}\n")
    assert load(settings, RenamedSection).validation == {**default, "fresh_s": 0.2}
    assert "the setting sightings is now validation" in capsys.readouterr().err
