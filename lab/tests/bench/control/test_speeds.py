"""The sweep over speeds stays on one tuning, and the ranking has vehicles that differ."""

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from lab.bench.control.episode import drive
from lab.bench.control.speeds import LATERAL_MPS2, TIGHTEST_M, VEHICLES, episodes
from sim_harness.world.plants.build import build_plant


def test_every_bend_of_the_sweep_is_at_2_mps2_or_at_15_m():
    for _, episode in episodes(0):
        road = episode.road
        sharpest = max(abs(road.curvature_at(n * road.length_m / 400)) for n in range(400))
        meant = min(LATERAL_MPS2 / episode.speed_mps**2, 1.0 / TIGHTEST_M)
        assert sharpest == pytest.approx(meant, rel=0.01)
        assert episode.duration_s * episode.speed_mps <= road.length_m


def test_the_slowest_and_a_fast_one_are_kept_on_the_shipped_tuning():
    known = [episode for _, episode in episodes(0)]
    assert drive(known[0], SETTINGS).worst_m <= 0.01
    assert drive(known[5], SETTINGS).worst_m <= 0.02


def test_there_are_six_vehicles_and_no_two_answer_the_wheel_alike():
    plants = [build_plant(plant, SHUTTLE) for plant in VEHICLES.values()]
    assert len(plants) >= 6
    assert len({repr(settings) for settings in VEHICLES.values()}) == len(plants)
