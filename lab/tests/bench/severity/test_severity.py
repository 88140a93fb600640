"""Fear over severity: every disturbance and fault has a row, falls are counted, causes are compared."""

import typing
from pathlib import Path

import cv2
import pytest

from lab.bench.severity.bench import DETAILS, bench_severity, draw, falls, summary
from lab.bench.severity.drive import StressedDrive, driven_row, scenario_of
from lab.bench.severity.stresses import GRADES, NOTHING, STRESSES, stress_of
from sim_harness.scenarios import faults
from sim_harness.sweep.store import Row
from sim_harness.world.roads.disturbances import DisturbanceKind
from supervisor.rules.inference import FearRules
from trepid.config import CONFIG_DIR, InputError

BAND = FearRules.load(CONFIG_DIR / "fear.yaml").file.hysteresis.band


def row(stress: str, grade: int, mean: float, **causes: int) -> Row:
    task = StressedDrive(stress, grade, "straight", 8.0, 1)
    return {**task._asdict(), "mean": mean, "worst": mean, "frames": 40, "causes": causes}


def test_every_disturbance_and_every_kind_of_fault_of_the_world_is_a_stress() -> None:
    assert set(DisturbanceKind) <= set(STRESSES)
    union = typing.get_args(typing.get_args(faults.Fault)[0])
    used = {
        type(fault) for stress in STRESSES.values() for fault in stress.changes(3, 50.0).get("faults", ())
    }
    assert used == set(union)


@pytest.mark.parametrize("name", STRESSES)
def test_every_grade_of_a_stress_is_another_drive_on_the_same_road(name: str) -> None:
    scenarios = [scenario_of(StressedDrive(name, grade, "bend", 12.0, 1)) for grade in GRADES if grade]
    assert len({scenario.build_road().length_m for scenario in scenarios}) == 1
    stress = stress_of(name)
    told = {scenario.model_copy(update={"description": ""}).model_dump_json() for scenario in scenarios}
    assert len(told) == len(scenarios) or stress.state_delay_s or stress.yaw_bias_radps


@pytest.mark.parametrize(
    ("fears", "expected"),
    [
        ([0.0, 0.2, 0.4, 0.4], []),
        ([0.0, 0.5, 0.5 - 0.9 * BAND], []),
        ([0.0, 0.5, 0.5 - 2 * BAND], [2 * BAND]),
        ([0.5, 0.2, 0.3, 0.6], [0.3, 0.2]),
    ],
)
def test_a_fall_is_counted_from_the_greatest_fear_of_a_lower_grade(
    fears: list[float], expected: list[float]
) -> None:
    assert falls(fears) == pytest.approx(expected)


def test_the_summary_counts_falls_and_wrong_causes(tmp_path: Path) -> None:
    rows = [
        row(NOTHING, 0, 0.0),
        row("fog", 1, 0.3, fog=3, low_confidence=1),
        row("fog", 2, 0.1),
        row("dirt", 1, 0.0),
        row("dirt", 2, 0.5, dirty_lens=40),
    ]
    found = summary(rows)
    fog, dirt = found[""]["fog"], found[""]["dirt"]
    assert (fog["falls"], dirt["falls"], found["falls"]) == (1, 0, "1, target 0")
    assert (fog["right_cause_percent"], dirt["right_cause_percent"]) == (75.0, 100.0)
    assert fog["wrong_causes"] == "low_confidence 25 %" and dirt["wrong_causes"] is None
    assert found[DETAILS]["fog, straight, 8 m/s"] == {"grade 0": 0.0, "grade 1": 0.3, "grade 2": 0.1}
    draw(found, tmp_path / "heat.png")
    assert cv2.imread(str(tmp_path / "heat.png")) is not None


@pytest.mark.parametrize("name", ["wrong speed", "wrong wheel angle", "wrong yaw rate"])
def test_a_measurement_that_is_off_by_more_is_feared_more_and_named(name: str) -> None:
    calm, worst = (driven_row(StressedDrive(name, grade, "straight", 12.0, 1)) for grade in (1, 5))
    assert worst["mean"] >= max(calm["mean"], 0.5)
    assert set(worst["causes"]) == {"doubted_state"}


def test_a_car_on_rails_fears_lost_lanes_and_nothing_else() -> None:
    calm, blind = (
        driven_row(StressedDrive(*stress, "straight", 12.0, 1))
        for stress in ((NOTHING, 0), ("both blind", 5))
    )
    assert (calm["mean"], calm["causes"]) == (0.0, {})
    assert blind["mean"] == 1.0 and set(blind["causes"]) == {"no_road"}


def test_an_unknown_stress_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match="no disturbance or fault 'snwo'; did you mean 'snow'"):
        bench_severity(1, faults=("snwo",))
