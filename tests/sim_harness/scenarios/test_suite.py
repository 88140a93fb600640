"""The shipped scenarios: all of them load, are short, cover the subject, start, and make ten thousand cases."""

import json

import pytest

from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.sampling import Method, cases, grid_size
from sim_harness.scenarios.scenario import (
    SCHEMA_FILE,
    Scenario,
    Tag,
    list_scenarios,
    load_scenario,
    scenario_schema,
)
from sim_harness.world.roads.disturbances import DisturbanceKind
from trepid.config import CONFIG_DIR

FILES = sorted((CONFIG_DIR / "scenarios").glob("*.yaml"))
NAMES = [path.stem for path in FILES]

OF_PICTURES = ("frozen_camera", "black_frames")
"""Faults of rendered pictures. They do not occur on the true lane, and neither do their consequences."""
NOT_JUDGED = {"black_blink", "black_frames", "frozen_before_bend", "frozen_camera"}
"""Scenarios with such a fault."""
FAMILIES = [
    ("jpeg", "bridge_shadows", "building_shadows", "motion_blur", "noise", "rolling_shutter", "tree_shadows"),
    ("jpeg", "wet_road"),
    ("dirt", "low_sun", "over_exposure", "sudden_glare", "tunnel_exit"),
    ("dusk", "haze", "unmarked_bend", "worn_markings"),
    ("gravel", "broken_edges"),
    ("damaged_lines", "concrete_low_contrast"),
    ("dirt_track", "snow_covered"),
    ("lss_drift_left_solid", "lss_drift_left_dashed"),
    ("lss_drift_right_solid", "lss_drift_right_dashed"),
]
"""Scenarios of one drive, road and expectation that differ only by what is drawn; the first drives for all."""
ALIKE = {name for _, *others in FAMILIES for name in others}
UNDER_SNOW = ("snow_covered", "snowy_sides")
"""Scenarios in which an estimator follows the edge of the snow; the true lane hides that."""
OF_SIGHT = ("fog", "rain", "snow", "night", "occlusion")
"""Disturbances that end the true sight; the others change pictures alone."""


@pytest.fixture(scope="module")
def scenarios():
    """All shipped scenarios by name; read once."""
    return {scenario.name: scenario for scenario in list_scenarios()}


def of_pictures(scenario):
    return any(fault.kind in OF_PICTURES for fault in scenario.faults)


def on_the_true_lane(scenario):
    """The scenario with estimators that return the exact lane, without rendering and the faults of pictures.

    The vehicle ahead is taken from its exact place instead of the lead detector; disturbances have no effect.
    """
    data = scenario.model_dump(mode="json", exclude_unset=True)
    faults = [fault for fault in data.get("faults", []) if fault["kind"] not in OF_PICTURES]
    return Scenario.model_validate({**data, "sight": "truth", "faults": faults, "vary": {}})


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_scenario_is_consistent_has_at_most_thirty_lines_and_a_description(path):
    scenario = load_scenario(path.stem)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 30
    assert lines[0] == "# yaml-language-server: $schema=../schema/scenario.json"
    assert 20 <= len(scenario.description) <= 120
    assert scenario.route_m(scenario.build_road()) > 0


def from_standstill(scenario):
    """The scenario without its run-up, which takes twenty times as long as the first moments."""
    start = scenario.start.model_copy(update={"speed_mps": 0.0, "drift_mps": 0.0})
    return scenario.model_copy(update={"start": start})


@pytest.mark.parametrize("name", NAMES)
def test_a_scenario_runs_its_first_moments(scenarios, name):
    result = run(on_the_true_lane(from_standstill(scenarios[name].shorten(0.2))))
    assert result.metrics.duration_s == pytest.approx(0.2)
    assert (result.metrics.departures, result.metrics.collisions) == (0, 0)


