"""Images of turned and mirrored cameras, against the geometry of the camera."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from vehicle.cameras.working import Mount

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera).model_copy(
    update={"cx_px": 171.0, "cy_px": 108.0, "fy_px": 201.0}
)
MOUNTS = st.builds(
    Mount,
    mirror=st.sampled_from(["none", "horizontal", "vertical"]),
    rotate_deg=st.sampled_from([0, 90, 180, 270]),
)


def seen_by_the_sensor(
    camera: Camera, mount: Mount, road_m: np.ndarray
) -> tuple[tuple[int, int], np.ndarray]:
    """Size of the sensor, and the pixel of a road point, for a sensor whose corrected image is that of ``camera``.

    The ray is turned and mirrored, not the image.
    """
    angle = math.radians(mount.rotate_deg)
    turn = np.round([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    flip = np.diag({"none": (1, 1), "horizontal": (-1, 1), "vertical": (1, -1)}[mount.mirror])
    sensor_from_camera = flip @ turn
    position = np.array([camera.x_m, camera.y_m, camera.height_m])
    ray = camera.optical_from_vehicle @ (np.array([*road_m, 0.0]) - position)
    middle = np.array([(camera.width_px - 1) / 2, (camera.height_px - 1) / 2])
    focal = np.abs(sensor_from_camera) @ np.array([camera.fx_px, camera.fy_px])
    size = np.abs(sensor_from_camera) @ np.array([camera.width_px, camera.height_px])
    centre = sensor_from_camera @ (np.array([camera.cx_px, camera.cy_px]) - middle) + (size - 1) / 2
    pixel = focal * (sensor_from_camera @ (ray[:2] / ray[2])) + centre
    return (int(size[0]), int(size[1])), pixel


@given(mount=MOUNTS, ahead_m=st.floats(4, 40), bearing=st.floats(-0.4, 0.4))
def test_a_road_point_projects_to_its_pixel_of_the_corrected_image(
    mount: Mount, ahead_m: float, bearing: float
) -> None:
    road_m = np.array([CAMERA.x_m + ahead_m, bearing * ahead_m])
    (width, height), pixel = seen_by_the_sensor(CAMERA, mount, road_m)
    raw = np.zeros((height, width, 3), np.uint8)
    u, v = np.round(pixel).astype(int)
    raw[v, u] = 255
    upright = mount.upright(raw)
    assert upright.shape[:2] == (CAMERA.height_px, CAMERA.width_px)
    ((row, column),) = np.argwhere(upright[:, :, 0])
    assert np.abs(CAMERA.pixel_from_road(road_m)[0] - (column, row)).max() <= 0.5 + 1e-9


@given(mount=MOUNTS)
def test_correction_changes_places_and_no_values(mount: Mount) -> None:
    raw = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    assert sorted(mount.upright(raw).reshape(-1, 3).tolist()) == sorted(raw.reshape(-1, 3).tolist())


def test_a_turn_of_90_degrees_is_clockwise() -> None:
    raw = np.zeros((2, 3, 3), np.uint8)
    raw[0, 0] = 255  # top left
    assert Mount(rotate_deg=90).upright(raw)[0, -1].tolist() == [255, 255, 255]  # top right


def test_other_angles_are_refused() -> None:
    with pytest.raises(ValidationError):
        Mount.model_validate({"rotate_deg": 45})
