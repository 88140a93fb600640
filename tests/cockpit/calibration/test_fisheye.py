"""A fisheye from drawn boards to the picture that perception sees, against the projection of OpenCV."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from chessboard_rig import CORNERS, FISHEYE, FISHEYE_MATRIX, FISHEYE_POSES, SIZE_PX, draw_board
from drive_rig import run
from hypothesis import given, settings
from hypothesis import strategies as st

from cockpit.calibration.chessboard import Intrinsics, intrinsics
from cockpit.calibration.fisheye import MOST_RAD, corner_radius, fit_quotient
from perception.lane.view import undistortion_maps
from sim_harness.world.render.optics.lens import distort_pixels, undistort_pixels
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

MOUNTED = load(CONFIG_DIR / "camera.yaml", Camera)
ZERO = np.zeros(3)


def camera_of(distortion: tuple[float, ...]) -> Camera:
    return MOUNTED.model_copy(
        update={
            "width_px": SIZE_PX[0],
            "height_px": SIZE_PX[1],
            "fx_px": FISHEYE_MATRIX[0, 0],
            "fy_px": FISHEYE_MATRIX[1, 1],
            "cx_px": FISHEYE_MATRIX[0, 2],
            "cy_px": FISHEYE_MATRIX[1, 2],
            "distortion": distortion,
        }
    )


CAMERA = camera_of(fit_quotient(FISHEYE.tolist(), corner_radius(FISHEYE_MATRIX, SIZE_PX))[0])


@pytest.fixture(scope="module")
def boards() -> dict[str, np.ndarray]:
    return {f"{number}.png": draw_board(*pose, fisheye=True) for number, pose in enumerate(FISHEYE_POSES)}


@pytest.fixture(scope="module")
def lens(boards: dict[str, np.ndarray]) -> Intrinsics:
    return intrinsics(boards, CORNERS, fisheye=True)


def ray(angle_rad: float, around_rad: float) -> np.ndarray:
    aside = math.tan(angle_rad)
    return np.array([aside * math.cos(around_rad), aside * math.sin(around_rad), 1.0])


def by_opencv(rays: np.ndarray, matrix: np.ndarray = FISHEYE_MATRIX, k: np.ndarray = FISHEYE) -> np.ndarray:
    """The pixels of a fisheye, by OpenCV's own model."""
    return cv2.fisheye.projectPoints(rays[:, None], ZERO, ZERO, matrix, k)[0][:, 0]