def undrawn(scenario):
    """All of a scenario but its words, and what only pictures show: appearance, marks, disturbances of pictures."""
    drawn = ("name", "description", "tags", "appearance", "marks", "disturbances", "vary")
    data = scenario.model_dump(mode="json")
    ends_sight = [one for one in data["disturbances"] if one["kind"] in OF_SIGHT]
    sections = [(one.start_m, one.lane_width_m) for one in scenario.build_road().sections]
    return {name: data[name] for name in data if name not in drawn} | {"of": (ends_sight, sections)}


def first_moments(scenario):
    """What is recorded of them, but for the grades of what is drawn."""
    trace = run(on_the_true_lane(from_standstill(scenario.shorten(0.2)))).trace
    columns = {name: column.tobytes() for name, column in trace.columns.items() if "disturbance." not in name}
    return columns, trace.words


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family[1])
def test_scenarios_that_differ_by_what_is_drawn_are_one_drive_on_the_true_lane(scenarios, family):
    first, *others = (scenarios[name] for name in family)
    drive, moments = undrawn(first), first_moments(first)
    for other in others:
        assert undrawn(other) == drive and first_moments(other) == moments


@pytest.mark.suite
@pytest.mark.parametrize("name", sorted(set(NAMES) - NOT_JUDGED - ALIKE))
def test_a_scenario_meets_its_expectations_on_the_true_lane(scenarios, name):
    assert list(run(on_the_true_lane(scenarios[name])).reasons) == []


@pytest.mark.suite
@pytest.mark.parametrize("name", UNDER_SNOW)
def test_a_scenario_under_snow_meets_its_expectations_in_pictures(scenarios, name):
    assert list(run(scenarios[name]).reasons) == []


def test_only_the_expectations_of_faults_of_pictures_are_not_judged_on_the_true_lane(scenarios):
    assert {name for name, scenario in scenarios.items() if of_pictures(scenario)} == NOT_JUDGED


@pytest.mark.parametrize("name", NAMES)
def test_values_from_anywhere_in_the_ranges_fit_together(scenarios, name):
    for case in cases(scenarios[name], Method.LHS, 1, seed=1):
        case.scenario.check()


def test_the_suite_holds_sixty_scenarios_and_ten_thousand_concrete_cases(scenarios):
    assert len(scenarios) >= 60
    assert sum(map(grid_size, scenarios.values())) >= 10_000


def test_every_tag_has_at_least_five_scenarios(scenarios):
    assert {tag: n for tag in Tag if (n := sum(tag in s.tags for s in scenarios.values())) < 5} == {}


def test_every_kind_of_disturbance_fault_and_manoeuvre_occurs(scenarios):
    def kinds(items):
        return {item.kind for item in items}

    schema = json.loads(scenario_schema())["$defs"]
    manoeuvres = {
        schema[name]["properties"]["kind"]["const"] for name in ("ChangeSpeed", "ChangeLane", "TurnOff")
    }
    faults = {
        schema[name]["properties"]["kind"]["const"]
        for name in (
            *("FrozenCamera", "BlackFrames", "LateFrames", "LostProcess", "EstimatorBias", "LostLane"),
            "WrongMeasurement",
        )
    }
    every = scenarios.values()
    assert set.union(*(kinds(s.disturbances) for s in every)) == set(DisturbanceKind)
    assert set.union(*(kinds(s.faults) for s in every)) == faults
    assert set.union(*(kinds(v.phases) for s in every for v in s.traffic)) == manoeuvres
    walks = {schema[name]["properties"]["kind"]["const"] for name in ("Cross", "ChangePace")}
    assert set.union(*(kinds(u.phases) for s in every for u in s.road_users)) == walks
    assert {user.shape for s in every for user in s.road_users} >= {"adult", "child", "cyclist", "deer"}


def test_every_process_is_lost_once(scenarios):
    lost = {f.process for s in scenarios.values() for f in s.faults if f.kind == "lost_process"}
    assert lost == {"camera", "cv", "cnn", "supervisor", "controller"}


def test_the_schema_for_editors_is_current():
    assert SCHEMA_FILE.read_text(encoding="utf-8") == scenario_schema(), (
        "write it again: trepid sim schema > config/schema/scenario.json"
    )
