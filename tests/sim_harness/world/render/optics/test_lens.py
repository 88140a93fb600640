"""Lens distortion against its model and its inverse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.world.render.optics.lens import Distortion, distort_pixels, undistort_pixels
from trepid.car.camera import Camera
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
    assert distort_pixels(camera, pixels) == pytest.approx(np.column_stack([u, v]), abs=1e-6)
    assert undistort_pixels(camera, distort_pixels(camera, pixels)) == pytest.approx(pixels, abs=1e-3)


@pytest.mark.parametrize("distortion", [(), (-0.1,), (-0.1, 0.02), (-0.1, 0.02, 0.001)])
def test_coefficients_that_the_camera_leaves_out_are_zero(distortion):
    short = CAMERA.model_copy(update={"distortion": distortion})
    full = CAMERA.model_copy(update={"distortion": (*distortion, 0, 0, 0, 0, 0)[:5]})
    corner = np.array([(3.0, 5.0)])
    assert np.array_equal(distort_pixels(short, corner), distort_pixels(full, corner))
    assert np.array_equal(undistort_pixels(short, corner), undistort_pixels(full, corner))


def test_the_pinhole_covers_the_field_of_view_of_the_lens():
    camera = CAMERA.model_copy(update={"distortion": (-0.3, 0.08)})
    pinhole = Distortion(camera).pinhole
    shift = (pinhole.cx_px - camera.cx_px, pinhole.cy_px - camera.cy_px)
    corners = (
        undistort_pixels(camera, np.array([(0.0, 0.0), (319.0, 0.0), (0.0, 239.0), (319.0, 239.0)])) + shift
    )
    assert (corners >= 0).all() and (corners <= (pinhole.width_px - 1, pinhole.height_px - 1)).all()
    assert pinhole.width_px > camera.width_px
