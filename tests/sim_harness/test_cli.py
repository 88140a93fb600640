"""The ``sim`` verbs: their output, its stream, and the exit codes."""

import json

import cv2
import numpy as np
import pytest

from sim_harness.cli import app, scenario_text
from sim_harness.scenarios.scenario import list_scenarios
from trepid.config import InputError

SHORT = """\
description: half a second of the straight
tags: [nominal]
road: straight
duration_s: 0.5
estimators: [cv]
expect: {must_stand: true}
"""


def sim(*arguments):
    return app([str(argument) for argument in arguments], standalone_mode=False)


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(SHORT)
    return path


def test_list_prints_one_json_line_per_scenario(capsys):
    assert sim("list", "--json") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert all(list(row) == ["name", "tags", "description", "duration_s"] for row in rows)
    assert {"circuit", "straight"} <= {row["name"] for row in rows}


def test_list_keeps_to_a_tag(capsys):
    assert sim("list", "--tag", "traffic", "--json") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows and all("traffic" in row["tags"] for row in rows)


def test_a_scenario_of_a_user_may_have_a_tag_of_its_own(capsys, tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text(SHORT.replace("[nominal]", "[nominal, campus-loop]"))
    assert sim("list", own, "--tag", "campus-loop", "--json") == 0
    assert json.loads(capsys.readouterr().out)["tags"] == ["nominal", "campus-loop"]
    own.write_text(SHORT.replace("[nominal]", "[Campus Loop]"))
    with pytest.raises(InputError, match=r"own.yaml:2:8: tags.0: .*pattern"):
        sim("list", own)


def test_list_prints_one_line_per_scenario_with_its_whole_description(capsys):
    assert sim("list") == 0
    lines = capsys.readouterr().out.splitlines()
    for line, scenario in zip(lines, list_scenarios(), strict=True):
        assert line.split()[0] == scenario.name and line.endswith(scenario.description)


@pytest.mark.parametrize("width", [60, 80, 200])
def test_a_terminal_shows_whole_descriptions_within_its_width(width):
    for scenario in list_scenarios():
        lines = scenario_text(scenario, width).splitlines()
        assert max(map(len, lines)) <= width
        assert " ".join(" ".join(lines).split()).endswith(" ".join(scenario.description.split()))


def test_list_of_a_name_prints_its_whole_description(capsys):
    assert sim("list", "straight") == 0
    (scenario,) = [scenario for scenario in list_scenarios() if scenario.name == "straight"]
    out = capsys.readouterr().out
    assert scenario.description in out
    assert len(out.splitlines()) == 1


def test_run_prints_json_lines_on_stdout_and_progress_on_stderr(short, capsys):
    assert sim("run", short, "--seed", 7, "--seeds", 2, "--json") == 0
    out, err = capsys.readouterr()
    rows = [json.loads(line) for line in out.splitlines()]
    assert [(row["scenario"], row["seed"], row["status"]) for row in rows] == [
        ("short", 7, "passed"),
        ("short", 8, "passed"),
    ]
    assert "[2/2] short seed 8: passed" in err


def test_a_failed_run_is_exit_code_1_with_its_reason(short, capsys):
    assert sim("run", short, "--set", "expect.must_finish=true") == 1
    assert "the route was not driven to its end" in capsys.readouterr().out


def test_trace_and_picture_are_saved_at_the_given_places(short, tmp_path, capsys):
    files = ("--trace", tmp_path / "run.npz", "--picture", tmp_path / "run.png")
    assert sim("run", short, *files, "--json") == 0
    assert cv2.imread(str(tmp_path / "run.png")).shape[1] > 1000
    with np.load(tmp_path / "run.npz") as saved:
        assert saved["t_s"][-1] == pytest.approx(0.5)
    assert json.loads(capsys.readouterr().out)["duration_s"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "circus"], "no scenario 'circus'"),
        (["run", "straight", "--set", "duration_s"], "--set duration_s: expected KEY=VALUE"),
        (["run", "straight", "--set", "lane_width_m=16"], "--set lane_width_m: lane_width_m: .*less than"),
        (["run", "straight", "circuit", "--trace", "x.npz"], "x.npz: can hold one run, not 2"),
        (["run", "straight", "--picture", "/no/such/folder/x.png"], "there is no folder /no/such/folder"),
    ],
)
def test_bad_input_is_refused_before_anything_runs(arguments, message):
    with pytest.raises(InputError, match=message):
        sim(*arguments)
