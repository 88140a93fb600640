"""The pinhole camera on a flat road."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


@given(
    x_m=st.floats(3, 80),
    bearing=st.floats(-0.8, 0.8),
    pitch_rad=st.floats(-0.05, 0.4),
    yaw_rad=st.floats(-0.2, 0.2),
)
def test_a_road_point_survives_the_round_trip_through_the_image(
    x_m: float, bearing: float, pitch_rad: float, yaw_rad: float
) -> None:
    camera = CAMERA.model_copy(update={"pitch_down_rad": pitch_rad, "yaw_rad": yaw_rad})
    point = np.array([[camera.x_m + x_m, bearing * x_m]])
    assert np.allclose(camera.road_from_pixel(camera.pixel_from_road(point)), point, atol=1e-6)


def test_a_level_camera_projects_by_the_closed_form_of_similar_triangles() -> None:
    camera = CAMERA.model_copy(update={"pitch_down_rad": 0.0})
    ((u, v),) = camera.pixel_from_road([[camera.x_m + 10, 2.0]])
    assert u == pytest.approx(camera.cx_px - camera.fx_px * 2 / 10)
    assert v == pytest.approx(camera.cy_px + camera.fy_px * camera.height_m / 10)


def test_left_on_the_road_is_left_in_the_image_and_mirrors() -> None:
    (left, right) = CAMERA.pixel_from_road([[8, 1.5], [8, -1.5]])
    assert left[0] < CAMERA.cx_px < right[0]
    assert left[0] + right[0] == pytest.approx(2 * CAMERA.cx_px)


def test_far_points_approach_the_horizon_from_below() -> None:
    rows = CAMERA.pixel_from_road([[x, 0] for x in (10, 100, 1e4, 1e7)])[:, 1]
    assert np.all(np.diff(rows) < 0)
    assert rows[-1] == pytest.approx(CAMERA.horizon_row_px, abs=1e-3)


def test_the_sky_has_no_place_on_the_road() -> None:
    assert np.isnan(CAMERA.road_from_pixel([[160, CAMERA.horizon_row_px - 1]])).all()


def test_a_point_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(CAMERA.pixel_from_road([[-5, 0]])).all()


def test_yaw_to_the_left_moves_the_road_to_the_right_by_f_tan_yaw() -> None:
    camera = CAMERA.model_copy(update={"pitch_down_rad": 0.0, "yaw_rad": 0.1})
    ((u, _),) = camera.pixel_from_road([[1e7, 0]])
    assert u == pytest.approx(camera.cx_px + camera.fx_px * math.tan(0.1), abs=1e-3)


@pytest.mark.parametrize("size", [(160, 60), (80, 240), (640, 480), (960, 240)])
@pytest.mark.parametrize("interpolation", [cv2.INTER_AREA, cv2.INTER_LINEAR])
def test_a_resized_camera_is_that_of_the_image_that_opencv_resizes(size, interpolation) -> None:
    point, width = [[9, 1.0]], 12.0
    ((u, v),) = CAMERA.pixel_from_road(point)
    row, column = np.indices((CAMERA.height_px, CAMERA.width_px), sparse=True)
    spot = np.exp(-((column - u) ** 2 + (row - v) ** 2) / (2 * width**2))
    small = cv2.resize(spot, size, interpolation=interpolation)
    row, column = np.indices(small.shape, sparse=True)
    seen = [(small * column).sum() / small.sum(), (small * row).sum() / small.sum()]
    assert CAMERA.resize(*size).pixel_from_road(point)[0] == pytest.approx(seen, abs=0.02)


def test_a_camera_that_is_not_resized_is_the_same() -> None:
    assert CAMERA.resize(CAMERA.width_px, CAMERA.height_px) == CAMERA
