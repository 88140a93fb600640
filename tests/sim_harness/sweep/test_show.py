"""What is printed of a sweep: its last line."""

from dataclasses import replace

import pytest

from sim_harness.scenarios.scenario import load_scenario
from sim_harness.sweep.outcome import crash_outcome, execute
from sim_harness.sweep.plan import by_seeds, plan
from sim_harness.sweep.show import Display


def end_line(cores_s: list[float | None], capsys: pytest.CaptureFixture[str]) -> str:
    """The last line of a sweep of failed cases that took these processor times; None: crashed or stored."""
    planned = plan(by_seeds([load_scenario("straight")], range(len(cores_s))))
    display = Display(as_json=True)
    display.begin(planned, None)
    for (key, case), core_s in zip(planned.items(), cores_s, strict=True):
        display.add(key, replace(crash_outcome(case, "a reason"), core_s=core_s))
    assert display.report_end() == 1
    return capsys.readouterr().err.splitlines()[-1]


def test_the_end_gives_the_cases_that_a_core_computes_in_an_hour(capsys: pytest.CaptureFixture[str]) -> None:
    line = end_line([2.0, 8.0, None], capsys)
    assert line == "trepid sim: 3 cases: 0 passed, 3 failed; 720 cases per core-hour"


def test_without_a_case_that_ran_there_is_no_rate(capsys: pytest.CaptureFixture[str]) -> None:
    assert end_line([None, None], capsys) == "trepid sim: 2 cases: 0 passed, 2 failed"


def test_the_processor_time_of_a_case_is_known_where_it_ran_and_stands_in_no_row() -> None:
    scenario = load_scenario("straight", {"duration_s": "0.5", "sight": "truth"})
    (case,) = plan(by_seeds([scenario], [0])).values()
    outcome = execute(case)
    assert outcome.core_s is not None and outcome.core_s > 0.0
    assert "core_s" not in outcome.row
    assert crash_outcome(case, "a reason").core_s is None
