"""The bench of learning."""

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from lab.bench.control import learning
from trepid.car.vehicle import GRADIENT


@pytest.mark.proof  # a lap
def test_one_lap_identifies_understeer_within_5_percent_and_the_offset_within_half_a_milliradian():
    plant = next(iter(learning.random_cars(SHUTTLE, 11)))
    _, learner = learning.lap(SHUTTLE, SETTINGS, plant, 11)
    assert learner.understeer == pytest.approx(plant.vehicle[GRADIENT], rel=0.05)
    assert learner.offset_rad == pytest.approx(plant.steering_offset_rad, abs=5e-4)


def test_random_cars_are_drawn_from_the_seed_only():
    assert list(learning.random_cars(SHUTTLE, 4)) == list(learning.random_cars(SHUTTLE, 4))
    assert list(learning.random_cars(SHUTTLE, 4)) != list(learning.random_cars(SHUTTLE, 5))
