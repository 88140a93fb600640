"""Sampling: concrete cases of logical scenarios, their seeds, and the limits between passing and failing."""

import json
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.cli import app
from sim_harness.scenarios.boundary import limits
from sim_harness.scenarios.sampling import Method, case_seed, cases, fresh_seed, grid_size
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenario
from sim_harness.scenarios.vary import Choices, Range
from trepid.config import InputError, parse_overrides

BASE = {"name": "drift", "description": "a test", "tags": ("nominal",), "road": "straight", "duration_s": 10}
OFFSET = {"start.offset_m": [-0.5, 0.5]}
THREE = {
    **OFFSET,
    "camera.latency_s": {"from": 0.05, "to": 0.4, "log": True},
    "road": {"choices": ["straight", "curve"]},
}


def scenario(vary, **changes):
    return Scenario.model_validate({**BASE, **changes, "vary": vary})


def values(found, parameter):
    return [case.parameters[parameter] for case in found]


def test_a_grid_is_every_combination_from_end_to_end():
    found = list(cases(scenario(THREE), Method.GRID))
    assert len(found) == grid_size(scenario(THREE)) == 5 * 5 * 2
    assert len({tuple(case.parameters.values()) for case in found}) == len(found)
    assert sorted(set(values(found, "start.offset_m"))) == [-0.5, -0.25, 0.0, 0.25, 0.5]
    assert (min(values(found, "camera.latency_s")), max(values(found, "camera.latency_s"))) == (
        0.05,
        0.4,
    )


def test_part_of_a_grid_is_drawn_without_repetition():
    found = [tuple(case.parameters.values()) for case in cases(scenario(THREE), Method.GRID, 20, seed=3)]
    whole = [tuple(case.parameters.values()) for case in cases(scenario(THREE), Method.GRID)]
    assert len(set(found)) == 20
    assert [row for row in whole if row in found] == found


@pytest.mark.parametrize("method", Method)
def test_a_case_carries_its_values_and_has_nothing_left_to_vary(method):
    for case in cases(scenario(THREE), method, 10, seed=5):
        assert case.scenario.start.offset_m == case.parameters["start.offset_m"]
        assert case.scenario.road == case.parameters["road"]
        assert case.scenario.vary == {}
        assert case.scenario.name == "drift"


@pytest.mark.parametrize("method", Method)
def test_the_seed_decides_everything(method):
    again = [list(cases(scenario(THREE), method, 20, seed=7)) for _ in range(2)]
    assert again[0] == again[1]
    assert again[0] != list(cases(scenario(THREE), method, 20, seed=8))


def test_random_cases_do_not_depend_on_how_many_there_are():
    many = cases(scenario(THREE), Method.RANDOM, 50, seed=7)
    assert list(islice(many, 10)) == list(cases(scenario(THREE), Method.RANDOM, 10, seed=7))


@pytest.mark.parametrize("count", [1, 8, 40])
def test_a_latin_hypercube_visits_every_stratum_of_every_range_once(count):
    found = list(cases(scenario(THREE), Method.LHS, count, seed=1))
    offsets = np.array(values(found, "start.offset_m")) + 0.5
    lags = np.log(np.array(values(found, "camera.latency_s")) / 0.05) / np.log(8)
    for units in (offsets, lags):
        assert sorted((units * count * (1 - 1e-4)).astype(int)) == list(range(count))
    if count > 1:
        assert values(found, "road").count("curve") == count // 2


def test_case_seeds_differ_between_cases_scenarios_and_seeds():
    one, other = scenario(OFFSET), scenario(OFFSET, name="other")
    seeds = [case_seed(s, index, seed) for s in (one, other) for index in range(100) for seed in (0, 1)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**32 for seed in seeds)
    assert fresh_seed() != fresh_seed()


def test_without_anything_to_vary_cases_differ_by_seed_only():
    assert len(list(cases(scenario({}), Method.GRID))) == 1
    for method in (Method.RANDOM, Method.LHS):
        found = list(cases(scenario({}), method, 4))
        assert len({case.seed for case in found}) == 4
        assert all(case.scenario == scenario({}) for case in found)


def test_the_settings_of_a_case_make_it_again_from_the_command_line():
    for shipped in list_scenarios():
        for case in islice(cases(shipped, Method.RANDOM, 1, seed=11), 1):
            again = load_scenario(shipped.name, parse_overrides(case.settings), check=False)
            assert again.model_copy(update={"vary": {}}) == case.scenario


def test_several_fields_may_share_a_value():
    bend = scenario(
        {"segments.0.curvature_1pm.1, segments.1.curvature_1pm": [0.01, 0.05]},
        segments=[{"length_m": 20, "curvature_1pm": [0, 0.02]}, {"length_m": 30, "curvature_1pm": 0.02}],
    )
    for case in cases(bend, Method.RANDOM, 5):
        first, second = case.scenario.segments
        assert first.curvature_1pm[1] == second.curvature_1pm
        case.scenario.build_road()


