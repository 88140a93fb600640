"""When two vehicles touch, held against OpenCV's intersection of rotated rectangles."""

import math

import cv2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.lockstep.contact import Outline, separation_m

CAR = Outline(0.0, 0.0, 0.0, -1.0, 3.0, 2.0)
places = st.builds(
    Outline,
    x_m=st.floats(-6, 6),
    y_m=st.floats(-6, 6),
    yaw_rad=st.floats(-4, 4),
    rear_m=st.just(-0.8),
    front_m=st.just(3.4),
    width_m=st.just(1.8),
)


def rotated_box(box):
    """The same box as OpenCV has it: middle, size, degrees."""
    size = (box.front_m - box.rear_m, box.width_m)
    return box.at((box.rear_m + box.front_m) / 2), size, math.degrees(box.yaw_rad)


@given(a=places, b=places)
@settings(max_examples=200, deadline=None)
def test_boxes_touch_where_their_rectangles_intersect(a, b):
    gap_m = separation_m(a, b)
    kind, _ = cv2.rotatedRectangleIntersection(rotated_box(a), rotated_box(b))
    if abs(gap_m) > 1e-3:
        assert (gap_m < 0) == (kind != cv2.INTERSECT_NONE)
    assert gap_m == pytest.approx(separation_m(b, a))


@pytest.mark.parametrize(
    ("x_m", "y_m", "yaw_rad", "gap_m"),
    [
        (10.0, 0.0, 0.0, 6.0),  # nose to tail: 10 - 3 - 1
        (10.0, 0.0, math.pi, 4.0),  # nose to nose: 10 - 3 - 3
        (0.0, 2.5, 0.0, 0.5),  # side by side
        (0.0, 1.5, 0.0, -0.5),
        (0.0, 4.0, math.pi / 2, 2.0),  # across: its rear end points at our side
    ],
)
def test_gaps_between_sides_are_distances(x_m, y_m, yaw_rad, gap_m):
    assert separation_m(CAR, Outline(x_m, y_m, yaw_rad, -1.0, 3.0, 2.0)) == pytest.approx(gap_m)


def test_the_corners_are_where_the_sides_meet():
    corners = Outline(1.0, 2.0, math.pi / 2, -1.0, 3.0, 2.0).corners()
    assert sorted((round(x, 9), round(y, 9)) for x, y in corners) == [(0, 1), (0, 5), (2, 1), (2, 5)]
