"""Sweeps: the same rows in any process, and a killed worker loses only its case."""

import multiprocessing
import os
import signal
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from sim_harness.scenarios.sampling import Case, Method
from sim_harness.scenarios.scenario import Scenario, Sight, load_scenario
from sim_harness.sweep.outcome import Outcome, execute, is_complete
from sim_harness.sweep.plan import PlanStore, by_sampling, by_seeds, case_key, plan, select
from sim_harness.sweep.sweep import InPlanOrder, in_this_process, on_processes, sweep
from trepid.config import InputError

pytestmark = pytest.mark.long
SECOND = Scenario(
    name="second",
    description="a second, at standstill",
    tags=["nominal"],
    road="straight",
    duration_s=1.0,
    sight="truth",
    expect={"must_stand": True},
)
LONG = SECOND.model_copy(update={"name": "long", "duration_s": 3600.0, "road": "circuit", "distance_m": 1e6})
INSTANT = SECOND.model_copy(update={"name": "instant", "duration_s": 1e-3})  # nothing to score
NOWHERE = SECOND.model_copy(update={"name": "nowhere", "road": "no_such_road"})


def case(scenario, seed=0):
    return Case(scenario=scenario, index=0, seed=seed, parameters={})


def rows(outcomes):
    """Rows by key, without the one number that depends on a clock."""
    return {key: {**outcome.row, "realtime_factor": None} for key, outcome in outcomes}


SEEING = load_scenario("curve_left_r15").shorten(1.0)


@pytest.fixture(scope="module")
def here_and_there():
    """The rows of cases without and with pictures in this process and on two others, by scenario."""
    planned = plan([*by_seeds([SECOND], range(3)), *by_seeds([SEEING], (3, 4))])
    found = [rows(in_this_process(planned)), rows(on_processes(planned, 2))]
    assert all(one.keys() == planned.keys() for one in found)
    return {
        scenario.name: [
            {key: row for key, row in one.items() if row["scenario"] == scenario.name} for one in found
        ]
        for scenario in (SECOND, SEEING)
    }


def test_two_processes_give_the_same_rows_as_this_one(here_and_there):
    here, there = here_and_there[SECOND.name]
    assert there == here
    assert len({row["trace_sha256"] for row in here.values()}) == 3


def test_a_killed_worker_fails_its_own_case_and_no_other():
    planned = plan([case(SECOND), case(LONG), case(SECOND, 1)])
    outcomes = on_processes(planned, 1)
    assert next(outcomes)[1].row["status"] == "passed"
    (worker,) = multiprocessing.active_children()
    os.kill(worker.pid, signal.SIGKILL)
    (_, lost), (_, after) = outcomes
    assert (lost.row["scenario"], lost.row["status"]) == ("long", "failed")
    assert lost.row["reasons"] == ["crashed: its process was killed by SIGKILL"]
    assert not is_complete(lost.row)
    assert after.row["status"] == "passed"
    assert multiprocessing.active_children() == []


def test_closing_ends_busy_workers():
    with closing(on_processes(plan([case(SECOND), case(LONG), case(LONG, 1)]), 2)) as outcomes:
        next(outcomes)
        assert len(multiprocessing.active_children()) == 2
    assert multiprocessing.active_children() == []


def test_an_exception_becomes_the_reason_of_a_failed_case():
    row = execute(case(INSTANT)).row
    assert row["status"] == "failed"
    assert row["reasons"][0].startswith("crashed: ValueError: a trace of 1 samples")
    assert row.keys() == execute(case(SECOND)).row.keys()
    assert row["departures"] is None and row["trace_sha256"] is None


@pytest.mark.parametrize("work", [in_this_process, partial(on_processes, jobs=1)])
def test_wrong_input_ends_the_sweep_after_the_finished_rows(work, tmp_path):
    planned = plan([case(SECOND), case(NOWHERE), *(case(LONG, n) for n in range(3))])
    finished = []
    with (
        PlanStore(tmp_path / "rows.jsonl", planned, code="code", resume=False) as store,
        pytest.raises(InputError, match="no_such_road"),
    ):
        for _, outcome in sweep(planned, work, store):
            finished.append(outcome.row)
    assert [(row["scenario"], row["status"]) for row in finished] == [("second", "passed")]
    assert multiprocessing.active_children() == []
    with PlanStore(tmp_path / "rows.jsonl", planned, code="code", resume=True) as store:
        assert list(store.done.values()) == finished