def test_values_that_do_not_fit_together_are_one_message():
    clash = scenario(
        {"faults.0.process": {"choices": ["cnn", "cv"]}, "estimators": {"choices": [["cv"], ["cnn", "cv"]]}},
        estimators=["cv", "cnn"],
        faults=[{"kind": "lost_process", "process": "cv", "from_s": 1}],
    )
    with pytest.raises(
        InputError, match=r"scenario drift: faults.0.process = cnn, estimators = \['cv'\]: .*no process"
    ):
        list(cases(clash, Method.GRID))


@given(st.floats(0, 1), st.floats(0.001, 10), st.floats(1.01, 100), st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_range_maps_the_unit_interval_onto_its_values_and_back(unit, low, ratio, log):
    span = Range.model_validate({"from": low, "to": low * ratio, "log": log})
    value = span.value(unit)
    assert span.from_ <= value <= span.to
    assert span.unit(value) == pytest.approx(unit, abs=2e-5 * ratio / (ratio - 1) * 10)
    assert (span.value(0), span.value(1)) == (
        pytest.approx(span.from_, rel=1e-5),
        pytest.approx(span.to, rel=1e-5),
    )


def test_whole_ranges_have_whole_values_with_both_ends():
    span = Range.model_validate({"from": 1, "to": 4, "whole": True, "steps": 9})
    assert span.grid() == (1, 2, 3, 4)
    assert isinstance(span.value(0.3), int)


def test_choices_have_equal_shares():
    three = Choices(choices=("a", "b", "c"))
    assert [three.value(u) for u in (0.0, 0.33, 0.34, 0.66, 0.67, 1.0)] == ["a", "a", "b", "b", "c", "c"]


# Limits.


def test_the_limit_is_found_on_both_sides_within_the_tolerance():
    found = {
        limit.ray: limit
        for limit in limits(
            scenario(OFFSET), lambda case: -0.1 < case.scenario.start.offset_m < 0.3, tolerance=0.01
        )
    }
    for ray, limit_m in (("start.offset_m up", 0.3), ("start.offset_m down", -0.1)):
        passes, fails = (case.parameters["start.offset_m"] for case in (found[ray].passes, found[ray].fails))
        assert min(passes, fails) <= limit_m <= max(passes, fails)
        assert abs(passes - fails) <= 0.01 * 0.5 * (1 + 1e-9)
        assert found[ray].runs <= 8


def test_a_range_without_a_failure_has_no_limit():
    assert [limit.fails for limit in limits(scenario(OFFSET), lambda case: True)] == [None, None]


def test_a_scenario_that_never_passes_has_no_passing_case():
    assert [limit.passes for limit in limits(scenario(OFFSET), lambda case: False)] == [None, None]


def test_from_a_failing_scenario_the_search_goes_towards_a_passing_end():
    up = next(
        limit
        for limit in limits(scenario(OFFSET), lambda case: case.scenario.start.offset_m > 0.2)
        if "up" in limit.ray
    )
    assert up.fails.parameters["start.offset_m"] <= 0.2 < up.passes.parameters["start.offset_m"]


def test_a_scenario_that_stands_at_the_end_of_a_range_is_searched_in_one_direction():
    start = scenario({"start.offset_m": [0.2, 0.7]}, start={"offset_m": 0.2})
    assert [limit.ray for limit in limits(start, lambda case: True)] == ["start.offset_m up"]


def test_corners_change_all_ranges_together():
    two = scenario({**OFFSET, "start.heading_rad": [-0.05, 0.05]})
    (corner,) = (
        limit
        for limit in limits(two, lambda case: abs(case.scenario.start.heading_rad) < 0.02, corners=1)
        if limit.ray == "corner 0"
    )
    place = corner.fails.parameters
    assert abs(place["start.offset_m"]) == pytest.approx(10 * abs(place["start.heading_rad"]))


def test_the_verb_prints_the_limits_of_a_scenario(tmp_path, capsys):
    path = tmp_path / "edge.yaml"
    path.write_text(
        "description: a car that starts ever further beside the lane\ntags: [nominal]\nroad: straight\n"
        "duration_s: 0.1\nsight: truth\nstart: {speed_mps: 5}\nexpect: {max_lateral_error_m: 0.3}\n"
        "vary: {start.offset_m: [-0.5, 0.2]}\n"
    )
    assert app(["limits", str(path), "--json"], standalone_mode=False) == 0
    down, up = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert down["fails"]["start.offset_m"] < down["passes"]["start.offset_m"]
    assert down["fails"]["start.offset_m"] == pytest.approx(-0.3, abs=0.02)
    assert (up["ray"], up["fails"]) == ("start.offset_m up", None)
    with pytest.raises(InputError, match="no ranges under vary"):
        app(["limits", str(path), "--set", "vary={}"], standalone_mode=False)
