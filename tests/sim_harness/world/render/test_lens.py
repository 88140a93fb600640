"""Lens distortion, sensor noise against its model, vehicles against the pinhole."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.world.render.optics.lens import Distortion, distorted, undistorted
from sim_harness.world.render.optics.sensor import coded, noise_sigma, noisy
from sim_harness.world.render.scene.vehicles import Body, draw_lead
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
COEFFICIENT = st.floats(-0.15, 0.15)


@settings(max_examples=30, deadline=None)
@given(COEFFICIENT, st.floats(-0.02, 0.02), st.floats(-0.003, 0.003), st.floats(-0.003, 0.003))
def test_distortion_is_that_of_brown_and_conrady_and_undistortion_inverts_it(k1, k2, p1, p2):
    camera = CAMERA.model_copy(update={"distortion": (k1, k2, p1, p2)})
    pixels = np.random.default_rng(0).uniform((20, 20), (300, 220), (40, 2))
    x, y = ((pixels - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)).T
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    u = camera.cx_px + camera.fx_px * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
    v = camera.cy_px + camera.fy_px * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
    assert distorted(camera, pixels) == pytest.approx(np.column_stack([u, v]), abs=1e-6)
    assert undistorted(camera, distorted(camera, pixels)) == pytest.approx(pixels, abs=1e-3)


@pytest.mark.parametrize("distortion", [(), (-0.1,), (-0.1, 0.02), (-0.1, 0.02, 0.001)])
def test_coefficients_that_the_camera_leaves_out_are_zero(distortion):
    short = CAMERA.model_copy(update={"distortion": distortion})
    full = CAMERA.model_copy(update={"distortion": (*distortion, 0, 0, 0, 0, 0)[:5]})
    corner = np.array([(3.0, 5.0)])
    assert np.array_equal(distorted(short, corner), distorted(full, corner))
    assert np.array_equal(undistorted(short, corner), undistorted(full, corner))


def test_the_pinhole_covers_the_field_of_view_of_the_lens():
    camera = CAMERA.model_copy(update={"distortion": (-0.3, 0.08)})
    pinhole = Distortion(camera).pinhole
    shift = (pinhole.cx_px - camera.cx_px, pinhole.cy_px - camera.cy_px)
    corners = undistorted(camera, np.array([(0.0, 0.0), (319.0, 0.0), (0.0, 239.0), (319.0, 239.0)])) + shift
    assert (corners >= 0).all() and (corners <= (pinhole.width_px - 1, pinhole.height_px - 1)).all()
    assert pinhole.width_px > camera.width_px


@pytest.mark.parametrize("pose", [(9.0, 0.0, 0.0), (16.0, 1.2, 0.0), (30.0, -2.0, 0.0), (14.0, 2.5, 0.3)])
def test_a_vehicle_fills_its_projected_box(pose):
    body = Body(bgr=(255, 255, 255))
    image = np.zeros((240, 320, 3), np.uint8)
    draw_lead(image, CAMERA, body, pose)
    x, y, yaw = pose
    corners = []
    for a in (body.rear_m, body.front_m):
        for b in (-body.width_m / 2, body.width_m / 2):
            point = (x + a * np.cos(yaw) - b * np.sin(yaw), y + a * np.sin(yaw) + b * np.cos(yaw))
            for height_m in (body.clearance_m, body.waist_m):
                below = CAMERA.model_copy(update={"height_m": CAMERA.height_m - height_m})
                corners.append(below.pixel_from_road([point])[0])
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    columns = np.flatnonzero((image > 60).any(axis=(0, 2)))
    assert (columns[0], columns[-1]) == pytest.approx((low[0], high[0]), abs=1)


def test_a_vehicle_has_its_projected_height():
    body, image = Body(bgr=(255, 255, 255)), np.zeros((240, 320, 3), np.uint8)
    draw_lead(image, CAMERA, body, (15.0, 0.0, 0.0))
    at_roof = CAMERA.model_copy(update={"height_m": CAMERA.height_m - body.height_m})
    roof = at_roof.pixel_from_road([(15.0 + body.rear_m + 0.25, 0.0), (15.0 + body.front_m - 1.5, 0.0)])
    assert np.flatnonzero((image > 60).any(axis=(1, 2)))[0] == pytest.approx(roof[:, 1].min(), abs=1)


def test_the_road_below_a_vehicle_lies_in_its_shadow():
    image = np.full((240, 320, 3), 120, np.uint8)
    draw_lead(image, CAMERA, Body(), (12.0, 0.0, 0.0))
    v = round(CAMERA.pixel_from_road([(12.0 - 0.95, 0.0)])[0, 1])
    assert image[v, 155:165].mean() < 100
    assert image[v, 100:110].mean() == 120 == image[v + 15, 155:165].mean()


def test_a_vehicle_beside_the_camera_is_clipped_at_the_image_plane():
    image = np.zeros((240, 320, 3), np.uint8)
    draw_lead(image, CAMERA, Body(bgr=(255, 255, 255)), (0.5, 2.6, 0.0))
    assert image[:, :80].any() and not image[:, 160:].any()


@pytest.mark.parametrize("gain", [4.0, 30.0])
@pytest.mark.parametrize("level", [60, 120, 190])
def test_noise_has_the_deviation_of_shot_and_read_noise(gain, level):
    even = np.full((240, 320, 3), level, np.uint8)
    noise = noisy(even, gain, (1, 2, 3)).astype(float) - level
    assert noise.std() == pytest.approx(noise_sigma(gain)[level], rel=0.05)
    assert abs(noise.mean()) < 0.5


def test_shot_noise_is_the_root_of_the_electrons():
    assert noise_sigma(1.0)[255] == pytest.approx(255 * 0.5 / 9000**0.5, rel=0.01)


def test_jpeg_of_full_quality_changes_little():
    image = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8), (9, 9), 0
    )
    assert np.abs(coded(image, 100).astype(int) - image).mean() < 2
