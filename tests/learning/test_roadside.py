import math

import numpy as np
import pytest

from learning.drawn_frames import drawn_road, random_road, road_samples
from learning.roadside import Scenery, things_beside
from sim_harness.world.render.ground.strip_grid import edges_m
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


@pytest.mark.parametrize("seed", range(12))
def test_nothing_stands_on_the_carriageway(seed):
    rng = np.random.default_rng(seed)
    road = (drawn_road if seed % 2 else random_road)(rng)
    for (x_m, y_m, yaw_rad), thing in things_beside(road, rng):
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        for along_m in (-thing.length_m / 2, 0.0, thing.length_m / 2):
            for across_m in (-thing.width_m / 2, thing.width_m / 2):
                corner = (
                    x_m + along_m * cos - across_m * sin,
                    y_m + along_m * sin + across_m * cos,
                )
                station_m, offset_m = road.local_coordinates(*corner)[:2]
                if 0.0 < station_m < road.length_m:
                    right_m, left_m = (edge[0] for edge in edges_m(road, np.array([station_m])))
                    assert offset_m > left_m or offset_m < -right_m, thing


def test_scenery_is_seeded_and_changes_frames_but_not_their_labels():
    def frames(streets: float, things: float):
        return list(road_samples(3, CAMERA, frames=4, scenery=Scenery(streets=streets, things=things)))

    bare, beside, again = frames(0, 0), frames(0, 1), frames(0, 1)
    assert all(np.array_equal(a.image, b.image) for a, b in zip(beside, again, strict=True))
    assert [one.lane for one in bare] == [one.lane for one in beside]
    assert any((a.image != b.image).any() for a, b in zip(bare, beside, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_the_lane_of_a_frame_in_town_is_one_of_its_ways(seed):
    for sample in road_samples(seed, CAMERA, frames=3, scenery=Scenery(streets=1, things=1)):
        assert 2.7 <= sample.lane_width_m <= 4.2
        assert abs(sample.lane.curvature_1pm) <= 1 / 40 + 1e-9
