"""Scenario files: their fields, and errors with their place."""

import textwrap

import pytest

from sim_harness.scenarios.scenario import (
    Scenario,
    list_scenarios,
    load_scenario,
    load_scenarios,
)
from sim_harness.world.plants.build import real_vehicle
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, ROOT, InputError, load

GOOD = """\
description: a test
tags: [nominal]
road: straight
duration_s: 10
"""


def write(tmp_path, text, name="mine.yaml"):
    path = tmp_path / name
    path.write_text(textwrap.dedent(text))
    return str(path)


def test_a_scenario_takes_its_name_from_its_file(tmp_path):
    assert load_scenario(write(tmp_path, GOOD)).name == "mine"
    assert load_scenario("circuit").name == "circuit"


@pytest.mark.parametrize(
    ("line", "where"),
    [
        ("duraton_s: 3", r"mine\.yaml:5:1: unknown field 'duraton_s'; did you mean 'duration_s'\?"),
        ("start: {offset: 1}", r"mine\.yaml:5:9: unknown field 'start\.offset'; did you mean 'offset_m'\?"),
        ("camera: {rate_hz: fast}", r"mine\.yaml:5:10: camera\.rate_hz: .*valid number"),
        (
            "faults: [{kind: frozen_camera}]",
            r"mine\.yaml:5:1?\d: 'faults\.0\.from_s' is missing",
        ),
        ("faults: [{kind: aliens, from_s: 1}]", r"mine\.yaml:5:\d+: .*aliens"),
        (
            "faults: [{kind: lost_process, process: gps, from_s: 1}]",
            "no process 'gps'; there are camera, cnn",
        ),
        ("segments: [{length_m: -1}]", r"mine\.yaml:5:\d+: segments\.0\.length_m: .*greater than 0"),
        ("lane_width_m: .nan", r"mine\.yaml:5:1: lane_width_m: .*finite"),
        ("tags: [", r"mine\.yaml:\d+:\d+: not valid YAML"),
    ],
)
def test_a_mistake_in_a_scenario_is_named_with_its_place(tmp_path, line, where):
    with pytest.raises(InputError, match=where):
        load_scenario(write(tmp_path, GOOD + line))


def test_a_missing_scenario_names_the_nearest_ones_and_the_command_that_lists_all():
    nearest = r"^no scenario 'circus'; did you mean 'circuit'\? `trepid sim list` prints all, or give"
    with pytest.raises(InputError, match=nearest):
        load_scenario("circus")
    with pytest.raises(InputError, match=r"^no scenario 'qqq'; `trepid sim list` prints all, or give"):
        load_scenario("qqq")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "segments: [{length_m: 9}, {length_m: 9, curvature_1pm: 0.1}]",
            r"mine\.yaml:5:1: segments: .*curvature jumps",
        ),
        ("plant: {vehicle: {wheelbase: 2}}", r"mine\.yaml:5:1: plant: .*wheelbase"),
        ("estimators: [lidar]", r"mine\.yaml:5:14: estimators\.0: no estimator 'lidar'; .*--estimator list"),
        (
            "sight: truth\nfaults: [{kind: black_frames, from_s: 1}]",
            r"mine\.yaml:6:10: faults\.0: black_frames: with sight: truth there is no image",
        ),
        (
            "expect: {conditions: [speed <= 9 m/s, speed <= 1 m/s within 2 s of black_frames]}",
            r"mine\.yaml:5:39: expect\.conditions\.1: .*nothing called 'black_frames' happens here",
        ),
        ("marks: [{kind: zebra, at_m: 5000}]", r"mine\.yaml:5:1: marks: .*beyond the road"),
        ("walls: [{side: left, from_m: 5, to_m: 5000}]", r"mine\.yaml:5:1: walls: .*beyond the road"),
        ("elevation: [{at_m: 5000, grade: 0.1}]", r"mine\.yaml:5:1: elevation: .*the road is"),
        ("road: nowhere", "no road 'nowhere'; known here: .*circuit"),
    ],
)
def test_contradicting_values_are_refused_before_the_run(tmp_path, line, message):
    text = GOOD.replace("road: straight\n", "") if line.startswith("road") else GOOD
    with pytest.raises(InputError, match=message):
        load_scenario(write(tmp_path, text + line)).check()


def test_a_bad_file_of_the_vehicle_is_reported_at_its_own_place_only(tmp_path, monkeypatch):
    (tmp_path / "vehicle.yaml").write_text("bogus: 1\n")
    monkeypatch.setattr("sim_harness.scenarios.scenario.CONFIG_DIR", tmp_path)
    with pytest.raises(InputError, match=f"^{tmp_path}/vehicle.yaml:1:1: unknown field 'bogus'"):
        load_scenario(write(tmp_path, GOOD))


def test_settings_from_the_command_line_replace_those_of_the_file(tmp_path):
    overrides = {"duration_s": "3", "camera.latency_s": "0.1"}
    scenario = load_scenario(write(tmp_path, GOOD), overrides)
    assert (scenario.duration_s, scenario.camera.latency_s, scenario.camera.rate_hz) == (3.0, 0.1, 25.0)
    with pytest.raises(InputError, match=r"--set duration_s: duration_s: .*greater than or equal to 0.1"):
        load_scenario(write(tmp_path, GOOD), {"duration_s": "-3"})


