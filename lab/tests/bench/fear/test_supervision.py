"""The bench of drivers: lots are replayed, drives are not driven twice, figures are counted right."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.bench.fear import supervision
from lab.bench.fear.drives import HARD_ROUTE_M, cases
from lab.bench.fear.fuzz import situations
from lab.bench.fear.supervision import (
    SUPERVISED,
    Driver,
    choose_estimate,
    drive_all,
    drivers,
    summary,
    warnings_s,
)
from sim_harness.judging.trace import Trace
from sim_harness.sweep.fingerprint import fingerprint

CV = situations()["calm"]["cv"]
SEEN = {"cv": CV, "cnn": replace(CV, estimator="cnn", lateral_offset_m=0.5, confidence=0.95)}


@pytest.mark.parametrize(
    ("driver", "offset_m"), [("cv", 0.1), ("cnn", 0.5), ("average", 0.3), ("surest", 0.5)]
)
def test_every_driver_drives_its_lane(driver: str, offset_m: float) -> None:
    lane = choose_estimate(SEEN, Driver(driver))
    assert lane is not None and lane.lateral_offset_m == pytest.approx(offset_m)
    assert choose_estimate({}, Driver(driver)) is None


def test_more_cases_begin_with_the_same() -> None:
    few, many = list(cases(3, 2)), list(cases(3, 4))
    assert many[: len(few)] == few
    assert len({case.key for case in many}) == len(many)


def row(
    driver: str, *, clean: bool, departures: int = 0, warned_s: tuple[float, ...] = ()
) -> dict[str, object]:
    before, others = np.zeros(100, int), np.zeros(100, int)
    before[80], others[10] = 5 * departures, 100
    return {
        "driver": driver,
        "clean": clean,
        "departures": departures,
        "distance_m": 1000.0,
        "mean_speed_mps": 7.6 if driver == SUPERVISED else 8.0,
        "nuisance_per_km": 1.0,
        "warnings_s": list(warned_s),
        "fear_before": before.tolist(),
        "fear_else": others.tolist(),
    }


def test_the_supervised_car_alone_has_the_drives_of_the_whole_benchmark() -> None:
    clean, *_, hard = list(cases(3, 1))
    for case in (clean, hard):
        assert drivers(case, supervised_only=True) == [SUPERVISED]
        assert SUPERVISED in drivers(case)
    alone = summary([row(SUPERVISED, clean=c) for c in (True, False)])
    assert alone["supervised: departures"] == "0 in 1 drives, 1.0 km"
    assert "cv: departures" not in alone and "loss of mean speed on clean roads" not in alone


def test_the_summary_counts() -> None:
    rows = [row(d, clean=c) for d in (SUPERVISED, Driver.AVERAGE) for c in (True, False)]
    rows.append(row(Driver.CV, clean=False, departures=2, warned_s=(2.5, 0.4)))
    # The supervised car stopped for its fear: that is no false alarm.
    heeded = {**row(SUPERVISED, clean=False), "fear_else": [0] * 99 + [1000]}
    figures = summary([*rows, heeded])
    assert figures["cv: departures"].startswith("2 in 1")
    assert figures["first departures with fear 2 s before, all drivers"] == "50.0 % of 2"
    assert figures["first departures with fear 2 s before, fused path"] is None
    assert figures["AUROC of fear, all fearless drivers"] == 1.0
    assert figures["loss of mean speed on clean roads"] == "5.0 %"
    assert figures["nuisance slow-downs on clean roads"] == "1 in 1.0 km"


def test_a_warning_is_counted_from_where_it_began_and_not_across_an_intervention() -> None:
    t_s = np.arange(0.0, 10.0, 0.1)
    fear = np.where((t_s > 2.95) & (t_s < 5.0), 0.8, 0.0)
    after = (t_s > 5.95).astype(float)
    trace = Trace({"t_s": t_s, "decision.fear": fear, "departures": after, "interventions": after}, {})
    assert warnings_s(trace) == pytest.approx([3.0])
    early = np.where((t_s > 1.0) & (t_s < 2.0), 0.8, 0.0)
    moved = {**trace.columns, "interventions": (t_s > 2.5).astype(float) + after, "decision.fear": early}
    assert warnings_s(Trace(moved, {})) == [0.0]


def test_a_departure_soon_after_an_intervention_belongs_to_the_previous_departure() -> None:
    t_s = np.arange(0.0, 10.0, 0.1)
    departures = (t_s > 4.95).astype(float) + (t_s > 6.95)
    columns = {"t_s": t_s, "decision.fear": np.full(100, 0.8), "departures": departures}
    assert len(warnings_s(Trace({**columns, "interventions": departures}, {}))) == 1


def test_a_hard_road_is_the_same_for_every_driver_and_can_be_driven() -> None:
    hard = [case for case in cases(3, 12) if not case.clean]
    assert len({case.scenario.description for case in hard}) == 12
    for case in hard:
        case.scenario.check()
        assert case.scenario.build_road().length_m > HARD_ROUTE_M


def test_a_stored_drive_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept.jsonl"
    kept = [
        {"case": f"{case.key} {driver}", "code": fingerprint(), "driver": str(driver), "mine": True}
        for case in cases(1, 1)
        for driver in drivers(case)
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in kept))
    monkeypatch.setattr(supervision, "driven_row", None)  # driving would raise
    assert drive_all(1, 1, path) == [{"driver": line["driver"], "mine": True} for line in kept]
