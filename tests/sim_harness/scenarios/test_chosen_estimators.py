"""Driving networks in scenarios, chosen on the command line or named in the file."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from driving_network_rig import write_network

from drive.open_road import networks_of
from sim_harness.cli import run_verb
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.sweep.plan import case_key
from trepid.config import InputError


@pytest.fixture
def turn(tmp_path: Path) -> Path:
    return write_network(tmp_path / "turn.onnx")


def test_a_driving_network_and_a_name_replace_the_estimators_of_a_scenario(turn):
    scenario = load_scenario("straight", changes_of(["cv", str(turn)]))
    assert scenario.estimators == ("cv", "turn") and scenario.networks == {"turn": str(turn)}
    assert load_scenario("straight", changes_of(None)) == load_scenario("straight")


def test_a_scenario_names_networks_relative_to_its_own_folder(turn):
    text = "description: d\ntags: [nominal]\nroad: straight\nduration_s: 1\nestimators: [cv, mine]\n"
    path = turn.parent / "s.yaml"
    path.write_text(text + "networks: {mine: turn.onnx}\n")
    assert load_scenario(str(path)).networks == {"mine": str(turn)}
    path.write_text(text.replace("mine", "cnn") + "networks: {mine: turn.onnx}\n")
    with pytest.raises(InputError, match=r"s\.yaml:6:\d+: networks\.mine: no estimator .* called 'mine'"):
        load_scenario(str(path))


def test_results_of_other_weights_under_the_same_name_are_other_cases(turn):
    scenario = load_scenario("straight", changes_of([str(turn)]))
    case = Case(scenario=scenario, index=0, seed=0, parameters={})
    before = case_key(case)
    assert case_key(replace(case, index=1)) == before
    write_network(turn, gain_rad=0.5)
    assert case_key(case) != before


def test_a_broken_network_is_refused_before_the_first_run(turn):
    turn.write_bytes(turn.read_bytes()[:500])
    with pytest.raises(InputError, match=r"turn\.onnx: not an ONNX network"):
        check_configuration([load_scenario("straight", changes_of([str(turn)]))])


def test_a_missing_network_is_refused_and_a_wrong_name_too():
    assert networks_of(["cv"]) == {"cv": None}
    with pytest.raises(InputError, match=r"networks\.nowhere: no file .*nowhere\.onnx"):
        load_scenario("straight", changes_of(["nowhere.onnx"]))
    with pytest.raises(InputError, match="another estimator"):
        networks_of(["cnn.onnx"])


def test_the_harness_drives_with_a_network_alone_by_its_angle(turn, capsys):
    run_verb(["straight"], settings=["duration_s=4"], chosen=[str(turn)], as_json=True)
    row = json.loads(capsys.readouterr().out)
    assert row["distance_m"] > 0.1 and row["modes"]["STOP"] < 2.5
