"""Jitter: what jumps shows its error; what moves as the car does shows none."""

import pytest

from supervisor.consistency import AHEAD_M, Consistency
from supervisor.lane import Lane, Motion
from supervisor.sightings import Sighting

MOTION = Motion(8.0, 0.2)


def sighting(lane: Lane | None, t_s: float) -> Sighting:
    return Sighting("cnn", 0.0, t_s, False, 0.9, lane, 8.0, None, False)


def jitter_m(lanes: list[Lane | None], *, repeats: int = 1) -> float:
    consistency = Consistency()
    for number, lane in enumerate(lanes):
        for _ in range(repeats):
            found = consistency.step([sighting(lane, 0.04 * number)], MOTION)
    return found["cnn"]


def test_a_lane_that_moves_as_the_car_does_has_no_jitter() -> None:
    lanes = [Lane(0.2, 0.01, 0.02, 0.0)]
    for _ in range(20):
        lanes.append(lanes[-1].after(MOTION, 0.04))
    assert jitter_m(lanes) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_lane_that_jumps_to_and_fro_has_the_size_of_its_jumps(repeats: int) -> None:
    lane, lanes = Lane(0.0, 0.0, 0.0, 0.0), []
    for number in range(60):
        lane = lane.after(MOTION, 0.04)
        lanes.append(lane._replace(offset_m=lane.offset_m + (0.15 if number % 2 else -0.15)))
    assert jitter_m(lanes, repeats=repeats) == pytest.approx(0.3, rel=0.05)


def test_after_a_gap_it_begins_anew() -> None:
    assert jitter_m([Lane(0.0, 0.0, 0.0, 0.0), *[None] * 20, Lane(1.0, 0.0, 0.0, 0.0)]) == 0.0


def test_a_turn_counts_by_what_it_moves_ahead() -> None:
    turned = jitter_m([Lane(0.0, 0.0, 0.0, 0.0), Lane(0.0, 0.0, 0.0, 0.0)._replace(heading_rad=0.1)])
    assert turned < 0.1 * AHEAD_M
