"""Live drives beside lock-step runs: which scenarios, and what agrees."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lab.bench.live import agreement
from lab.bench.live.agreement import beside, choose_scenarios, summary
from sim_harness.live.course import lockstep_only
from sim_harness.scenarios.scenario import list_scenarios

SCENARIO: Any = SimpleNamespace(camera=SimpleNamespace(rate_hz=25.0))
ALONE = {
    "status": "passed",
    "distance_m": 100.0,
    "modes": {"STOP": 0.1, "KEEP": 9.0},
    "causes": {"none": 9.1},
}


def live(rate_hz: float = 25.0, **changes: Any) -> dict[str, Any]:
    return {**ALONE, "reasons": [], "processes": {"camera": {"rate_hz": rate_hz}}, **changes}


def test_the_scenarios_cover_every_tag_that_can_be_driven_live() -> None:
    scenarios = choose_scenarios(7, 20)
    assert len({scenario.name for scenario in scenarios}) == 20
    possible = [scenario for scenario in list_scenarios() if not any(lockstep_only(scenario))]
    assert {tag for s in scenarios for tag in s.tags} == {tag for s in possible for tag in s.tags}
    assert choose_scenarios(7, 20) == scenarios != choose_scenarios(8, 20)


def test_a_drive_that_moved_further_than_it_scored_has_a_share_below_one() -> None:
    assert beside(ALONE, live(distance_m=99.5), 199.0, SCENARIO)["scored share"] == 0.5
    assert beside(ALONE, live(), 0.0, SCENARIO)["scored share"] is None


def test_a_short_cause_need_not_agree_and_a_long_one_must() -> None:
    found = beside(ALONE, live(causes={"none": 9.0, "late": 0.4}), 100.0, SCENARIO)
    assert found["causes agree"] and found["modes agree"] and found["distance agrees"]
    feared = beside(ALONE, live(causes={"none": 8.0, "fog": 1.0}), 100.0, SCENARIO)
    assert not feared["causes agree"]
    assert (feared["only live"], feared["only in lock-step"]) == ("fog", "")
    assert not beside(ALONE, live(distance_m=97.0), 97.0, SCENARIO)["distance agrees"]


def test_another_verdict_counts_as_explained_only_on_a_machine_that_was_too_slow() -> None:
    rows = [live(), live(status="failed"), live(status="failed", rate_hz=12.0)]
    drives = {f"{n}, load 8": beside(ALONE, row, 100.0, SCENARIO) for n, row in enumerate(rows)}
    found = summary(drives, 8)
    assert (found["drives"], found["same verdict"], found["other verdict, machine too slow"]) == (3, 1, 1)
    assert summary(drives, 0)["drives"] == 0


def test_an_interrupted_run_drives_only_what_has_no_row_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven: list[tuple[str, int]] = []

    def drive(pairing: agreement.Pairing) -> dict[str, Any]:
        if len(driven) == 3:
            raise KeyboardInterrupt
        driven.append((pairing.scenario.name, pairing.load))
        return beside(ALONE, live(), 100.0, SCENARIO)

    monkeypatch.setattr(agreement, "WORK_DIR", tmp_path)
    monkeypatch.setattr(agreement, "compare_drive", drive)
    with pytest.raises(KeyboardInterrupt):
        agreement.bench_live(3, count=2)
    before = [*driven]
    driven.clear()
    found = agreement.bench_live(3, count=2)
    assert [found["loads"][f"load {load}"]["drives"] for load in agreement.LOADS] == [2, 2]
    assert len(before) == 3 and len({*before, *driven}) == 4 and not {*before} & {*driven}
