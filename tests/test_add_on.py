"""A package of its own (examples/add_on) adds an estimator, a camera, an actuator, a plant, a world, an input."""

import json
from pathlib import Path

import pytest
from add_on_rig import FOLDER, car_with_rules, install_add_on, trepid

pytestmark = pytest.mark.long
DRIVE = ["--set", "estimators=[cv, mirrored_cv]", "--set", "plant.model=heavy", "--set", "duration_s=6"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install_add_on(tmp_path_factory.mktemp("add_on"))


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return car_with_rules(tmp_path_factory.mktemp("with_rules"), parts=False)


def test_the_car_drives_with_an_estimator_a_plant_and_an_input_of_the_package(site: Path, car: Path) -> None:
    done = trepid("sim", "run", "straight", "--car", str(car), *DRIVE, "--json", site=site)
    row = json.loads(done.stdout)
    assert row["departures"] == 0 and row["distance_m"] > 1.0, done.stderr
    assert row["modes"]["KEEP"] > 3.0
    light = trepid("sim", "run", "straight", "--car", str(car), *DRIVE[:2], *DRIVE[4:], "--json", site=site)
    assert json.loads(light.stdout)["distance_m"] > 1.5 * row["distance_m"]  # than with the heavy plant


def test_the_car_drives_in_the_world_of_the_package(site: Path) -> None:
    ring = str(FOLDER / "ring.yaml")
    done = trepid("sim", "run", ring, "--set", "sight=truth", "--json", site=site)
    row = json.loads(done.stdout)
    assert (done.returncode, row["status"], row["departures"]) == (0, "passed", 0), done.stderr
    assert row["distance_m"] > 149.0
    missing = trepid("sim", "run", ring, site=None)
    assert missing.returncode == 2 and "unknown world 'ring'" in missing.stderr


def test_an_input_of_the_package_raises_fear_and_the_proofs_hold_for_it(site: Path, car: Path) -> None:
    rules = str(car / "fear.yaml")
    calm, doubtful = (
        json.loads(trepid("fear", "explain", rules, f"yaw_doubt={value}", "--json", site=site).stdout)
        for value in (0.0, 1.5)
    )
    assert calm["fear"] == 0.0
    assert doubtful["fear"] >= 0.7 and doubtful["cause"] == "yaw_doubt"
    assert trepid("fear", "check", rules, site=site).returncode == 0


def test_an_estimator_of_the_package_stands_in_the_list(site: Path) -> None:
    listed = trepid("estimate", "--estimator", "list", "--json", site=site).stdout.splitlines()
    rows = {row["estimator"]: row for row in map(json.loads, listed)}
    assert rows["mirrored_cv"]["source"] == "trepid_add_on.estimator:MirroredCv"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (DRIVE[:2], "no estimator 'mirrored_cv'"),
        (DRIVE[2:4], "unknown model 'heavy'; known here: kinematic"),
        ([], "inputs.yaw_doubt: unknown input"),
    ],
)
def test_without_the_package_each_part_is_refused_by_name(change: list[str], text: str, car: Path) -> None:
    done = trepid("sim", "run", "straight", "--car", str(car), *change, *DRIVE[4:], site=None)
    assert (done.returncode, done.stdout) == (2, "")
    assert text in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.processes
def test_processes_drive_with_the_camera_and_the_actuator_of_the_package(site: Path, tmp_path: Path) -> None:
    car = car_with_rules(tmp_path, parts=True)
    done = trepid("drive", "--car", str(car), "--duration", "8", "--no-dashboard", "--json", site=site)
    row = json.loads(done.stdout)
    assert {"camera", "vehicle", "mirrored_cv"} <= row["processes"].keys(), done.stderr
    assert not {"cnn", "ecu"} & row["processes"].keys()
    assert row["distance_m"] > 1.0, row