def test_a_key_depends_only_on_fields_that_influence_the_run():
    assert case_key(case(SECOND)) == case_key(case(SECOND.model_copy(update={"description": "other words"})))
    others = [
        case(SECOND, 1),
        case(SECOND.model_copy(update={"name": "other"})),
        case(SECOND.model_copy(update={"duration_s": 1.1})),
    ]
    assert len({case_key(other) for other in [case(SECOND), *others]}) == 4


def test_a_road_file_next_to_a_scenario_is_part_of_the_key(tmp_path):
    road = tmp_path / "road.yaml"
    keys = set()
    for text in ("lane_width_m: 3", "lane_width_m: 4"):
        road.write_text(text)
        keys.add(case_key(case(SECOND.model_copy(update={"road": str(road)}))))
    assert len(keys) == 2


def test_a_rule_file_next_to_a_scenario_is_part_of_the_key(tmp_path):
    rules = tmp_path / "rules.yaml"
    keys = {case_key(case(SECOND))}
    for text in ("one", "other"):
        rules.write_text(text)
        keys.add(case_key(case(SECOND.model_copy(update={"rules": str(rules)}))))
    assert len(keys) == 3


def test_a_case_that_comes_twice_is_run_once():
    assert len(plan(by_seeds([SECOND, SECOND], range(2)))) == 2


def test_outcomes_that_finish_in_any_order_come_in_that_of_the_plan():
    planned = plan(by_seeds([SECOND], range(4)))
    outcomes = {key: Outcome(row={"seed": c.seed}, code="") for key, c in planned.items()}
    keys = list(planned)
    ordered = InPlanOrder(planned)
    given = [[key for key, _ in ordered.add(keys[i], outcomes[keys[i]])] for i in (2, 0, 3, 1)]
    assert given == [[], [keys[0]], [], [keys[1], keys[2], keys[3]]]


def test_after_an_interrupt_outcomes_behind_unfinished_ones_are_not_lost():
    planned = plan(by_seeds([SECOND], range(4)))
    keys, ordered = list(planned), InPlanOrder(planned)
    for i in (3, 2):
        assert not list(ordered.add(keys[i], Outcome(row={}, code="")))
    assert [key for key, _ in ordered.rest()] == [keys[2], keys[3]]


def test_a_sampled_case_is_repeated_by_its_command():
    selection = select(["straight"], [], {"duration_s": "1", "sight": "truth"})
    (sampled,) = by_sampling(selection.scenarios, Method.RANDOM, 1, seed=5)
    words = selection.command(sampled).split()
    settings = dict(word.split("=") for word in words[words.index("--set") + 1 :: 2])
    again = select(["straight"], [], settings)
    assert words[:6] == ["trepid", "sim", "run", "straight", "--seed", str(sampled.seed)]
    assert (
        execute(sampled).row["trace_sha256"]
        == execute(case(*again.scenarios, sampled.seed)).row["trace_sha256"]
    )


def test_a_tag_chooses_among_all_scenarios_or_those_that_are_named():
    latency = {scenario.name for scenario in select([], ["latency"], {}).scenarios}
    assert "late_frames" in latency and "straight" not in latency
    assert latency == {s.name for s in select(["all"], ["latency"], {}).scenarios}
    assert [s.name for s in select(["straight", "late_frames"], ["latency"], {}).scenarios] == ["late_frames"]
    with pytest.raises(InputError, match="no scenario has the tag 'latency'"):
        select(["straight"], ["latency"], {})


def test_without_cases_nothing_is_started():
    assert list(sweep({}, lambda _: pytest.fail("there is nothing to run"))) == []


def test_a_scenario_with_pictures_gives_the_same_trace_in_other_processes(here_and_there):
    here, there = here_and_there[SEEING.name]
    assert there == here and len(here) == 2


@pytest.mark.proof
def test_a_long_sweep_needs_no_more_memory_than_a_short_one():
    roads = ("circuit", "town", "winter", "gravel_track")
    seen = [SECOND.model_copy(update={"road": road, "sight": Sight.CAMERA}) for road in roads]
    grown_mb = []
    for n in range(3):
        before_mb = _memory_mb()
        assert all(is_complete(execute(case(scenario, n)).row) for scenario in seen)
        grown_mb.append(_memory_mb() - before_mb)
    assert max(grown_mb[1:]) < 20.0


def _memory_mb():
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
