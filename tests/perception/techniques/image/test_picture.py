from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from technique_rig import CAMERA, LANE, VIEW, road, straight_boundaries

from perception.techniques.image.picture import (
    Boundaries,
    FrameMotion,
    PixelBox,
    camera_view,
    move_boundaries,
)
from perception.techniques.image.region import near, roi_fixed, roi_speed, roi_tracked
from perception.techniques.image.warp import (
    BirdEyeSelf,
    area_resize,
    bird_eye,
    pitch_change_rad,
    pitch_view,
    view_from_above,
)
from perception.techniques.steering.lane import beside, exact_pair
from perception.techniques.steering.rule import ImageLine, meeting_point

ABOVE = view_from_above(VIEW, reach_m=30.0, half_width_m=8.0, pixel_m=0.08)
CROP = VIEW.crop(PixelBox(100, 240, 20, 300))
VIEWS = {"camera": VIEW, "crop": CROP, "half": VIEW.resize(160, 120), "above": ABOVE}


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
@settings(max_examples=20, deadline=None)
@given(x=st.floats(3.0, 29.0), y=st.floats(-7.0, 7.0))
def test_a_place_on_the_road_is_found_again_from_its_pixel(view, x, y):
    assert view.ground(view.pixels([(x, y)]))[0] == pytest.approx([x, y], abs=1e-6)


def test_a_view_agrees_with_its_camera():
    points = np.array([(5.0, 1.0), (20.0, -3.0)])
    assert VIEW.pixels(points) == pytest.approx(CAMERA.pixel_from_road(points))
    assert VIEW.horizon_px == pytest.approx(CAMERA.horizon_row_px)
    assert CROP.horizon_px == pytest.approx(CAMERA.horizon_row_px - 100)
    assert np.isnan(VIEW.ground([(160, 10)])).all() and np.isnan(VIEW.pixels([(-5.0, 0.0)])).all()


def test_the_width_of_a_pixel_is_that_of_the_pinhole():
    row = 200
    depth = VIEW.ahead_m[row] - CAMERA.x_m
    slant = depth * np.cos(CAMERA.pitch_down_rad) + CAMERA.height_m * np.sin(CAMERA.pitch_down_rad)
    assert VIEW.pixel_m[row] == pytest.approx(slant / CAMERA.fx_px, rel=1e-6)
    assert np.allclose(ABOVE.pixel_m, 0.08)


def test_a_smaller_picture_keeps_the_mean_grey_and_its_geometry():
    image = road(LANE)
    small, view = area_resize(image, VIEW)
    assert small.mean() == pytest.approx(image.mean(), abs=0.5) and small.shape[:2] == (120, 160)
    # Pixel u of the half covers pixels 2u and 2u + 1.
    assert view.pixels([(8.0, 1.0)]) == pytest.approx((VIEW.pixels([(8.0, 1.0)]) - 0.5) / 2)


@pytest.mark.parametrize("heading_rad", [0.0, 0.05, -0.08])
def test_lines_are_parallel_from_above(heading_rad):
    fine = CAMERA.resize(640, 480)
    image, view = bird_eye(road((0.1, heading_rad, 0.0, 0.0), camera=fine), camera_view(fine), pixel_m=0.04)
    excess = np.where(view.seen, np.clip(image[:, :, 0] - 130.0, 0, None), 0)
    rows, columns = np.nonzero(excess)
    x_m, y_m = view.ground(np.column_stack([columns, rows])).T
    slopes = []
    for side in (1, -1):
        here = (side * y_m > 0) & (x_m < 15)
        weight = np.sqrt(excess[rows[here], columns[here]])
        slopes.append(np.polyfit(rows[here], columns[here], 1, w=weight)[0])
    assert np.degrees(np.arctan(slopes)) == pytest.approx(-np.degrees(heading_rad), abs=0.3)
    assert abs(np.degrees(np.arctan(slopes[0]) - np.arctan(slopes[1]))) < 0.2


@pytest.mark.parametrize("error_rad", [0.02, -0.02])
def test_the_pitch_follows_from_the_meeting_point_of_the_lines(error_rad):
    image, wrong = road(LANE), pitch_view(VIEW, error_rad)
    seen = pitch_change_rad(image, wrong)
    assert np.degrees(seen) == pytest.approx(-np.degrees(error_rad), abs=0.3)
    warp = BirdEyeSelf()
    assert warp.step(image, wrong)[1].camera.pitch_down_rad == pytest.approx(CAMERA.pitch_down_rad, abs=0.005)


def test_without_lines_the_pitch_is_kept():
    plain = np.full((240, 320, 3), 90, np.uint8)
    assert pitch_change_rad(plain, VIEW) is None
    assert BirdEyeSelf().step(plain, VIEW)[1].camera.pitch_down_rad == CAMERA.pitch_down_rad


def test_a_pitched_view_is_that_of_the_pitched_camera_also_in_a_part_of_its_picture():
    camera = CAMERA.model_copy(update=dict(pitch_down_rad=CAMERA.pitch_down_rad + 0.03))
    box = PixelBox(100, 240, 20, 300)
    expected = camera_view(camera).crop(box)
    points = [(6.0, 1.0), (15.0, -2.0)]
    assert pitch_view(VIEW.crop(box), 0.03).pixels(points) == pytest.approx(expected.pixels(points))


