"""Drives on cars whose vehicle file is wrong, and the plant with noise behind the wheels."""

import math
from itertools import pairwise

import numpy as np
import pytest
from plant_step_rig import step_response_mps2

from lab.bench.control import robustness
from lab.bench.control.contestants import nominal, shipped_settings
from lab.bench.control.episode import drive
from lab.bench.control.learned_plant import LARGEST_STEP_MPS2, STEP_S, SampledPlant
from lab.bench.control.robustness import bench_robustness, errors_of_the_file
from sim_harness.world.plants.settings import PlantSettings

LAG_S, SPEED_MPS = 0.3, 10.0


def lateral_mps2(angle_rad: float, *, noise_mps2: float = 0.0, steps: int = 100) -> list[float]:
    """Lateral acceleration by tick of 10 ms after a step of the wheel angle at once."""
    known = nominal().model_copy(update=dict(steering_delay_s=0.0, steering_lag_s=0.0))
    known = known.model_copy(update=dict(max_road_wheel_rate_radps=100.0))
    plant = SampledPlant(known, PlantSettings(), lag_s=LAG_S, noise_mps2=noise_mps2, seed=4)
    return step_response_mps2(plant, angle_rad, speed_mps=SPEED_MPS, steps=steps)


def test_without_noise_the_lateral_acceleration_approaches_that_of_the_wheels_by_its_lag() -> None:
    found = lateral_mps2(0.01, steps=400)
    steady_mps2 = found[-1]
    assert steady_mps2 == pytest.approx(SPEED_MPS**2 * 0.01 / (1.75 + 0.00356 * SPEED_MPS**2), rel=0.01)
    late = [steady_mps2 - found[round(k * STEP_S / 0.01) + 5] for k in range(1, 8)]
    assert [b / a for a, b in pairwise(late)] == pytest.approx([math.exp(-STEP_S / LAG_S)] * 6, rel=1e-4)


def test_a_sample_changes_the_lateral_acceleration_by_no_more_than_the_largest_step() -> None:
    changes = np.abs(np.diff(lateral_mps2(0.2, noise_mps2=1.0, steps=300)))
    assert changes.max() == pytest.approx(LARGEST_STEP_MPS2) and np.count_nonzero(changes) <= 30


def test_the_plant_turns_left_and_right_alike() -> None:
    left, right = lateral_mps2(0.02), lateral_mps2(-0.02)
    assert left == pytest.approx([-value for value in right])


@pytest.mark.parametrize("number", [2, -2])
def test_the_configured_law_keeps_its_lane_with_a_dead_time_that_nothing_declares(number: int) -> None:
    error = list(errors_of_the_file(1))[number]
    assert drive(error.episodes[-1], shipped_settings()).worst_m < 0.3, error.name


def test_the_summary_counts_departures_and_names_the_law_of_the_configuration(monkeypatch, tmp_path) -> None:
    errors = list(errors_of_the_file(1))
    few = [errors[-1]._replace(episodes=errors[-1].episodes[:1])]
    monkeypatch.setattr(robustness, "errors_of_the_file", lambda seed, learned: few)
    found = bench_robustness(1, tmp_path)
    assert found["law of the configuration"] == "mpc" and found["drives of a law"] == 1
    assert found["departures"]["stanley"] == 1 and found["departures"]["mpc"] == 0
    assert found["learned plant"].startswith("not driven: there is no models/tinyphysics.onnx")
