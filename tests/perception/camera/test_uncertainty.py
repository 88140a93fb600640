import math
from dataclasses import replace

import numpy as np
import pytest

from perception.camera.ground_fit import Optics
from perception.camera.uncertainty import CameraBelief, believed_camera, with_camera_doubt
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.messages import SIGMA_AHEAD_M, SteeringEstimate

BELIEF = CameraBelief(1.3, 0.2, 430.0, 0.15)
OPTICS = Optics(
    focal_height_pxm=500.0,
    focal_height_sigma=0.004,
    focal_px=400.0,
    focal_sigma=0.01,
    horizon_px=6.0,
    aside_px=-9.0,
)
CAMERA = Camera(
    width_px=480, height_px=360, fx_px=430.0, fy_px=430.0, cx_px=239.5, cy_px=179.5,
    x_m=1.7, y_m=0.0, height_m=1.3, pitch_down_rad=0.03, yaw_rad=0.0,
)  # fmt: skip


def test_the_hypotheses_are_equally_likely_heights():
    drawn = 1.3 * np.exp(0.2 * np.random.default_rng(1).normal(size=200_000))
    quarters = np.split(np.sort(drawn), 4)
    assert BELIEF.heights_m == pytest.approx([np.median(quarter) for quarter in quarters], rel=0.01)


def test_a_lane_width_moves_the_height_towards_the_one_that_fits_and_narrows_the_belief():
    true_m = 1.6
    after = BELIEF.given_width(3.4 / true_m, width_m=3.4, width_sigma_m=0.35)
    assert after.height_m == pytest.approx(true_m, rel=0.06) and after.height_m < true_m
    assert after.height_sigma < 0.1


def test_the_belief_after_a_width_is_the_product_of_both_densities():
    after = BELIEF.given_width(2.2, width_m=3.4, width_sigma_m=0.35)
    log_h = np.linspace(math.log(0.4), math.log(4.0), 20_001)
    density = np.exp(
        -0.5 * ((log_h - math.log(1.3)) / 0.2) ** 2
        - 0.5 * ((log_h - math.log(3.4 / 2.2)) / (0.35 / 3.4)) ** 2
    )
    mean = np.average(log_h, weights=density)
    assert math.log(after.height_m) == pytest.approx(mean, abs=1e-4)
    assert after.height_sigma == pytest.approx(
        np.sqrt(np.average((log_h - mean) ** 2, weights=density)), abs=1e-4
    )


def test_the_width_of_a_road_of_two_lanes_does_not_change_the_belief():
    assert BELIEF.given_width(7.0 / 1.3, width_m=3.4, width_sigma_m=0.35) == BELIEF


def test_a_width_says_nothing_about_the_focal_length():
    after = BELIEF.given_width(3.4 / 1.6, width_m=3.4, width_sigma_m=0.35)
    assert (after.focal_px, after.focal_sigma) == pytest.approx((430.0, 0.15)) and after.correlation == 0.0


def test_odometry_with_turns_gives_both_and_the_height_is_their_quotient():
    after = BELIEF.given_optics(OPTICS)
    assert after.focal_px == pytest.approx(400.0, rel=0.01)
    assert after.height_m == pytest.approx(500.0 / 400.0, rel=0.01)
    assert after.height_sigma < 0.05 and after.focal_sigma < 0.03


def test_a_way_alone_narrows_height_and_focal_length_by_their_product():
    way = replace(OPTICS, focal_px=None, focal_sigma=math.inf)
    after = BELIEF.given_optics(way)
    grid = np.linspace(-1, 1, 801)
    h, f = np.meshgrid(math.log(1.3) + grid, math.log(430.0) + grid, indexing="ij")
    density = np.exp(
        -0.5 * ((h - math.log(1.3)) / 0.2) ** 2
        - 0.5 * ((f - math.log(430.0)) / 0.15) ** 2
        - 0.5 * ((h + f - math.log(500.0)) ** 2 / (0.004**2 + 0.03**2))
    )
    mean = np.average(h, weights=density)
    assert math.log(after.height_m) == pytest.approx(mean, abs=1e-3)
    assert after.height_sigma == pytest.approx(
        np.sqrt(np.average((h - mean) ** 2, weights=density)), abs=1e-3
    )
    assert after.correlation < -0.9


@pytest.mark.parametrize("factor", [0.55, 1.8])
def test_the_way_at_a_wrong_speed_changes_nothing(factor):
    way = replace(OPTICS, focal_height_pxm=1.3 * 430.0 * factor, focal_px=None, focal_sigma=math.inf)
    assert BELIEF.given_optics(way) is BELIEF


def test_the_camera_is_turned_to_the_measured_horizon_and_direction():
    camera = believed_camera(CAMERA, BELIEF.given_optics(OPTICS), OPTICS)
    assert camera.horizon_row_px == pytest.approx(CAMERA.horizon_row_px - 6.0)
    ahead_px = camera.pixel_from_road([[1e6, 0.0]])[0]
    assert ahead_px[0] == pytest.approx(CAMERA.cx_px + 9.0, abs=0.1)
    assert camera.fx_px == camera.fy_px == pytest.approx(400.0, rel=0.01)
    assert believed_camera(CAMERA, BELIEF, None) == CAMERA


def lane_of_pixels(camera: Camera, pixels: np.ndarray) -> Lane:
    """The clothoid through points of a lane centre that have these ``pixels``; the axle is below the camera."""
    x, y = camera.road_from_pixel(pixels).T
    e, psi, kappa, rate = np.linalg.lstsq(np.column_stack([-(x**0), -x, x**2 / 2, x**3 / 6]), y, rcond=None)[
        0
    ]
    return Lane(e, psi, kappa, rate)


@pytest.mark.parametrize(("height", "focal"), [(1.01, 1.0), (1.0, 1.01)])
def test_the_place_of_a_lane_varies_with_the_camera_as_a_camera_with_other_values_sees_it(height, focal):
    true = CAMERA.model_copy(update={"x_m": 0.0, "pitch_down_rad": 0.0})
    lane = Lane(0.4, 0.03, 0.004, 1e-5)
    x = np.linspace(5.0, 30.0, 40)
    pixels = true.pixel_from_road(np.column_stack([x, [lane.y_m(at) for at in x]]))
    other = true.model_copy(update={"height_m": 1.3 * height, "fx_px": 430 * focal, "fy_px": 430 * focal})
    moved = [abs(lane_of_pixels(other, pixels).y_m(at) - lane.y_m(at)) for at in SIGMA_AHEAD_M]
    belief = CameraBelief(1.3, math.log(height), 430.0, math.log(focal))
    assert np.sqrt(belief.place_variance_m2(lane, SIGMA_AHEAD_M)) == pytest.approx(moved, rel=0.03, abs=1e-4)


def test_the_doubt_of_the_camera_is_added_to_that_of_the_lane():
    nothing = SteeringEstimate.nothing(0.0, estimator="cv", lookahead_m=8.0, reason="")
    lane = replace(nothing, lateral_offset_m=0.4, heading_error_rad=0.03, curvature_1pm=0.004)
    known = replace(lane, ahead_sigma_m=(0.1,) * len(SIGMA_AHEAD_M))
    doubted = with_camera_doubt(known, BELIEF)
    assert doubted.ahead_sigma_m[0] == pytest.approx(math.hypot(0.1, 0.4 * 0.2))
    assert all(own > 0.1 for own in doubted.ahead_sigma_m)
    assert with_camera_doubt(nothing, BELIEF) is nothing and with_camera_doubt(lane, BELIEF) is lane
