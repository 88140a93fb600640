"""The bench of following: its geometry, its cases, and the model of the lead detector."""

import math

import numpy as np
import pytest

from lab.bench.follow.cases import Kind, case
from lab.bench.follow.detector import figures
from lab.bench.follow.episode import Watcher, distances_m, hand_overs
from lab.bench.follow.runs import summary
from sim_harness.lockstep.lead_model import build_lead_model
from sim_harness.scenarios.scenario import LeadSensor
from trepid.messages import LeadVehicle

PERIOD_S = 0.04


def test_the_distance_from_a_path_is_that_from_its_nearest_piece() -> None:
    corner = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)])
    points = np.array([(5.0, 0.3), (9.0, 5.0), (-3.0, 0.2)])
    assert distances_m(points, corner) == pytest.approx([0.3, 1.0, 0.2])


def test_a_leader_that_has_stood_all_the_time_is_a_point() -> None:
    standing = np.zeros((5, 2))
    assert distances_m(np.array([(3.0, 4.0)]), standing) == pytest.approx([5.0])


def test_only_changes_between_road_and_leader_are_hand_overs() -> None:
    watcher = Watcher()
    watcher.source = ["cv"] * 50 + ["memory"] * 50 + ["lead"] * 50 + ["cv"] * 50 + ["none"] * 50
    watcher.wheel_rad = [0.0] * 100 + [math.radians(1.0)] * 50 + [math.radians(1.5)] * 100
    steps_deg, turns_deg = hand_overs(watcher)
    assert steps_deg == pytest.approx([1.0, 0.5])
    assert turns_deg == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize("seed", range(12))
def test_every_case_is_a_scenario_that_fits_together(seed: int) -> None:
    kind, modelled = case(seed, rendered=False)
    again, rendered = case(seed, rendered=True)
    modelled.check()
    assert kind is again
    assert modelled.leads_by is LeadSensor.MODELLED
    assert rendered.leads_by is LeadSensor.CAMERA
    assert modelled.traffic == rendered.traffic
    assert (kind is Kind.CUT_IN) == (len(modelled.traffic) == 2)


def lead(t_s: float, gap_m: float, speed_mps: float = 4.0) -> LeadVehicle:
    return LeadVehicle(t_s=t_s, distance_m=gap_m, lateral_m=0.5, speed_mps=speed_mps, confidence=1.0)


def detections(gap_m: float, *, seed: int = 1, frames: int = 8000) -> list[LeadVehicle]:
    model = build_lead_model(seed=seed)
    answers = [model.step(lead(n * PERIOD_S, gap_m)) for n in range(frames)]
    return [one for one in answers if one is not None]


def test_the_model_errs_and_misses_as_much_as_its_settings_say() -> None:
    answers = detections(17.5)
    valid = [one for one in answers if one.distance_m is not None]
    assert len(valid) / len(answers) == pytest.approx(0.898, abs=0.08)
    assert np.std([(one.distance_m or 0.0) / 17.5 for one in valid]) == pytest.approx(0.031, rel=0.25)
    assert np.std([one.lateral_m or 0.0 for one in valid]) == pytest.approx(0.19, rel=0.25)


def test_the_model_is_the_same_by_seed() -> None:
    assert detections(12.0, frames=100) == detections(12.0, frames=100)
    assert detections(12.0, frames=100) != detections(12.0, seed=2, frames=100)


def test_the_speed_of_the_model_lags_behind() -> None:
    model = build_lead_model(seed=3)
    for n in range(50):
        model.step(lead(n * PERIOD_S, 10.0, speed_mps=6.0))
    fast = [model.step(lead((50 + n) * PERIOD_S, 10.0, speed_mps=0.0)) for n in range(100)]
    speeds = [one.speed_mps for one in fast if one is not None and one.speed_mps is not None]
    assert np.mean(speeds[:3]) > 3.0
    assert abs(np.mean(speeds[-50:])) < 0.8


def test_without_other_vehicles_the_model_reports_none() -> None:
    assert build_lead_model(seed=0).step(None) is None


def test_figures_count_missed_and_wrong_detections() -> None:
    nan = math.nan
    table = np.array(
        [
            (10.0, 0.0, 5.0, 10.2, 0.1, 5.5),  # right
            (10.0, 0.0, 5.0, nan, nan, nan),  # missed
            (10.0, 0.0, 5.0, 30.0, 0.0, 5.0),  # another
        ]
    )
    found = figures(table)
    assert found["recall"] == pytest.approx(1 / 3, abs=1e-3)
    assert found["precision"] == pytest.approx(1 / 2)
    assert found["lateral error m (rms)"] == pytest.approx(0.1)


def test_a_summary_counts_the_cases_beyond_the_target() -> None:
    episode = dict(
        seed=1,
        kind="drives",
        collisions=0,
        departures=0,
        path_error_m=0.1,
        joined_error_m=0.05,
        road_error_m=0.1,
        hand_over_step_deg=0.2,
        hand_over_turn_deg=0.3,
        followed_s=5.0,
        stopped=False,
        min_time_gap_s=2.0,
    )
    found = summary([episode, {**episode, "path_error_m": 0.4, "collisions": 1}])
    assert (found["runs"], found["collisions"], found["runs over 0.3 m"]) == (2, 1, 1)
