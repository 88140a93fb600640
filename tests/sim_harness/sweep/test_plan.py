"""The stored results of a sweep, and which of them a resumed sweep uses."""

import json

import pyarrow.parquet
import pytest

from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.outcome import crash_outcome
from sim_harness.sweep.plan import PlanStore, by_seeds, plan
from trepid.config import InputError

SCENARIO = Scenario(name="s", description="a second", tags=["nominal"], road="straight", duration_s=1.0)


def row(seed=0, sha="abc", **fields):
    return {
        **crash_outcome(case(seed), "-").row,
        "status": "passed",
        "reasons": [],
        "trace_sha256": sha,
        **fields,
    }


def case(seed):
    return Case(scenario=SCENARIO, index=0, seed=seed, parameters={})


@pytest.fixture
def whole_plan():
    return plan(by_seeds([SCENARIO], range(3)))


def store(path, planned, *, code="code", resume=True):
    return PlanStore(path, planned, code=code, resume=resume)


def test_a_resumed_sweep_reads_the_stored_rows(tmp_path, whole_plan):
    first, second, _ = whole_plan
    with store(tmp_path / "runs.jsonl", whole_plan, resume=False) as runs:
        runs.add(second, row(1))
        runs.add(first, row(0))
    with store(tmp_path / "runs.jsonl", whole_plan) as runs:
        assert runs.done == {first: row(0), second: row(1)}


@pytest.mark.parametrize("kept", range(1, 40, 13))
def test_a_half_written_line_costs_only_itself(tmp_path, whole_plan, kept):
    path = tmp_path / "runs.jsonl"
    first, second, third = whole_plan
    with store(path, whole_plan) as runs:
        runs.add(first, row(0))
        runs.add(second, row(1))
    whole, half = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(whole + half[:kept])
    with store(path, whole_plan) as runs:
        assert runs.done.keys() == {first}
        runs.add(third, row(2))
    with store(path, whole_plan) as runs:
        assert runs.done.keys() == {first, third}


def test_crashed_cases_and_those_of_other_code_are_run_again(tmp_path, whole_plan):
    first, second, third = whole_plan
    with store(tmp_path / "runs.jsonl", whole_plan, code="old") as runs:
        runs.add(first, row(0))
        runs.add(second, row(1))
    with store(tmp_path / "runs.jsonl", whole_plan) as runs:
        assert (runs.done, runs.outdated) == ({}, 2)
        runs.add(second, row(1, "new"))
        runs.add(third, crash_outcome(case(2), "crashed").row)
    with store(tmp_path / "runs.jsonl", whole_plan) as runs:
        assert runs.done == {second: row(1, "new")}
        assert (runs.outdated, runs.crashed) == (1, 1)


def test_a_sweep_may_grow_but_not_be_another_one(tmp_path, whole_plan):
    with store(tmp_path / "runs.jsonl", whole_plan) as runs:
        runs.add(next(iter(whole_plan)), row(0))
    with store(tmp_path / "runs.jsonl", plan(by_seeds([SCENARIO], range(9)))) as runs:
        assert len(runs.done) == 1
    with pytest.raises(InputError, match=r"runs\.jsonl: of another plan: 1 of its cases"):
        store(tmp_path / "runs.jsonl", plan(by_seeds([SCENARIO], [7])))


def test_results_are_not_written_over_by_accident(tmp_path, whole_plan):
    with store(tmp_path / "runs.jsonl", whole_plan) as runs:
        runs.add(next(iter(whole_plan)), row(0))
    with pytest.raises(InputError, match="--resume continues"):
        store(tmp_path / "runs.jsonl", whole_plan, resume=False)


def test_two_sweeps_do_not_write_to_one_file(tmp_path, whole_plan):
    with (
        store(tmp_path / "runs.jsonl", whole_plan),
        pytest.raises(InputError, match="another sweep is writing"),
    ):
        store(tmp_path / "runs.jsonl", whole_plan)


@pytest.mark.parametrize("text", ["nonsense\n", '{"a": 1}\n', "[]\n", "\n"])
def test_a_file_that_is_no_store_is_refused_with_its_line(tmp_path, whole_plan, text):
    path = tmp_path / "notes.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match=r"notes\.jsonl:1: not a result"):
        store(path, whole_plan)
    assert path.read_text() == text


def test_a_place_that_cannot_be_written_is_refused(tmp_path, whole_plan):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        store(tmp_path / "file" / "runs.jsonl", whole_plan)
    with pytest.raises(InputError, match="expected a folder"):
        store(tmp_path / "runs.csv", whole_plan)


@pytest.mark.parametrize("out", ["sweep", "sweep.parquet"])
def test_parquet_has_a_row_a_case_and_a_column_a_parameter(tmp_path, whole_plan, out):
    first, second, third = whole_plan
    with store(tmp_path / out, whole_plan) as runs:
        runs.add(first, row(0, modes={"KEEP": 1.5, "STOP": 0.5}, parameters={"road": "a", "x": 1}))
        runs.add(second, row(1, modes={}, parameters={"road": 2, "x": 0.5}))
        runs.add(third, crash_outcome(case(2), "crashed: it fell").row)
    table = pyarrow.parquet.read_table(runs.parquet).to_pylist()
    assert [line["seed"] for line in table] == [0, 1, 2]
    assert dict(table[0]["modes"]) == {"KEEP": 1.5, "STOP": 0.5}
    assert [line["parameters.x"] for line in table] == [1.0, 0.5, None]
    assert [line["parameters.road"] for line in table] == ['"a"', "2", None]  # of two kinds: as JSON
    assert table[2]["reasons"] == ["crashed: it fell"]
    assert table[2]["departures"] is None
    assert len([json.loads(line) for line in runs.lines.read_text().splitlines()]) == 3
