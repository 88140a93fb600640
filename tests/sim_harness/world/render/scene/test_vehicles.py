"""Vehicles are drawn where the camera model puts them, with their shadow."""

import numpy as np
import pytest

from sim_harness.world.render.scene.vehicles import Body, draw_lead
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


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
