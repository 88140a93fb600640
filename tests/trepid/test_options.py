"""``--car DIR`` puts the folder of a car in use before the verb begins."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from trepid.cli import app, main
from trepid.config import CAR

WITH_CAR = [
    "drive",
    "estimate",
    "train",
    "train-lead",
    "camera calibrate",
    "camera import",
    "fear tune",
    "vehicle steer",
    "vehicle identify",
    "vehicle margins",
    "sim list",
    "sim run",
    "sim limits",
    "sim resimulate",
    "sim disturbances",
    "sim leads",
    "sim road show",
    "sim road export",
]
STEER = ["vehicle", "steer", "--curvature", "0.1", "--speed", "0", "--json"]


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, "")  # restored after the test
    (tmp_path / "vehicle.yaml").write_text("wheelbase_m: 2.0\n")
    return tmp_path


def command_of(verb: str) -> Any:
    command: Any = typer.main.get_command(app)
    for word in verb.split():
        command = command.commands[word]
    return command


@pytest.mark.parametrize("verb", WITH_CAR)
def test_a_verb_that_depends_on_the_settings_takes_a_car(verb: str) -> None:
    assert "--car" in [name for parameter in command_of(verb).params for name in parameter.opts]


def kinematic_rad() -> float:
    return float(json.loads(CliRunner().invoke(app, STEER).stdout)["kinematic_road_wheel_angle_rad"])


def test_the_settings_of_the_car_are_used(car: Path) -> None:
    default_rad = kinematic_rad()
    shown = CliRunner().invoke(app, [*STEER, "--car", str(car)])
    assert json.loads(shown.stdout)["kinematic_road_wheel_angle_rad"] == pytest.approx(0.19740, abs=1e-5)
    assert default_rad == pytest.approx(0.17324, abs=1e-5)
    assert os.environ[CAR] == str(car)


def test_the_variable_of_the_environment_has_the_same_effect(
    car: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(car))
    assert kinematic_rad() == pytest.approx(0.19740, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("vehicle.yaml", "wheelbase: 2.0\n", "vehicle.yaml:1:1: unknown field 'wheelbase'; did you mean 'wh"),
        ("vehicel.yaml", "a: 1\n", "vehicel.yaml: overrides no file of the defaults; did you mean 'vehicle."),
    ],
)
def test_a_wrong_file_or_field_is_one_line_with_the_nearest_name(
    name: str,
    text: str,
    line: str,
    car: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (car / name).write_text(text)
    monkeypatch.setattr(sys, "argv", ["trepid", *STEER, "--car", str(car)])
    code = main()
    error = capsys.readouterr().err
    assert (code, len(error.splitlines())) == (2, 1)
    assert f"{car}/{line}" in error


def test_a_folder_that_does_not_exist_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["trepid", *STEER, "--car", str(tmp_path / "none")])
    assert main() == 2
    assert "no such folder; `trepid init" in capsys.readouterr().err
