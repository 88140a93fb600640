"""What is printed of a sweep: its last line."""

from dataclasses import replace

import pytest

from sim_harness.scenarios.scenario import load_scenario
from sim_harness.sweep.outcome import crash_outcome
from sim_harness.sweep.plan import by_seeds, plan
from sim_harness.sweep.show import Display


def test_the_end_gives_the_cases_that_a_core_computes_in_an_hour(capsys: pytest.CaptureFixture[str]) -> None:
    planned = plan(by_seeds([load_scenario("straight")], range(3)))
    display = Display(as_json=True)
    display.begin(planned, None)
    for (key, case), factor in zip(planned.items(), (10.0, 2.5, None), strict=True):  # 2 s, 8 s, crashed
        outcome = crash_outcome(case, "a reason")
        scores = {"duration_s": 20.0, "realtime_factor": factor} if factor else {}
        display.add(key, replace(outcome, row={**outcome.row, **scores}))
    assert display.report_end() == 1
    assert (
        capsys.readouterr().err.splitlines()[-1]
        == "trepid sim: 3 cases: 0 passed, 3 failed; 720 cases per core-hour"
    )
