"""The road that no pixel shows: its deviation grows, that of the shown road stays."""

import numpy as np
import pytest
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, look, road

from perception.lane.lane_cv import LaneCv
from trepid.clothoid import Lane
from trepid.messages import SIGMA_AHEAD_M, Frame, VehicleState

NEAR, FAR = SIGMA_AHEAD_M.index(10.0), SIGMA_AHEAD_M.index(30.0)
WALL_GREY = 140


def behind_a_wall(lane: tuple[float, ...], wall_m: float) -> np.ndarray:
    """The road ``lane`` up to a plain wall across it, ``wall_m`` ahead of the axle."""
    image = road(lane)
    foot = CAMERA.pixel_from_road(np.array([[wall_m, 0.0]]))[0, 1]
    image[: round(foot)] = WALL_GREY
    return image


def test_a_wall_across_the_road_leaves_the_deviation_before_it_and_enlarges_that_behind():
    free, walled = look(road((0.1, 0.0, 0.0, 0.0))), look(behind_a_wall((0.1, 0.0, 0.0, 0.0), 14.0))
    assert walled.ahead_sigma_m[NEAR] < 0.1
    assert walled.ahead_sigma_m[FAR] > 10 * free.ahead_sigma_m[FAR]


@pytest.mark.parametrize("bend_1pm", [0.0, 0.02, -0.03])
def test_a_road_that_bends_behind_a_wall_is_within_two_deviations(bend_1pm):
    seen = look(behind_a_wall((0.1, 0.0, 0.0, 0.0), 14.0))
    behind_m = np.maximum(np.array(SIGMA_AHEAD_M) - 14.0, 0.0)
    # The bend begins at the wall with the sharpest start of a street, κ' = 0.003/m².
    truth_m = -0.1 + np.sign(bend_1pm) * 0.003 * behind_m**3 / 6
    found = Lane.of_message(seen)
    assert found is not None
    off_m = np.array([found.y_m(x) for x in SIGMA_AHEAD_M]) - truth_m
    assert (np.abs(off_m) < 2 * np.array(seen.ahead_sigma_m) + 0.1).all()


def test_the_end_that_was_seen_comes_nearer_by_the_way_driven():
    finder, speed_mps, ends_m = LaneCv(SETTINGS, CAMERA, VEHICLE), 10.0, []
    for number in range(20):
        image = road((0.0, 0.0, 0.0, 0.0)) if number < 5 else behind_a_wall((0.0, 0.0, 0.0, 0.0), 8.0)
        state = VehicleState(
            t_s=0.0, speed_mps=speed_mps, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        )
        seen = finder.step(Frame(t_s=0.1 * number, image=image), state, now_s=0.0)
        ends_m.append(seen.ahead_sigma_m[SIGMA_AHEAD_M.index(20.0)])
    free, later = ends_m[4], ends_m[-1]
    assert ends_m[6] < 2 * free + 0.02, "20 m ahead were seen 2 m ago"
    assert later > 5 * free, "15 m later they were not"
