"""The canonical view of a camera."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.net.canonical import SUPERSAMPLE, CanonicalView, crop_camera
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CANONICAL = crop_camera(CAMERA, top_px=82, bottom_px=202, width_px=200, height_px=66)
LANE = Lane(offset_m=0.3, heading_rad=0.02, curvature_1pm=0.01, curvature_rate_1pm2=-0.0004)


def ground_picture(camera: Camera) -> np.ndarray:
    """The image of ``camera`` of a smooth pattern painted on the road."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    x, y = camera.road_from_pixel(np.column_stack([u.ravel(), v.ravel()])).T
    scale = camera.height_m / CAMERA.height_m  # the pattern grows with the camera's height
    x = (x - camera.x_m) / scale
    y = (y - camera.y_m) / scale
    grey = 128 + 60 * np.sin(6 / np.sqrt(x)) + 60 * np.cos(0.8 * y) * np.minimum(4 / x, 1)
    grey = np.nan_to_num(grey, nan=60.0).reshape(u.shape).clip(0, 255).astype(np.uint8)
    return cv2.merge([grey] * 3)


def test_the_default_camera_is_only_cropped_and_resized():
    picture = ground_picture(CAMERA)
    seen = CanonicalView(CAMERA, CANONICAL).image(picture).astype(float)
    columns, rows = np.arange(SUPERSAMPLE * 200), np.arange(SUPERSAMPLE * 66)
    u, v = np.meshgrid((columns + 0.5) * 320 / 400 - 0.5, 82 + (rows + 0.5) * 120 / 132 - 0.5)
    plain = cv2.remap(picture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR).astype(float)
    plain = plain.reshape(66, 2, 200, 2, 3).mean(axis=(1, 3))
    assert seen.shape == (66, 200, 3)
    assert np.abs(seen - plain).max() <= 3  # interpolation in 1/32 pixels


@pytest.mark.parametrize(
    "change",
    [
        dict(pitch_down_rad=0.20),
        dict(pitch_down_rad=0.09, yaw_rad=0.05),
        dict(fx_px=230.0, fy_px=225.0, cx_px=150.0, cy_px=125.0),
        dict(height_m=2.1),
        dict(x_m=2.0, y_m=0.4),
        dict(width_px=1280, height_px=960, fx_px=760.0, fy_px=760.0, cx_px=641.5, cy_px=481.5),
    ],
)
def test_every_camera_gives_the_same_canonical_image_of_the_same_scene(change):
    camera = CAMERA.model_copy(update=change)
    seen = CanonicalView(camera, CANONICAL).image(ground_picture(camera)).astype(float)
    wanted = CanonicalView(CAMERA, CANONICAL).image(ground_picture(CAMERA)).astype(float)
    below_horizon = slice(16, 50)
    common = (seen.min(axis=2) > 0)[below_horizon]  # the other camera does not cover the whole image
    assert common.mean() > 0.8
    assert np.abs(seen - wanted)[below_horizon][common].mean() < 4


def test_the_default_camera_leaves_the_lane_unchanged():
    assert CanonicalView(CAMERA, CANONICAL).lane(LANE) == LANE


@given(
    height_m=st.floats(0.3, 4.0),
    x_m=st.floats(-1.0, 3.0),
    y_m=st.floats(-1.0, 1.0),
    ahead_m=st.floats(2.0, 15.0),
)
@settings(max_examples=50, deadline=None)
def test_the_lane_of_a_camera_elsewhere_scales_with_its_height(height_m, x_m, y_m, ahead_m):
    camera = CAMERA.model_copy(update=dict(height_m=height_m, x_m=x_m, y_m=y_m))
    view = CanonicalView(camera, CANONICAL)
    lane = view.lane(LANE)
    assert view.canonical_lane(lane)[:4] == pytest.approx(LANE[:4], abs=1e-9)
    scale = height_m / CANONICAL.height_m
    # A point of the lane centre ahead_m before the canonical camera, and the same one before the true camera.
    canonical_y_m = LANE.y_m(CANONICAL.x_m + ahead_m)
    assert lane.y_m(x_m + scale * ahead_m) == pytest.approx(y_m + scale * canonical_y_m, abs=1e-9)


def test_a_camera_at_twice_the_height_doubles_lengths_and_halves_curvature():
    high = CAMERA.model_copy(update=dict(height_m=2 * CAMERA.height_m, x_m=2 * CAMERA.x_m))
    lane = CanonicalView(high, CANONICAL).lane(LANE)
    assert lane.offset_m == pytest.approx(2 * LANE.offset_m)
    assert lane.heading_rad == pytest.approx(LANE.heading_rad)
    assert lane.curvature_1pm == pytest.approx(LANE.curvature_1pm / 2)
    assert lane.curvature_rate_1pm2 == pytest.approx(LANE.curvature_rate_1pm2 / 4)


def test_cropping_keeps_the_horizon_where_it_is_in_the_scene():
    assert 81.5 + (CANONICAL.horizon_row_px + 0.5) * 120 / 66 == pytest.approx(CAMERA.horizon_row_px)
    assert CANONICAL.fx_px / CAMERA.fx_px == pytest.approx(200 / 320)
    assert math.isclose(CANONICAL.pitch_down_rad, CAMERA.pitch_down_rad)
