"""The encounters of the benchmark, and its scores, on hand-made rows and labels."""

import math
from pathlib import Path

import numpy as np
import pytest

from lab.bench.people.bench import MODELLED, TRUTH, _drive_cases, by_distance, cyclists, drive, step_outs
from lab.bench.people.cases import (
    BYSTANDER,
    CYCLIST,
    KINDS,
    REACTION_S,
    STEP_OUT,
    STRONGEST_MPS2,
    Encounter,
    build_scenario,
    cases,
    walk_s,
)
from lab.bench.people.real import overlap, real_pictures, score_picture
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.road_users import START_RATE_MPS2


@pytest.mark.parametrize("kind", KINDS)
def test_cases_are_valid_and_the_same_again(kind: str) -> None:
    some = cases(kind, 3, 6)
    assert some == cases(kind, 3, 6) != cases(kind, 4, 6)
    for case in some:
        build_scenario(case, sight="truth", road_user_sensor="modelled")


def test_a_car_can_stop_for_every_step_out() -> None:
    for case in cases(STEP_OUT, 7, 60):
        speed_mps = case.scenario["speed_mps"]
        trigger_m = case.scenario["road_users"][0]["phases"][0]["at_gap_m"]
        needed_m = speed_mps * REACTION_S + speed_mps**2 / (2 * STRONGEST_MPS2)
        assert trigger_m >= needed_m
        assert case.scenario["road_users"][0]["gap_m"] > trigger_m, "it stands before it steps out"


@pytest.mark.parametrize(("way_m", "speed_mps"), [(0.2, 1.5), (1.0, 1.5), (5.0, 2.0)])
def test_the_time_of_a_walk_is_that_of_its_motion(way_m: float, speed_mps: float) -> None:
    """Small steps of the same acceleration up to the same speed."""
    gone_m = v = t_s = 0.0
    while gone_m < way_m:
        v = min(v + START_RATE_MPS2 * 1e-4, speed_mps)
        gone_m, t_s = gone_m + v * 1e-4, t_s + 1e-4
    assert walk_s(way_m, speed_mps) == pytest.approx(t_s, abs=1e-3)


def ended(**row: object) -> dict[str, object]:
    usual = dict(
        collisions=0, decel_mps2=2.0, stood=True, emergency=False, passing_mps=math.nan, went_on=True
    )
    return usual | row


def test_a_collision_is_no_stop() -> None:
    case = cases(STEP_OUT, 1, 1)[0]
    row = step_outs(
        [(case, ended()), (case, ended(collisions=1)), (case, ended(stood=False, emergency=True))]
    )
    assert (row["runs"], row["stopped"], row["collisions"], row["emergency brakes"]) == (3, 1, 1, 1)


def test_a_cyclist_that_falls_behind_was_overtaken() -> None:
    case = cases(CYCLIST, 1, 1)[0]
    assert cyclists([(case, ended()), (case, ended(passing_mps=3.0))])["overtaken"] == 1


def test_speeds_beside_bystanders_are_sorted_by_their_distance() -> None:
    def at(aside_m: float, passing_mps: float) -> tuple[Encounter, dict[str, object]]:
        return Encounter(BYSTANDER, {"speed_mps": 8.0}, aside_m), ended(passing_mps=passing_mps)

    rows = by_distance([at(2.0, 2.0), at(2.2, 3.0), at(5.0, 8.0)])
    assert [row["speed beside, median [m/s]"] for row in rows.values()] == [2.5, 8.0]


def test_the_overlap_of_boxes_is_a_share() -> None:
    box = (0.0, 0.0, 2.0, 4.0)
    assert overlap(box, box) == 1 and overlap(box, (5.0, 0.0, 6.0, 4.0)) == 0
    assert overlap(box, (0.0, 2.0, 2.0, 6.0)) == pytest.approx(4 / 12)


def test_recall_and_precision_of_hand_made_labels() -> None:
    people = np.zeros((100, 200), bool)
    people[20:60, 30:40] = True
    people[50:70, 150:160] = True
    found = score_picture(people, [(29.0, 19.0, 41.0, 61.0), (100.0, 10.0, 110.0, 40.0)])
    assert sorted(found.people) == [(0.2, False), (0.4, True)]
    assert found.boxes == [True, False]


def test_without_data_or_detector_a_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no folder" in real_pictures(tmp_path, Path("objectron"))["people"]
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (tmp_path / "camvid_road" / "train").mkdir(parents=True)
    (tmp_path / "camvid_road" / "train_road").mkdir()
    image = np.zeros((12, 16, 3), np.uint8)
    import cv2

    cv2.imwrite(str(tmp_path / "camvid_road" / "train" / "a.jpg"), image)
    cv2.imwrite(str(tmp_path / "camvid_road" / "train_road" / "a.png"), image[..., 0])
    assert "trepid detector fetch objectron" in real_pictures(tmp_path, Path("objectron"))["people"]


def test_an_interrupted_benchmark_drives_only_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, drawn, driven = tmp_path / "people.jsonl", cases(STEP_OUT, 1, 3), []

    def count_case(case: Encounter, *, sensor: str) -> dict[str, object]:
        driven.append((case.aside_m, sensor))
        return ended()

    monkeypatch.setattr("lab.bench.people.bench.drive", count_case)
    first = _drive_cases(drawn[:2], TRUTH, path, jobs=1)
    again = _drive_cases(drawn, TRUTH, path, jobs=1)
    assert driven == [(case.aside_m, TRUTH) for case in drawn]
    assert [str(row) for row in again[:2]] == [str(row) for row in first]  # NaN is not equal to itself
    _drive_cases(drawn[:1], MODELLED, path, jobs=1)
    assert driven[-1] == (drawn[0].aside_m, MODELLED), "a row belongs to its sensor"


@pytest.mark.long
@pytest.mark.parametrize("sensor", [TRUTH, MODELLED])
def test_the_car_stops_for_who_steps_out_and_goes_on(sensor: str) -> None:
    for case in cases(STEP_OUT, 5, 2):
        row = drive(case, sensor=sensor)
        assert row["stood"] and row["went_on"] and row["collisions"] == 0
        assert row["passing_mps"] > 0, "the drive ended behind the road user"


@pytest.mark.long
def test_a_drive_that_is_ended_early_is_the_beginning_of_the_whole_one() -> None:
    scenario = build_scenario(
        cases(STEP_OUT, 5, 1)[0], sight="truth", road_user_sensor="modelled", duration_s=4.0
    )
    whole = run(scenario, seed=0).trace
    part = run(scenario, seed=0, until=lambda now: now.now_s > 2.0).trace
    count = len(part["t_s"])
    assert part["t_s"][-1] == pytest.approx(2.0, abs=0.05) and count < len(whole["t_s"])
    for column in ("x_m", "y_m", "decision.fear", "speed_mps"):
        assert np.array_equal(part[column], whole[column][:count], equal_nan=True), column
