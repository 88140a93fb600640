"""Bad configuration is one error with its place before a run starts."""

import re

import pytest

import controller.controller
import sim_harness.lockstep.closed_loop
import supervisor.supervisor
from drive import cli
from sim_harness.cli import app
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid.config import CONFIG_DIR, InputError

SCENARIO = Scenario(description="", tags=("nominal",), road="straight", duration_s=1.0, sight="truth")


@pytest.fixture
def bad_supervisor(tmp_path, monkeypatch):
    """The place of a misspelt cause in the file of the supervisor."""
    text = (CONFIG_DIR / "supervisor.yaml").read_text()
    file = tmp_path / "supervisor.yaml"
    file.write_text(text.replace("    unconfirmed:", "    unconfimed:", 1))
    monkeypatch.setitem(supervisor.supervisor.build.__kwdefaults__, "settings", file)
    line = text[: text.index("    unconfirmed:")].count("\n") + 1
    return f"{file}:{line}:5: "


def test_the_configuration_of_the_repository_is_valid():
    check_configuration([SCENARIO, load_scenario("straight")])


def test_sim_run_refuses_a_bad_file_of_the_supervisor_before_the_first_run(bad_supervisor, capsys):
    with pytest.raises(InputError, match=f"^{re.escape(bad_supervisor)}.*did you mean 'unconfirmed'"):
        app(["run", "straight", "--set", "sight=truth"], standalone_mode=False)
    assert capsys.readouterr().out == ""


def test_sim_limits_refuses_a_bad_file_of_the_supervisor_before_the_first_run(bad_supervisor, monkeypatch):
    monkeypatch.setattr("sim_harness.cli.run", lambda *_, **__: pytest.fail("a case was run"))
    with pytest.raises(InputError, match=f"^{re.escape(bad_supervisor)}.*did you mean 'unconfirmed'"):
        app(["limits", "alks_left_r1000"], standalone_mode=False)


def test_drive_refuses_a_bad_file_of_the_supervisor_before_the_first_process(bad_supervisor, monkeypatch):
    monkeypatch.setattr("drive.launcher.Fleet", lambda *_, **__: pytest.fail("a process was started"))
    with pytest.raises(InputError, match=f"^{re.escape(bad_supervisor)}"):
        cli.drive(scenario="straight", duration=1.0, dashboard=False)


def test_a_bad_file_of_the_controller_is_refused_with_its_place(tmp_path, monkeypatch):
    text = (CONFIG_DIR / "controller.yaml").read_text()
    (tmp_path / "controller.yaml").write_text(f"{text}\nbogus: 1\n")
    (tmp_path / "vehicle.yaml").write_text((CONFIG_DIR / "vehicle.yaml").read_text())
    monkeypatch.setattr(controller.controller, "CONFIG_DIR", tmp_path)
    with pytest.raises(InputError, match=r"controller\.yaml:\d+:1: unknown field 'bogus'"):
        check_configuration([SCENARIO])


def test_a_bad_file_of_the_camera_is_refused_also_for_runs_without_images(tmp_path, monkeypatch):
    (tmp_path / "camera.yaml").write_text("bogus: 1\n")
    monkeypatch.setattr(sim_harness.lockstep.closed_loop, "CONFIG_DIR", tmp_path)
    with pytest.raises(InputError, match=r"camera\.yaml:1:1: unknown field 'bogus'"):
        check_configuration([SCENARIO])


@pytest.mark.parametrize(
    ("before", "after", "error"),
    [
        ("rules:", "rules: [", r"bad\.yaml:\d+:\d+: not valid YAML"),
        ("rules:", "rulse:", r"bad\.yaml:\d+:1: unknown field 'rulse'"),
        ("cv_confidence", "cv_confidense", r"bad\.yaml:\d+:3: inputs\.cv_confidense: unknown input"),
    ],
)
def test_a_bad_rule_file_of_a_scenario_is_refused_with_its_place(tmp_path, before, after, error):
    rules = tmp_path / "bad.yaml"
    rules.write_text((CONFIG_DIR / "fear.yaml").read_text().replace(before, after))
    with pytest.raises(InputError, match=error):
        check_configuration([SCENARIO.model_copy(update={"rules": str(rules)})])
