"""Motion blur and rolling shutter against the geometry of rigid motion."""

import math

import numpy as np
import pytest

from sim_harness.world.render.optics.motion import Shake, road_after
from sim_harness.world.render.scene.view import ShutterMotion
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
HORIZON = 96
SHAKE = Shake(CAMERA, HORIZON)
BEND = ShutterMotion(speed_mps=8.0, yaw_rate_radps=0.5)


def move_pixel(matrix, pixel):
    u, v, w = matrix @ (*pixel, 1.0)
    return np.array([u / w, v / w])


def test_the_vehicle_drives_the_arc_of_its_speed_and_yaw_rate():
    x, y, turn, count = 0.0, 0.0, 0.0, 20000
    for _ in range(count):
        x += BEND.speed_mps * math.cos(turn) / count
        y += BEND.speed_mps * math.sin(turn) / count
        turn += BEND.yaw_rate_radps / count
    after = road_after(BEND, 1.0)
    assert after[:2, 2] == pytest.approx([x, y], abs=1e-3)
    assert math.atan2(after[1, 0], after[0, 0]) == pytest.approx(turn)


def test_a_point_of_the_ground_moves_as_the_camera_model_predicts():
    later = np.array([[9.0, 1.5]])  # in the vehicle's axes after 40 ms
    before = road_after(BEND, 0.04) @ (*later[0], 1.0)
    expected = CAMERA.pixel_from_road([before[:2]])[0]
    assert move_pixel(SHAKE.ground(BEND, 0.04), CAMERA.pixel_from_road(later)[0]) == pytest.approx(expected)


def test_consecutive_motions_multiply():
    both = SHAKE.ground(BEND, 0.01) @ SHAKE.ground(BEND, 0.02)
    assert both == pytest.approx(SHAKE.ground(BEND, 0.03), abs=1e-9 * np.abs(both).max())


@pytest.mark.parametrize("yaw_rate_radps", [0.8, -0.8])
def test_a_pole_leans_while_the_vehicle_turns(yaw_rate_radps):
    image = np.zeros((240, 320, 3), np.uint8)
    image[:, 159:162] = 255
    level = CAMERA.model_copy(update={"pitch_down_rad": 0.0})
    rolled = Shake(level, 240).roll(image, ShutterMotion(0.0, yaw_rate_radps), 0.06)[:, :, 0].astype(float)
    columns = (rolled * np.arange(320)).sum(axis=1) / rolled.sum(axis=1)
    expected = 160 + CAMERA.fx_px * np.tan(yaw_rate_radps * 0.06 * np.arange(240) / 240)
    assert columns == pytest.approx(expected, abs=0.3)


def test_a_standing_vehicle_has_no_blur():
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    assert np.array_equal(SHAKE.blur(image, ShutterMotion(), 0.05), image)
    assert np.abs(SHAKE.roll(image, ShutterMotion(), 0.05).astype(int) - image).max() <= 8


def test_a_point_is_blurred_along_its_path():
    image = np.zeros((240, 320, 3), np.uint8)
    image[150, 230] = 255
    speed = ShutterMotion(10.0, 0.0)
    lit = np.argwhere(SHAKE.blur(image, speed, 0.05)[:, :, 0] > 0)
    end = move_pixel(np.linalg.inv(SHAKE.ground(speed, 0.05)), (230.0, 150.0))
    assert lit[:, 1].min() >= 228 and lit[:, 0].min() >= 148
    assert lit[:, 1].max() == pytest.approx(end[0], abs=3) and lit[:, 0].max() == pytest.approx(end[1], abs=3)


def test_motion_blur_keeps_the_brightness_of_a_uniform_image():
    image = np.full((240, 320, 3), 120, np.uint8)
    assert np.abs(SHAKE.blur(image, BEND, 0.08).astype(int) - 120).max() <= 1