@pytest.mark.parametrize("given", ["cv,cnn", "[cv, cnn]", "cv, cnn"])
def test_a_list_on_the_command_line_needs_no_brackets(given, tmp_path):
    assert load_scenario(write(tmp_path, GOOD), {"estimators": given}).estimators == ("cv", "cnn")
    assert load_scenario(write(tmp_path, GOOD), {"estimators": "cv"}).estimators == ("cv",)
    with pytest.raises(
        InputError, match=r"--set estimators: estimators.1: no estimator 'cvv'; did you mean 'cv'\?"
    ):
        load_scenario(write(tmp_path, GOOD), {"estimators": "cnn,cvv"})


def test_a_run_cut_short_on_the_command_line_is_judged_over_its_time():
    whole = load_scenario("circuit").expect
    assert whole.must_finish and whole.min_mean_speed_mps is not None
    short = load_scenario("circuit", {"duration_s": "20"}).expect
    assert not short.must_finish and short.min_mean_speed_mps is None
    assert short.max_lateral_error_m == whole.max_lateral_error_m
    asked = load_scenario("circuit", {"duration_s": "20", "expect.min_mean_speed_mps": "3"}).expect
    assert asked.min_mean_speed_mps == 3
    longer = load_scenario("circuit", {"duration_s": "2000"}).expect
    assert longer.must_finish


def test_a_relative_rule_file_lies_beside_the_scenario_or_where_the_override_was_typed(tmp_path, monkeypatch):
    vary = "vary:\n  start.offset_m: [-0.2, 0.2]\n"
    rules = (CONFIG_DIR / "fear.yaml").read_text()
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "own.yaml").write_text(rules)
    (tmp_path / "typed.yaml").write_text(rules)
    beside = load_scenario(write(tmp_path, f"{GOOD}rules: own.yaml\n{vary}", "a/mine.yaml"))
    assert beside.rules_file.resolve() == tmp_path / "a" / "own.yaml"
    monkeypatch.chdir(tmp_path)
    typed = load_scenario(write(tmp_path, GOOD + vary, "a/other.yaml"), {"rules": "typed.yaml"})
    assert typed.rules_file.resolve() == tmp_path / "typed.yaml"


def test_a_scenario_survives_json_unchanged():
    for scenario in list_scenarios():
        assert Scenario.model_validate(scenario.model_dump(mode="json")) == scenario


def test_appearance_width_and_line_replace_those_of_the_road():
    bend = load_scenario("curve_right_r15").build_road()
    assert min(bend.curvature_at(station) for station in range(150)) == pytest.approx(-1 / 15)
    assert not bend.closed
    glare = load_scenario("glare").build_road()
    assert {section.light.glare for section in glare.sections} == {0.75}
    assert load_scenario("straight", {"lane_width_m": "3.0"}).build_road().width_at(5.0) == 3.0


def test_a_plant_may_differ_from_the_vehicle_of_the_controller():
    nominal = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    real = load_scenario("straight", {"plant.vehicle.steering_lag_s": "0.3"}).plant
    assert real_vehicle(real, nominal) == nominal.model_copy(update={"steering_lag_s": 0.3})


def test_a_shortened_scenario_keeps_only_the_expectations_that_still_apply():
    short = load_scenario("circuit").shorten(20.0)
    assert (short.duration_s, short.expect.must_finish, short.expect.min_mean_speed_mps) == (
        20.0,
        False,
        None,
    )
    assert short.expect.max_lateral_accel_mps2 == load_scenario("circuit").expect.max_lateral_accel_mps2
    assert load_scenario("circuit").shorten(1e4) == load_scenario("circuit")
    assert load_scenario("frozen_camera").shorten(10.0).expect.must_stop_by_s is None
    assert load_scenario("frozen_camera").shorten(20.0).expect.must_stop_by_s == 18.0


def test_a_python_script_makes_scenarios(tmp_path):
    script = """\
    from sim_harness.scenarios.scenario import load_scenario

    scenarios = [load_scenario("straight").model_copy(update={"name": f"drift {i}"}) for i in range(3)]
    """
    assert [s.name for s in load_scenarios(write(tmp_path, script, "sweep.py"))] == [
        "drift 0",
        "drift 1",
        "drift 2",
    ]


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_every_example_script_is_short_and_fits_together(path):
    assert len(path.read_text().splitlines()) <= 30
    for scenario in load_scenarios(str(path)):
        scenario.check()


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("x = 1\nscenarios = [1 / 0]\n", r"bad\.py:2: division by zero"),
        ("def f(:\n", r"bad\.py:1: "),
        ("x = 1\n", "must assign a Scenario or a list of them"),
        ("scenarios = [3]\n", "must assign a Scenario or a list of them"),
    ],
)
def test_a_broken_script_is_one_message_with_its_line(tmp_path, script, message):
    with pytest.raises(InputError, match=message):
        load_scenarios(write(tmp_path, script, "bad.py"))


def test_a_scenario_drives_with_a_pipeline_of_techniques():
    settings = load_scenario("straight").model_copy(update={"estimators": ("hough_kalman",)})
    assert settings.problem() is None
    problem = settings.model_copy(update={"estimators": ("hough_calman",)}).problem()
    assert problem is not None and "no estimator 'hough_calman'" in problem[1]
