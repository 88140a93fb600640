"""Every vehicle of a batch moves as the scalar plant."""

import numpy as np
import pytest
from message_rig import SHUTTLE
from plant_rig import command

from sim_harness.world.plants.batch import BatchPlant
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState

POSE = ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2")
STEERING = ("road_wheel_angle_rad", "acting_demand_rad", "play_rad")
DIFFERENT = {
    "understeer_gradient_rad_per_mps2": (0.0, 0.00356, 0.009, -0.001),
    "steering_lag_s": (0.0, 0.1, 0.3),
    "steering_delay_s": (0.0, 0.05, 0.12),
    "accel_lag_s": (0.15, 0.0),
    "wheelbase_m": (1.75, 2.8),
}


def vehicles(count, seed):
    """Vehicles with different parameters."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        changes = {name: float(rng.choice(values)) for name, values in DIFFERENT.items()}
        settings = PlantSettings(
            friction=float(rng.choice([0.2, 1.0])),
            bank_rad=float(rng.choice([0.0, 0.05])),
            steering_offset_rad=float(rng.choice([0.0, 0.01])),
            steering_friction_rad=float(rng.choice([0.0, 0.005])),
        )
        plant = KinematicPlant(SHUTTLE.model_copy(update=changes), settings)
        plant.stand_on(float(rng.choice([-0.08, 0.0, 0.12])), float(rng.choice([0.0, 0.03])))
        yield plant


@pytest.mark.parametrize("seed", [1, 2])
def test_each_vehicle_of_a_batch_moves_as_the_scalar_plant(seed):
    """Through rate limits, slides, stops, standstill and new starts, on level ground and on hills and banks."""
    rng = np.random.default_rng(seed)
    plants = list(vehicles(12, seed))
    speeds = rng.uniform(0.0, 15.0, len(plants))
    batch = BatchPlant(plants, period_s=0.01)
    together = batch.initial(speeds)
    alone = [PlantState(speed_mps=float(speed)) for speed in speeds]
    for k in range(400):
        if k % 25 == 0:
            angles = rng.uniform(-0.6, 0.6, len(plants)) * rng.choice([0.1, 1.0])
            accels = rng.uniform(-8.0, 3.0, len(plants))
        batch.step(together, angles, accels)
        alone = [
            plant.step(state, command(float(angle), float(accel)), 0.01)
            for plant, state, angle, accel in zip(plants, alone, angles, accels, strict=True)
        ]
    for name in POSE + STEERING:
        expected = np.array([getattr(state, name) for state in alone])
        assert getattr(together, name) == pytest.approx(expected, abs=1e-12, rel=1e-12), name


def test_a_dead_time_between_two_periods_is_refused():
    vehicle = SHUTTLE.model_copy(update=dict(steering_delay_s=0.055))
    with pytest.raises(ValueError, match="whole numbers of 0"):
        BatchPlant([KinematicPlant(vehicle)], period_s=0.01)


def test_a_demand_that_is_not_finite_is_refused():
    batch = BatchPlant([KinematicPlant(SHUTTLE)], period_s=0.01)
    with pytest.raises(ValueError, match="finite"):
        batch.step(batch.initial(np.array([5.0])), np.array([np.nan]), np.array([0.0]))


def test_a_vehicle_beyond_its_critical_speed_is_refused():
    vehicle = SHUTTLE.model_copy(update=dict(understeer_gradient_rad_per_mps2=-0.00356))
    batch = BatchPlant([KinematicPlant(vehicle)], period_s=0.01)
    with pytest.raises(ValueError, match="oversteers"):
        batch.step(batch.initial(np.array([25.0])), np.array([0.01]), np.array([0.0]))
