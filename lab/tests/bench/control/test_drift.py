"""The bound of the drift grid against an independent simulation, and the default law against the bound."""

import math

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from controller.controller import Controller
from lab.bench.control.contestants import drive_scenario
from lab.bench.control.drift import DEAD_TIME_S, JERK_MPS3, grid, least_overshoot_m
from sim_harness.world.plants.settings import Model


@pytest.mark.parametrize("drift_mps,known_m", [(0.2, 0.078), (0.6, 0.316)])
def test_the_least_overshoot_is_that_of_full_jerk_until_the_drift_is_stopped(drift_mps, known_m):
    dt_s, offset_m, speed_mps, accel_mps2 = 1e-4, drift_mps * DEAD_TIME_S, drift_mps, 0.0
    while speed_mps > 0.0:
        accel_mps2 += JERK_MPS3 * dt_s
        speed_mps -= accel_mps2 * dt_s
        offset_m += speed_mps * dt_s
    assert accel_mps2 <= 3.0
    assert least_overshoot_m(drift_mps) == pytest.approx(offset_m, abs=2e-4)
    assert least_overshoot_m(drift_mps) == pytest.approx(known_m, abs=5e-4)


@pytest.mark.parametrize("drift_mps", [0.2, -0.7])
def test_a_drift_is_stopped_within_a_quarter_more_than_the_least_and_stays_stopped(drift_mps):
    scenario = next(scenario for drift, scenario in grid(Model.KINEMATIC) if math.isclose(drift, drift_mps))
    trace = drive_scenario(scenario, Controller(SHUTTLE, SETTINGS), seed=3)
    away_m = trace["lateral_offset_m"] * math.copysign(1.0, drift_mps)
    assert least_overshoot_m(abs(drift_mps)) * 0.9 <= away_m.max() <= least_overshoot_m(abs(drift_mps)) * 1.25
    assert away_m.min() >= -0.02
    assert trace["departures"][-1] == 0
