import cv2
import numpy as np
import pytest

from perception.camera.self_calibration import Horizon, LooksDown, meet_above, typical_camera
from perception.estimators import lane_cv_settings

SETTINGS = lane_cv_settings().self_calibration
HEIGHT_PX, WIDTH_PX = 180, 320


def road(horizon, middle=0.5, count=4):
    """Lines that meet at a row, a share of the height; the places of their lower ends are spread evenly."""
    image = np.full((HEIGHT_PX, WIDTH_PX), 80, np.uint8)
    top = (round(middle * WIDTH_PX), round(horizon * HEIGHT_PX))
    for at in np.linspace(-0.2, 1.2, count):
        cv2.line(image, top, (round(at * WIDTH_PX), HEIGHT_PX), 230, 2, cv2.LINE_AA)
    return image


def slanted_lines(angle_deg):
    """Long parallel lines that meet nowhere, as on a wall."""
    image = np.full((HEIGHT_PX, WIDTH_PX), 80, np.uint8)
    slope = np.tan(np.radians(angle_deg))
    for at in range(-200, WIDTH_PX, 60):
        cv2.line(image, (at, 0), (round(at + HEIGHT_PX / slope), HEIGHT_PX), 230, 2, cv2.LINE_AA)
    return image


@pytest.mark.parametrize("share", [0.42, 0.52, 0.62])
def test_the_horizon_of_a_drive_is_that_of_its_roads_wherever_the_vehicle_heads(share):
    horizon = Horizon(SETTINGS)
    for middle in (0.4, 0.5, 0.6, 0.45):
        found = horizon.update(road(share, middle))
    assert found == pytest.approx(share, abs=0.02)


def test_frames_without_a_road_do_not_move_a_horizon_that_many_frames_show():
    horizon = Horizon(SETTINGS)
    for _ in range(8):
        before = horizon.update(road(0.6))
    assert horizon.update(slanted_lines(50)) == pytest.approx(before, abs=0.02)
    assert horizon.update(np.full((HEIGHT_PX, WIDTH_PX), 80, np.uint8)) == pytest.approx(before, abs=0.02)


def test_a_wrong_first_frame_is_outvoted_by_those_that_follow():
    horizon = Horizon(SETTINGS)
    first = horizon.update(road(0.40, count=3))
    for _ in range(8):
        found = horizon.update(road(0.62))
    assert first < 0.45 and found == pytest.approx(0.62, abs=0.02)


def test_without_any_frame_of_a_road_the_horizon_is_the_usual_one():
    assert Horizon(SETTINGS).update(np.zeros((8, 8), np.uint8)) == SETTINGS.horizon_share


def test_a_typical_camera_sees_the_horizon_at_the_given_row():
    camera = typical_camera(WIDTH_PX, HEIGHT_PX, 0.6, SETTINGS)
    assert camera.horizon_row_px / HEIGHT_PX == pytest.approx(0.6, abs=0.005)


def test_after_the_first_frames_every_fifth_one_counts_and_the_others_keep_the_horizon():
    horizon = Horizon(SETTINGS)
    for _ in range(SETTINGS.horizon_known):
        known = horizon.update(road(0.45))
    found = [horizon.update(road(0.6)) for _ in range(40 * SETTINGS.horizon_every)]
    moved = np.flatnonzero(np.diff([known, *found]))
    assert found[-1] == pytest.approx(0.6, abs=0.02)
    assert (moved % SETTINGS.horizon_every == 0).all()


@pytest.mark.parametrize("above", [-0.2, -0.4, -0.7])
def test_lines_that_meet_above_the_image_show_a_camera_that_looks_far_down(above):
    assert meet_above(road(above), SETTINGS)


@pytest.mark.parametrize("image", [road(0.1), road(0.4, 0.3), road(0.6), slanted_lines(50), road(0.5) * 0])
def test_a_horizon_in_the_image_walls_and_nothing_are_no_lines_that_meet_above_it(image):
    assert not meet_above(image, SETTINGS)


def test_most_frames_of_a_drive_say_whether_its_camera_looks_down():
    seen = LooksDown(SETTINGS)
    assert [seen.update(road(share)) for share in (-0.4, 0.5, 0.5, -0.4, -0.4)] == [
        True,
        False,
        False,
        False,
        True,
    ]
