"""Boundaries that are drawn in the image, and boundaries that are only claimed."""

import numpy as np
import pytest
from drawn_road_rig import CAMERA, road

from perception.lane.detection.shown import visible_share
from perception.lane.model.geometry import LaneState
from perception.lane.model.paths import boundary_paths

WIDTH_M = 3.4


def paths(offset_m=0.0, width_m=WIDTH_M):
    state = LaneState(np.array([offset_m, 0.0, 0.0, 0.0, width_m, 0.0]), np.zeros((6, 6)))
    return boundary_paths(state, CAMERA, reach_m=25.0)


def share(image, **claimed):
    return visible_share(image, *paths(**claimed))


def test_two_solid_lines_are_visible_along_the_whole_lane():
    assert share(road((0.0, 0.0, 0.0, 0.0))) > 0.8


def test_of_a_dashed_line_its_dashes_are_visible():
    assert 0.1 < share(road((0.0, 0.0, 0.0, 0.0), dashed=True, other_lane=1)) < 0.75


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_lane_with_one_line_on_a_wide_road_is_shown_by_the_other_side_only(side):
    image = road((0.0, 0.0, 0.0, 0.0), **{side: None}, other_lane=1 if side == "left" else -1)
    assert share(image) < 0.2


@pytest.mark.parametrize("offset_m", [-0.8, 0.8])
def test_a_lane_claimed_beside_the_lines_is_not_visible(offset_m):
    """Both claimed boundaries lie 0.8 m from the lines, on asphalt or on grass."""
    assert share(road((0.0, 0.0, 0.0, 0.0), verge_m=3.0), offset_m=offset_m) < 0.2


def test_a_light_pavement_beside_the_road_is_visible_as_a_step():
    image = road((0.0, 0.0, 0.0, 0.0), left=None, right=None, verge_m=0.0)
    grass = image[..., 1] > image[..., 2] + 20
    image[grass] = np.clip(image[grass].astype(int) + 60, 0, 255)
    assert share(image) > 0.6


def test_without_enough_rows_or_boundaries_nothing_is_said():
    image = road((0.0, 0.0, 0.0, 0.0))
    assert visible_share(image, (), ()) is None
    left, right = paths()
    assert visible_share(image, left, ()) is None
    rows = max(y for _, y in left)
    short = [tuple(point for point in path if point[1] > rows - 2) for path in (left, right)]
    assert visible_share(image, *short) is None


def test_a_larger_image_of_the_same_road_shows_the_same():
    big = CAMERA.resize(2 * CAMERA.width_px, 2 * CAMERA.height_px)
    image = road((0.0, 0.0, 0.0, 0.0), dashed=True, camera=big)
    state = LaneState(np.array([0.0, 0.0, 0.0, 0.0, WIDTH_M, 0.0]), np.zeros((6, 6)))
    small = share(road((0.0, 0.0, 0.0, 0.0), dashed=True))
    assert visible_share(image, *boundary_paths(state, big, reach_m=25.0)) == pytest.approx(small, abs=0.15)
