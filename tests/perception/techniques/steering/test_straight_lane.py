import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.techniques.steering.lane import straight_lane
from perception.techniques.steering.rule import ImageLine, meeting_point
from trepid.car.camera import Camera

offsets = st.floats(-1.5, 1.5)
headings = st.floats(-0.6, 0.6)


def level_camera(height_m: float) -> Camera:
    return Camera(
        width_px=640, height_px=480, fx_px=500.0, fy_px=480.0, cx_px=321.5, cy_px=238.0,
        x_m=0.0, y_m=0.0, height_m=height_m, pitch_down_rad=0.0, yaw_rad=0.0,
    )  # fmt: skip


def projected_line(camera: Camera, offset_m: float, heading_rad: float, boundary_m: float) -> ImageLine:
    """The line through two projected points of a straight boundary: an oracle without the formula."""
    along = np.array([15.0, 40.0])
    x = along * math.cos(heading_rad) + (boundary_m - offset_m) * math.sin(heading_rad)
    y = -along * math.sin(heading_rad) + (boundary_m - offset_m) * math.cos(heading_rad)
    (u0, v0), (u1, v1) = camera.pixel_from_road(np.column_stack([x, y]))
    m = (u1 - u0) / (v1 - v0)
    return ImageLine(m=m, k=u0 - m * v0)


@settings(max_examples=60, deadline=None)
@given(offset_m=offsets, heading_rad=headings, width_m=st.floats(2.0, 6.0), height_m=st.floats(0.2, 3.0))
def test_two_lines_give_offset_heading_and_width_exactly(offset_m, heading_rad, width_m, height_m):
    # The formulas need square pixels across only: the vertical focal length cancels with the height.
    camera = level_camera(height_m).model_copy(update={"fy_px": 500.0})
    left = projected_line(camera, offset_m, heading_rad, width_m / 2)
    right = projected_line(camera, offset_m, heading_rad, -width_m / 2)
    lane = straight_lane(left, right, focal_px=500.0, centre_x_px=321.5, height_m=height_m)
    assert lane.offset_m == pytest.approx(offset_m, abs=1e-9)
    assert lane.heading_rad == pytest.approx(heading_rad, abs=1e-9)
    assert lane.width_m == pytest.approx(width_m, abs=1e-9)


def mirror(line: ImageLine, width_px: float) -> ImageLine:
    return ImageLine(m=-line.m, k=width_px - line.k)


@given(ml=st.floats(-3, -0.1), mr=st.floats(0.1, 3), kl=st.floats(0, 300), kr=st.floats(0, 300))
def test_the_mirrored_picture_has_the_mirrored_lane(ml, mr, kl, kr):
    left, right = ImageLine(ml, kl), ImageLine(mr, kr)
    one = straight_lane(left, right, focal_px=400, centre_x_px=160, height_m=1.3)
    other = straight_lane(mirror(right, 320), mirror(left, 320), focal_px=400, centre_x_px=160, height_m=1.3)
    assert other.offset_m == pytest.approx(-one.offset_m, abs=1e-9)
    assert other.heading_rad == pytest.approx(-one.heading_rad, abs=1e-9)
    assert other.width_m == pytest.approx(one.width_m, abs=1e-9)


def test_a_vehicle_left_of_centre_and_turned_left_has_positive_offset_and_heading():
    camera = level_camera(1.4).model_copy(update={"fy_px": 500.0})
    left, right = (projected_line(camera, 0.4, 0.1, side * 1.7) for side in (1, -1))
    lane = straight_lane(left, right, focal_px=500.0, centre_x_px=321.5, height_m=1.4)
    assert lane.offset_m > 0 and lane.heading_rad > 0


def test_the_vanishing_point_lies_on_both_lines():
    left, right = ImageLine(-1.3, 400.0), ImageLine(0.9, 20.0)
    x_px, y_px = meeting_point(left, right)
    assert left.x(y_px) == pytest.approx(x_px) and right.x(y_px) == pytest.approx(x_px)


def test_lines_that_do_not_meet_are_no_lane():
    lines = ImageLine(0.5, 10), ImageLine(0.5, 90)
    assert straight_lane(*lines, focal_px=300, centre_x_px=160, height_m=1.2) is None