def straight(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """The pixels of ``rays`` in the plane image without distortion."""
    seen = rays @ camera.intrinsics.T
    return seen[:, :2] / seen[:, 2:]


@settings(deadline=None)
@given(angle_rad=st.floats(0.0, 1.2), around_rad=st.floats(0.0, 2 * math.pi))
def test_pixel_and_ray_of_the_camera_file_are_those_of_a_fisheye_of_opencv(
    angle_rad: float, around_rad: float
):
    rays = ray(angle_rad, around_rad)[None]
    pixel = by_opencv(rays)
    if not ((pixel >= 0) & (pixel <= np.array(SIZE_PX) - 1)).all():
        return
    plane = straight(CAMERA, rays)
    assert np.abs(distort_pixels(CAMERA, plane) - pixel).max() < 0.5
    back = undistort_pixels(CAMERA, pixel)
    found = np.append((back - (CAMERA.cx_px, CAMERA.cy_px)) / (CAMERA.fx_px, CAMERA.fy_px), 1.0)
    found /= np.linalg.norm(found)
    assert np.arccos(min(1.0, found @ rays[0] / np.linalg.norm(rays[0]))) < 0.5 / FISHEYE_MATRIX[1, 1] * 1.5


def test_the_lens_is_recovered_from_drawn_boards(lens: Intrinsics):
    assert lens.reprojection_px < 0.15 and len(lens.boards) >= 8
    assert lens.matrix[[0, 1], [0, 1]] == pytest.approx([232.0, 229.0], rel=5e-3)
    assert lens.matrix[:2, 2] == pytest.approx([243.0, 177.0], abs=1.0)
    rays = np.array([ray(a, b) for a in np.linspace(0.0, 1.1, 8) for b in np.linspace(0.0, 6.0, 12)])
    wanted = by_opencv(rays)
    inside = ((wanted >= 0) & (wanted <= np.array(SIZE_PX) - 1)).all(axis=1)
    found = cv2.projectPoints(rays, ZERO, ZERO, lens.matrix, lens.distortion)[0][:, 0]
    assert inside.sum() > 50 and np.abs(found - wanted)[inside].max() < 1.0


def test_the_doubt_of_the_focal_length_covers_its_error(lens: Intrinsics):
    off = np.abs(lens.matrix[[0, 1], [0, 1]] - FISHEYE_MATRIX[[0, 1], [0, 1]])
    assert (off < 6 * lens.doubts[:2]).all() and lens.focal_doubt < 0.01


def test_towards_the_corners_the_usual_lens_model_is_farther_off_than_that_of_a_fisheye(boards, lens):
    rays = np.array([ray(a, b) for a in (1.15, 1.2, 1.25) for b in np.linspace(0.0, 6.28, 80)])
    wanted = by_opencv(rays)
    inside = ((wanted >= 0) & (wanted <= np.array(SIZE_PX) - 1)).all(axis=1)
    off_px = {
        name: np.abs(cv2.projectPoints(rays, ZERO, ZERO, one.matrix, one.distortion)[0][:, 0] - wanted)[
            inside
        ].max()
        for name, one in {"usual": intrinsics(boards, CORNERS), "fisheye": lens}.items()
    }
    assert inside.sum() > 10 and off_px["usual"] > 3 * off_px["fisheye"]


def test_calibrate_writes_a_camera_file_that_loads_and_sees_as_the_fisheye(boards, tmp_path: Path, capsys):
    for name, image in boards.items():
        cv2.imwrite(str(tmp_path / name), image)
    out = tmp_path / "camera.yaml"
    words = ("camera", "calibrate", str(tmp_path), "--corners", "7x5", "--fisheye", "--out", str(out))
    assert run(*words) == 0 and "a fisheye" in capsys.readouterr().out
    camera = load(out, Camera)
    rays = np.array([ray(a, b) for a in (0.2, 0.6, 1.0) for b in np.linspace(0.0, 6.0, 12)])
    wanted = by_opencv(rays)
    inside = ((wanted >= 0) & (wanted <= np.array(SIZE_PX) - 1)).all(axis=1)
    assert np.abs(distort_pixels(camera, straight(camera, rays)) - wanted)[inside].max() < 1.0


def test_a_fisheye_without_boards_is_refused_in_one_line(tmp_path: Path, capsys):
    assert run("camera", "calibrate", "--straight", str(tmp_path / "clip.mp4"), "--fisheye") == 2
    err = capsys.readouterr().err
    assert "--fisheye: needs images of a chessboard" in err and err.count("\n") == 1


def test_a_rendered_picture_of_a_fisheye_is_straightened_to_that_of_a_pinhole():
    """Perception sees through a fisheye what a plane camera at its place sees."""
    road = load_road("circuit")
    plane = CAMERA.model_copy(update={"distortion": ()})
    images = {}
    for name, camera in {"fisheye": CAMERA, "pinhole": plane}.items():
        images[name] = Renderer(road, camera, seed=1).render(0.0, 0.0, 0.0, t_s=0.0)
    maps = undistortion_maps(CAMERA)
    assert maps is not None
    straightened = cv2.remap(images["fisheye"], *maps, cv2.INTER_LINEAR)
    middle = np.s_[60:300, 60:420]
    off = np.abs(straightened[middle].astype(int) - images["pinhole"][middle]).mean()
    bent = np.abs(images["fisheye"][middle].astype(int) - images["pinhole"][middle]).mean()
    assert off < 6.0 < bent


def test_a_lens_that_shows_two_rays_at_one_pixel_has_no_quotient():
    assert fit_quotient((-0.9, 0.0, 0.0, 0.0), 1.5)[1] == math.inf
    assert math.pi / 2 > MOST_RAD
