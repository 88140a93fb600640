"""``trepid vehicle steer`` on the command line."""

import json
import math

import pytest
from typer.testing import CliRunner

from cockpit.calibration.vehicle_cli import app
from trepid.config import InputError


def steer(*arguments):
    return CliRunner().invoke(app, ["steer", *arguments])


def test_the_angles_are_those_of_the_equation_and_of_nothing_else():
    arguments = "--curvature 0.02 --speed 10 --roll 0.01 --set understeer_gradient_rad_per_mps2=0.004 --json"
    result = steer(*arguments.split())
    angles = json.loads(result.stdout)
    understeer = 0.004 * (0.02 * 100 + 9.80665 * 0.01)
    assert angles == {
        "road_wheel_angle_rad": pytest.approx(math.atan(1.75 * 0.02) + understeer, abs=1e-15),
        "steering_wheel_angle_deg": pytest.approx(16 * math.degrees(math.atan(0.035) + understeer)),
        "kinematic_road_wheel_angle_rad": pytest.approx(math.atan(0.035), abs=1e-15),
        "understeer_rad": pytest.approx(understeer, abs=1e-15),
    }
    assert result.stderr == ""


def test_without_json_it_prints_a_line_per_angle_and_warns_beyond_the_stop():
    result = steer("--curvature", "1.0", "--speed", "0")
    assert [line.split()[0] for line in result.stdout.splitlines()] == [
        "road_wheel_angle_rad",
        "steering_wheel_angle_deg",
        "kinematic_road_wheel_angle_rad",
        "understeer_rad",
    ]
    assert "larger than the largest road-wheel angle" in result.stderr


@pytest.mark.parametrize(
    "arguments,message",
    [
        (["--curvature", "nan"], "--curvature: expected a finite number"),
        (["--speed", "inf"], "--speed: expected a finite number"),
        (["--speed", "1e200"], "too large"),
        (["--vehicle", "no-such.yaml"], "no-such.yaml: cannot be read"),
        (["--set", "wheelbas_m=2"], "did you mean 'wheelbase_m'"),
        (["--set", "wheelbase_m"], "expected KEY=VALUE"),
        (["--set", "wheelbase_m=-1"], "greater than 0"),
    ],
)
def test_bad_input_is_refused_with_a_reason(arguments, message):
    given = dict(zip(["--curvature", "--speed"], ["0.1", "5"], strict=True))
    flat = [part for pair in given.items() if pair[0] not in arguments for part in pair]
    error = steer(*flat, *arguments).exception
    assert isinstance(error, InputError)
    assert message in str(error)


def test_the_steering_loop_has_the_demanded_margins_at_every_speed():
    rows = json.loads(CliRunner().invoke(app, ["margins", "--set", "steering_delay_s=0.2", "--json"]).stdout)
    assert [row["speed_mps"] for row in rows] == sorted(row["speed_mps"] for row in rows)
    for row in rows:
        assert row["gain_margin_db"] is None or row["gain_margin_db"] >= 6.0
        assert row["phase_margin_deg"] >= 44.9
        assert row["delay_margin_s"] >= 0.05
    table = CliRunner().invoke(app, ["margins"]).stdout.splitlines()
    assert len(table) == len(rows) + 1


def test_the_margins_are_drawn(tmp_path):
    path = tmp_path / "margins.png"
    assert CliRunner().invoke(app, ["margins", "--picture", str(path)]).exit_code == 0
    assert path.read_bytes().startswith(b"\x89PNG")


def test_no_number_is_a_negative_zero():
    assert "-0.000000" not in steer("--curvature", "-0.0", "--speed", "5").output