def test_boundaries_stay_on_the_road_while_the_vehicle_moves():
    here = straight_boundaries(offset_m=0.3, heading_rad=0.1)
    there = move_boundaries(here, FrameMotion(0.1, 10.0, 0.5))
    state = exact_pair(there, VIEW)
    # 1 m along an arc that turns by 0.05: the heading grows by it, the offset by the heading on the way.
    assert state.lane.heading_rad == pytest.approx(0.15, abs=1e-6)
    assert state.lane.offset_m == pytest.approx(0.3 * np.cos(0.1) + np.sin(0.125), abs=1e-4)
    assert move_boundaries(here, FrameMotion(0.1, None, None)).left.y_m == pytest.approx(here.left.y_m)


@settings(max_examples=25, deadline=None)
@given(e=st.floats(-1.0, 1.0), psi=st.floats(-0.2, 0.2), width=st.floats(2.5, 5.0))
def test_the_exact_pair_is_exact_and_mirrors(e, psi, width):
    state = exact_pair(straight_boundaries(e, psi, width), VIEW)
    assert (state.lane.offset_m, state.lane.heading_rad, state.width_m) == pytest.approx(
        (e * np.cos(psi), psi, width), abs=1e-6
    )
    mirrored = exact_pair(straight_boundaries(-e, -psi, width), VIEW)
    assert mirrored.lane.offset_m == pytest.approx(-state.lane.offset_m, abs=1e-9)


@pytest.mark.parametrize("hidden", ["left", "right"])
def test_a_hidden_line_is_put_at_the_width_of_a_lane_not_at_the_border_of_the_picture(hidden):
    both = straight_boundaries(0.1, 0.02)
    one = Boundaries(None if hidden == "left" else both.left, None if hidden == "right" else both.right)
    state = exact_pair(one, VIEW, width_m=3.4)
    assert state.width_m is None
    assert (state.lane.offset_m, state.lane.heading_rad) == pytest.approx((0.1, 0.02), abs=1e-3)
    assert exact_pair(Boundaries(None, None), VIEW) is None
    assert beside(both.left, -3.4).y_m == pytest.approx(both.right.y_m, abs=1e-6)


@settings(max_examples=200, deadline=None)
@given(psi=st.floats(-0.3, 0.3), pitch_rad=st.floats(-0.015, 0.015))
def test_the_fixed_region_contains_the_junction_of_the_boundaries(psi, pitch_rad):
    """Also while the vehicle pitches, which the camera file does not hold."""
    box = roi_fixed(VIEW, None, None).box
    camera = CAMERA.model_copy(update={"pitch_down_rad": CAMERA.pitch_down_rad + pitch_rad})
    left, right = (
        camera.pixel_from_road([[x, y - np.tan(psi) * x] for x in (500.0, 1000.0)]) for y in (1.7, -1.7)
    )
    lines = []
    for (u0, v0), (u1, v1) in (left, right):
        m = (u1 - u0) / (v1 - v0)
        lines.append(ImageLine(m, u0 - m * v0))
    x_px, y_px = meeting_point(*lines)
    assert box.top_px <= y_px < box.bottom_px and box.left_px <= x_px < box.right_px


def test_features_of_the_fixed_region_count_up_to_its_reach():
    region = roi_fixed(VIEW, None, None, reach_m=40.0)
    counted = np.flatnonzero(region.mask.any(axis=1))
    assert VIEW.horizon_px < counted[0] < VIEW.horizon_px + 12 and counted[-1] == 239
    assert region.box.bottom_px == 240 and region.box.top_px > VIEW.horizon_px - 10
    above = replace(VIEW, from_above=True)  # without a horizon
    assert roi_fixed(above, None, None).box.top_px == counted[0]


def test_bands_around_the_prediction_hold_its_lines_in_less_than_half_of_the_picture():
    predicted = straight_boundaries(0.2, 0.03)
    region = roi_tracked(VIEW, predicted, None)
    for side in (predicted.left, predicted.right):
        columns, rows = np.round(VIEW.pixels(np.column_stack([side.x_m, side.y_m]))).astype(int).T
        inside = (columns >= 0) & (columns < 320) & (rows >= region.box.top_px) & (rows < 240)
        assert inside.sum() > 10 and region.mask[rows[inside], columns[inside]].all()
    assert region.mask.sum() < 0.5 * 240 * 320
    assert roi_tracked(VIEW, None, None).mask is None, "without a prediction everything is looked at"
    assert near(VIEW, Boundaries(predicted.left, None), half_width_m=0.3, growth=0).sum() < region.mask.sum()


def test_the_region_reaches_farther_the_faster_the_vehicle_is():
    tops = [roi_speed(VIEW, None, speed).box.top_px for speed in (0.0, 8.0, 16.0, 30.0)]
    assert tops == sorted(tops, reverse=True) and tops[0] > tops[-1]
    assert roi_speed(VIEW, None, None).box.top_px == tops[-1], "an unknown speed may be the highest"
