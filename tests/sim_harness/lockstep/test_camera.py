"""The simulated camera: its pictures, and the effect of its faults on the frames."""

from itertools import pairwise

import numpy as np
import pytest
from trace_rig import truth

from sim_harness.lockstep.camera import SimulatedCamera
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.scenarios.traffic import BODIES
from sim_harness.world.plants.springs import LEVEL
from sim_harness.world.render.scene.view import STILL, ShutterMotion

PERIOD_S = 0.04


class Painter:
    """Draws the number of the call into the picture and records its arguments."""

    seed, road = 0, None

    def __init__(self):
        self.calls = []

    def render(self, *pose, **how):
        self.calls.append((pose, how))
        return np.full((2, 2, 3), 1 + len(self.calls), np.uint8)


def frames(*faults, count=10, traffic=(), **fields):
    """(now, frame) of ``count`` steps from 100 s on, and the painter."""
    scenario = load_scenario("straight")
    scenario = scenario.model_validate({**dict(scenario), "faults": faults, "traffic": traffic})
    painter = Painter()
    camera = SimulatedCamera(scenario, painter, wheelbase_m=2.5)
    times = [100.0 + PERIOD_S * k for k in range(count)]
    return [
        (t_s, camera.step(truth(t_s, elapsed_s=t_s - 100.0, **fields), now_s=t_s)) for t_s in times
    ], painter


def test_every_frame_shows_the_true_pose_at_its_own_time():
    taken, painter = frames(x_m=3.0, y_m=1.0, yaw_rad=0.2, station_m=9.0)
    assert [frame.t_s for _, frame in taken] == [t_s for t_s, _ in taken]
    pose, how = painter.calls[0]
    assert pose == (3.0, 1.0, 0.2)
    still = {"motion": STILL, "attitude": LEVEL}
    assert how == {"station_m": 9.0, "t_s": 100.0, "vehicles": [], **still}


def test_every_other_vehicle_is_in_the_picture_with_its_shape():
    """The painter receives their true poses, independent of our station."""
    traffic = [{"gap_m": 10.0}, {"gap_m": 30.0, "shape": "truck"}]
    places = dict(traffic_x_m=(20.0, 40.0), traffic_y_m=(0.5, 3.0), traffic_yaw_rad=(0.1, 0.0))
    _, painter = frames(traffic=traffic, **places)
    drawn = painter.calls[0][1]["vehicles"]
    assert drawn == [((20.0, 0.5, 0.1), BODIES["car"]), ((40.0, 3.0, 0.0), BODIES["truck"])]


def test_the_renderer_receives_the_motion_of_the_camera():
    _, painter = frames(speed_mps=8.0, yaw_rate_radps=0.1)
    assert painter.calls[0][1]["motion"] == ShutterMotion(8.0, 0.1)


def test_without_a_renderer_shots_have_the_truth_and_no_frame():
    camera = SimulatedCamera(load_scenario("straight", {"sight": "truth"}), None, wheelbase_m=2.5)
    shot = camera.shoot(truth(3.0, elapsed_s=3.0), now_s=3.0)
    assert (shot.truth.t_s, shot.frame) == (3.0, None)


def test_before_the_run_begins_there_are_no_faults():
    scenario = load_scenario("straight", {"faults": "[{kind: black_frames, from_s: 0}]"})
    camera = SimulatedCamera(scenario, Painter(), wheelbase_m=2.5)
    before, begun = (camera.step(truth(t, elapsed_s=t), now_s=t).image.any() for t in (-0.04, 0.0))
    assert (before, begun) == (True, False)


def test_a_frozen_camera_repeats_its_image_with_fresh_stamps_while_the_fault_lasts():
    taken, _ = frames({"kind": "frozen_camera", "from_s": 0.1, "to_s": 0.2})
    values = [int(frame.image[0, 0, 0]) for _, frame in taken]
    assert values == [2, 3, 4, 4, 4, 5, 6, 7, 8, 9]
    assert [frame.t_s for _, frame in taken] == [t_s for t_s, _ in taken]


def test_black_frames_are_black():
    taken, _ = frames({"kind": "black_frames", "from_s": 0.2})
    assert [bool(frame.image.any()) for _, frame in taken] == [True] * 5 + [False] * 5


def test_late_frames_keep_their_order_and_their_capture_times():
    taken, _ = frames({"kind": "late_frames", "delay_s": 0.1, "from_s": 0.0})
    assert [frame for _, frame in taken[:3]] == [None] * 3
    for now_s, frame in taken[3:]:
        assert now_s - frame.t_s == pytest.approx(0.12)


def test_when_frames_are_no_longer_late_only_the_newest_counts():
    taken, _ = frames({"kind": "late_frames", "delay_s": 0.1, "from_s": 0.0, "to_s": 0.2})
    stamps = [frame.t_s for _, frame in taken[3:]]
    assert stamps[2] == taken[5][0]
    assert all(later > earlier for earlier, later in pairwise(stamps))
