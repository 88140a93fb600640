"""Marks of lanes in drawn roads: paint along the boundaries, and what lies across the surface."""

import cv2
import numpy as np
import pytest
from drawn_road_rig import CAMERA, road

from perception.lane.detection.marks import Marks, marks
from perception.lane.model.geometry import LaneState
from perception.lane.model.paths import boundary_paths

WIDTH_M = 3.4
STRAIGHT = (0.0, 0.0, 0.0, 0.0)


def paths(offset_m=0.0):
    state = LaneState(np.array([offset_m, 0.0, 0.0, 0.0, WIDTH_M, 0.0]), np.zeros((6, 6)))
    return boundary_paths(state, CAMERA, reach_m=25.0)


def marks_at(image, offset_m=0.0):
    return marks(image, *paths(offset_m))


def with_lamps(image, turned):
    """White tubes of 1 m by 0.15 m in the lane, along the road or across it."""
    image = image.copy()
    for ahead_m in (5.0, 6.5, 8.0, 10.0):
        half = np.array([0.5, 0.075])[:: -1 if turned else 1]
        corners = [
            (ahead_m + x * half[0], 0.4 + y * half[1]) for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        ]
        pixels = CAMERA.pixel_from_road(np.array(corners))
        cv2.fillPoly(image, [np.round(pixels * 16).astype(np.int32)], (255, 255, 255), cv2.LINE_AA, 4)
    return image


def test_two_solid_lines_lie_along_both_boundaries_and_nothing_lies_inside():
    seen = marks_at(road(STRAIGHT))
    assert seen.along > 0.6
    assert seen.inside < 0.05
    assert abs(seen.rough) < 0.4


@pytest.mark.parametrize("side", ["left", "right"])
def test_paint_on_one_side_is_no_paint_along_both(side):
    assert marks_at(road(STRAIGHT, **{side: None}, other_lane=1 if side == "left" else -1)).along < 0.2


@pytest.mark.parametrize("turned", [False, True])
def test_reflections_of_lamps_on_the_surface_are_marks_that_the_boundaries_do_not_explain(turned):
    clean, lit = road(STRAIGHT), with_lamps(road(STRAIGHT), turned)
    assert marks_at(lit).rough > marks_at(clean).rough + 0.3
    if not turned:  # a tube across the lane is too wide for a mark
        assert marks_at(lit).inside > marks_at(clean).inside + 0.1
    assert marks_at(lit).along == pytest.approx(marks_at(clean).along, abs=0.1)


def test_a_lane_claimed_half_a_lane_beside_has_a_line_inside_and_no_paint_along_it():
    seen = marks_at(road(STRAIGHT, verge_m=3.0), offset_m=WIDTH_M / 2)
    assert seen.inside > 0.6
    assert seen.along < 0.2


def test_the_mirror_image_has_the_same_marks():
    image = with_lamps(road(STRAIGHT), turned=True)
    left, right = paths()
    mirrored = [tuple((image.shape[1] - 1 - x, y) for x, y in side) for side in (right, left)]
    assert marks(np.ascontiguousarray(image[:, ::-1]), *mirrored) == pytest.approx(
        marks(image, left, right), abs=0.1
    )


@pytest.mark.parametrize("gain", [0.5, 1.0])
def test_less_light_changes_the_texture_little(gain):
    image = with_lamps(road(STRAIGHT), turned=True)
    dark = (image * gain).astype(np.uint8)
    assert marks_at(dark).rough == pytest.approx(marks_at(image).rough, abs=0.3)


def test_of_a_lane_that_is_hardly_visible_the_worst_counts():
    image = road(STRAIGHT)
    left, right = paths()
    lowest = max(y for _, y in left)
    short = [tuple(point for point in path if point[1] > lowest - 2) for path in (left, right)]
    assert marks(image, (), ()) == marks(image, left, ()) == marks(image, *short) == Marks()
    assert Marks() == Marks(rough=1.5, inside=1.0, along=0.0)
