"""Streets drawn for a dash camera whose height and horizon are guesses."""

import cv2
import numpy as np
import pytest
from drawn_road_rig import ASPHALT, CAMERA, GRASS, SETTINGS, WHITE, ribbon, road

from perception.lane.model.geometry import PSI, WIDTH, E
from perception.lane.street.pairs import BoundaryKind
from perception.lane.street_finder import horizon_of, street_lane

DASHCAM = CAMERA.model_copy(
    update=dict(
        fx_px=288.0, fy_px=288.0, height_m=1.3, pitch_down_rad=0.02, cx_px=159.5, cy_px=119.5, x_m=1.7
    )
)
PAVEMENT = (165, 165, 165)


def find_street(image, camera=DASHCAM, **kwargs):
    return street_lane(image, camera, SETTINGS, height_sigma=0.2, **kwargs)


def two_ways(lane=(0.0, 0.0, 0.0, 0.0), camera=DASHCAM, seed=0):
    """A street of two ways of 3.2 m between pavements, its dashed centre line on the right: left-hand traffic."""
    image = np.full((camera.height_px, camera.width_px, 3), GRASS, np.uint8)
    image[: round(camera.horizon_row_px)] = (220, 180, 150)
    ribbon(image, camera, lane, -1.6, 14.0, PAVEMENT)
    ribbon(image, camera, lane, 0.0, 3.2, ASPHALT)
    ribbon(image, camera, lane, -3.2, 3.2, ASPHALT)
    ribbon(image, camera, lane, -1.6, 0.12, WHITE, lambda station_m: station_m % 6 < 2)
    noise = np.random.default_rng(seed).normal(0, 3, image.shape)
    return np.clip(cv2.GaussianBlur(image, (3, 3), 0) + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("offset_m", [-0.4, 0.0, 0.4])
def test_the_lines_of_a_plain_lane_are_its_pair(offset_m):
    lane = find_street(road((offset_m, 0.0, 0.0, 0.0), camera=DASHCAM))
    assert lane.pair.left.kind == lane.pair.right.kind == BoundaryKind.LINE
    assert lane.pair.width_m == pytest.approx(3.4, abs=0.25)
    assert lane.pair.offset_m == pytest.approx(offset_m, abs=0.1)
    assert lane.fit.state.mean[WIDTH] == pytest.approx(3.4, abs=0.1)
    assert lane.fit.state.mean[E] == pytest.approx(offset_m, abs=0.08)


def test_of_a_street_of_two_ways_the_half_of_the_car_is_the_lane():
    lane = find_street(two_ways())
    assert (lane.pair.left.kind, lane.pair.right.kind) == (BoundaryKind.STEP, BoundaryKind.LINE)
    assert [lane.pair.left.left_m, lane.pair.right.left_m] == pytest.approx([1.6, -1.6], abs=0.2)


def test_the_mirrored_street_has_the_mirrored_lane():
    one = find_street(two_ways()).pair
    other = find_street(np.ascontiguousarray(two_ways()[:, ::-1])).pair
    assert other.left.kind == one.right.kind and other.right.kind == one.left.kind
    assert [other.left.left_m, other.right.left_m] == pytest.approx(
        [-one.right.left_m, -one.left.left_m], abs=0.15
    )


@pytest.mark.parametrize("pitch_rad", [0.0, 0.02, 0.04])
def test_the_horizon_of_the_street_is_found_from_a_guess_one_step_away(pitch_rad):
    camera = DASHCAM.model_copy(update={"pitch_down_rad": pitch_rad})
    guess = DASHCAM.model_copy(update={"pitch_down_rad": 0.02})
    lane = find_street(road((0.0, 0.0, 0.0, 0.0), camera=camera), guess)
    step = SETTINGS.street.search.horizon_step
    assert lane.profile.course.horizon == pytest.approx(horizon_of(camera), abs=0.75 * step)
    assert horizon_of(lane.camera) == pytest.approx(lane.profile.course.horizon)
    assert lane.fit.state.mean[PSI] == pytest.approx(0.0, abs=0.03)


def test_a_camera_of_unknown_height_sees_lanes_as_wide_as_its_assumed_height_says():
    lower = DASHCAM.model_copy(update={"height_m": 1.0})
    lane = find_street(road((0.0, 0.0, 0.0, 0.0), camera=lower), DASHCAM)
    assert lane.pair.width_m == pytest.approx(3.4 * 1.3, rel=0.06)
    assert lane.pair.height * lane.pair.width_m < lane.pair.width_m - 0.2


def test_a_plain_surface_has_no_lane():
    assert find_street(np.full((240, 320, 3), 90, np.uint8)) is None


def test_a_large_image_has_the_lane_of_the_small_one():
    image = two_ways()
    large = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR).astype(np.uint8)
    one, other = find_street(image), find_street(large, DASHCAM.resize(640, 480))
    assert other.pair.left.left_m == pytest.approx(one.pair.left.left_m, abs=0.15)
    assert other.pair.right.left_m == pytest.approx(one.pair.right.left_m, abs=0.15)
    assert other.camera.width_px == 640
