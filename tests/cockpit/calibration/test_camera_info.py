"""``trepid camera import``: a camera_info of ROS and the camera file show every ray at the same pixel."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cockpit.calibration.camera_cli import app
from cockpit.calibration.camera_info import import_camera
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

MOUNTING = load(CONFIG_DIR / "camera.yaml", Camera)
K = np.array([[431.5, 0.0, 318.2], [0.0, 433.1, 243.9], [0.0, 0.0, 1.0]])
SHORT = np.diag([0.5, 0.5, 1.0]) @ K + np.array([[0.0, 0.0, 159.1], [0.0, 0.0, 121.95], [0.0, 0.0, 0.0]])
PLUMB_BOB = (-0.36, 0.11, 0.001, -0.0005, 0.002)
RATIONAL = (0.61, -0.28, 0.0004, -0.0003, 0.011, 0.97, -0.14, 0.002)
FISHEYE = (-0.0046, 0.0408, -0.0389, 0.0066)
LENSES = {
    "plumb_bob": PLUMB_BOB,
    "rational_polynomial": RATIONAL,
    "equidistant": FISHEYE,
}


def calibration(path: Path, model: str, d: tuple[float, ...], k: np.ndarray = K) -> Path:
    """As camera_calibration_parsers writes it."""
    path.write_text(
        f"image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: {k.ravel().tolist()}\ndistortion_model: {model}\ndistortion_coefficients:\n  rows: 1\n"
        f"  cols: {len(d)}\n  data: {list(d)}\nrectification_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    )
    return path


def write_echo(path: Path, model: str, d: tuple[float, ...], *, upper: bool = False, more: str = "") -> Path:
    """As ``ros2 topic echo`` and ``rostopic echo`` print it, message after message."""
    names = "DK" if upper else "dk"
    one = (
        f"header:\n  stamp:\n    sec: 1\n    nanosec: 2\n  frame_id: front\nheight: 480\nwidth: 640\n"
        f"distortion_model: {model}\n{names[0]}: {list(d)}\n{names[1]}:\n"
        + "".join(f"- {value}\n" for value in K.ravel().tolist())
        + f"{more}---\n"
    )
    path.write_text(one + one)
    return path


def rays(most_rad: float) -> np.ndarray:
    """Directions (x, y, 1) up to ``most_rad`` from the axis, shape (n, 3)."""
    angle, around = np.meshgrid(np.linspace(0.0, most_rad, 30), np.linspace(0.0, 2 * math.pi, 24))
    r = np.tan(angle).ravel()
    return np.column_stack([r * np.cos(around.ravel()), r * np.sin(around.ravel()), np.ones(r.size)])


def pixels_of(camera: Camera, points: np.ndarray) -> np.ndarray:
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.intrinsics, camera.lens)
    return pixels[:, 0]


def stated_pixels(model: str, d: tuple[float, ...], points: np.ndarray) -> np.ndarray:
    """OpenCV's own projection by the model of the file."""
    if model == "equidistant":
        pixels = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, np.array(d))[0]
        return pixels[:, 0]
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(d))[0][:, 0]


def inside(pixels: np.ndarray) -> np.ndarray:
    return ((pixels >= 0) & (pixels <= (639, 479))).all(axis=1)


@pytest.mark.parametrize("write", [calibration, write_echo])
@pytest.mark.parametrize("model", LENSES)
def test_every_ray_is_at_the_pixel_that_the_model_of_the_file_states(tmp_path, model, write):
    found = import_camera(write(tmp_path / "info.yaml", model, LENSES[model]), MOUNTING)
    points = rays(math.radians(40.0))
    expected = stated_pixels(model, LENSES[model], points)
    seen = inside(expected)
    assert seen.sum() > 300
    off_px = np.abs(pixels_of(found.camera, points) - expected)[seen].max()
    assert off_px <= (found.fit_px or 1e-6) * (1 + 1e-3) + 1e-6
    assert (found.fit_px is None) == (model != "equidistant")


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-0.05, 0.05)] * 4), st.floats(120.0, 800.0))
def test_a_fisheye_is_fitted_within_what_is_said_over_the_whole_image(tmp_path_factory, d, focal_px):
    angles = np.linspace(0.0, math.radians(75.0), 500)
    assume((np.diff(angles * (1 + np.power.outer(angles, [2, 4, 6, 8]) @ d)) > 0).all())
    k = np.array([[focal_px, 0.0, 320.0], [0.0, focal_px, 240.0], [0.0, 0.0, 1.0]])
    file = calibration(tmp_path_factory.mktemp("f") / "info.yaml", "equidistant", d, k)
    found = import_camera(file, MOUNTING)
    points = rays(math.radians(74.9))
    pixels = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, np.array(d))[0][:, 0]
    seen = inside(pixels)
    assert found.fit_px is not None and found.fit_px <= 0.5
    assert np.abs(pixels_of(found.camera, points) - pixels)[seen].max() <= 2 * found.fit_px + 1e-3


def test_region_of_interest_and_binning_move_every_pixel_as_the_sensor_does(tmp_path):
    more = (
        "binning_x: 2\nbinning_y: 2\nroi:\n  x_offset: 40\n  y_offset: 80\n  height: 320\n  width: 560\n"
        "  do_rectify: false\n"
    )
    found = import_camera(write_echo(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB, more=more), MOUNTING)
    assert (found.camera.width_px, found.camera.height_px) == (280, 160)
    points = rays(math.radians(15.0))
    full = stated_pixels("plumb_bob", PLUMB_BOB, points)
    assert pixels_of(found.camera, points) == pytest.approx((full - (40, 80) + 0.5) / 2 - 0.5, abs=1e-6)


HEAD = "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
SAME_CAMERA = {
    "rows": HEAD + f"camera_matrix: {K.tolist()}\ndistortion_coefficients: {list(PLUMB_BOB)}\n",
    "rows in data": HEAD
    + f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {K.tolist()}\n"
    + f"distortion_coefficients: {{rows: 1, cols: 5, data: [{list(PLUMB_BOB)}]}}\n",
    "OpenCV": f"%YAML:1.0\n---\n{HEAD}camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    + f"   data: {K.ravel().tolist()}\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n"
    + f"   dt: d\n   data: {list(PLUMB_BOB)}\n",
    "capitals": f"height: 480\nwidth: 640\ndistortion_model: Plumb_Bob\nD: {list(PLUMB_BOB)}\nK: {K.tolist()}\n",
}


@pytest.mark.parametrize("text", SAME_CAMERA.values(), ids=SAME_CAMERA.keys())
def test_a_matrix_means_the_same_as_a_list_of_numbers_of_rows_and_of_opencv(tmp_path, text):
    written = tmp_path / "other.yaml"
    written.write_text(text)
    plain = calibration(tmp_path / "plain.yaml", "plumb_bob", PLUMB_BOB)
    assert import_camera(written, MOUNTING).camera == import_camera(plain, MOUNTING).camera


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{SAME_CAMERA['capitals']}roi: {{x_offset: 300, width: 341, height: 9}}\n", "341 x 9 px from (300, 0)"),
        (f"{SAME_CAMERA['capitals']}roi: {{y_offset: 480, height: 1}}\n", "beyond the image of 640"),
        (f"{SAME_CAMERA['capitals']}roi: {{x_offset: 40}}\n", "roi: an offset of (40, 0) px, but no size"),
        (SAME_CAMERA["capitals"].replace("Plumb_Bob", "none"), "distortion_model 'none'"),
        (HEAD + "camera_matrix: 5\n", "camera_matrix: expected a list of numbers, got 5"),
        ("# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n", "import the file ost.yaml beside it"),
        ("%YAML:1.0\n---\nimage_width: 640\nimage_height: x\n", ":4:1: image_height"),
    ],
)  # fmt: skip
def test_what_a_file_cannot_mean_is_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "info.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        import_camera(path, MOUNTING)
    assert str(refused.value).startswith(str(path)) and said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_messages_of_ros_1_and_zeros_at_the_end_mean_the_same(tmp_path):
    one = import_camera(write_echo(tmp_path / "a.yaml", "plumb_bob", PLUMB_BOB), MOUNTING)
    other = import_camera(
        write_echo(tmp_path / "b.yaml", "plumb_bob", (*PLUMB_BOB, 0.0, 0.0, 0.0), upper=True), MOUNTING
    )
    assert one.camera == other.camera
    assert one.camera.height_m == MOUNTING.height_m


@pytest.mark.parametrize(
    ("model", "d", "k", "said"),
    [
        ("thin_prism", PLUMB_BOB, K, "distortion_model 'thin_prism'; known: plumb_bob, rational_polynomial, equi"),
        ("plumb_bob", RATIONAL, K, "plumb_bob has 5 coefficients, got 8"),
        ("equidistant", (0.1,) * 5, K, "equidistant has 4 coefficients, got 5"),
        ("plumb_bob", PLUMB_BOB, np.zeros((3, 3)), "the focal length is 0 x 0 px: the camera is not calibrated"),
        ("plumb_bob", PLUMB_BOB, np.diag([10.0, 10.0, 1.0]) @ K, "px lies outside the image of"),
        ("plumb_bob", PLUMB_BOB, K.T, "the matrix has numbers below its diagonal, as a transposed one"),
        ("plumb_bob", PLUMB_BOB, np.diag([0.5, 0.5, 1.0]) @ K, "on both axes alike: the matrix"),
        ("plumb_bob", PLUMB_BOB, np.diag([1.98, 1.94, 1.0]) @ K, "on both axes alike: the matrix"),
        ("plumb_bob", PLUMB_BOB, K[:2], "camera_matrix: 3 rows of 3 numbers, but 6 numbers"),
        ("plumb_bob", PLUMB_BOB, K + 5 * np.eye(3, k=1), "a skew of 5 px"),
        ("equidistant", (-0.9, 0.0, 0.0, 0.0), SHORT, "no lens of a camera file comes within 0.5 px of it"),
    ],
)  # fmt: skip
def test_what_no_camera_file_can_hold_is_refused_in_one_line(tmp_path, model, d, k, said):
    path = calibration(tmp_path / "info.yaml", model, d, k)
    with pytest.raises(InputError) as refused:
        import_camera(path, MOUNTING)
    assert str(refused.value).startswith(str(path)) and said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_width_and_height_in_each_others_place_are_refused(tmp_path):
    info = calibration(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB)
    info.write_text(
        info.read_text().replace("width: 640\nimage_height: 480", "width: 480\nimage_height: 640")
    )
    with pytest.raises(
        InputError, match=r"is the middle of 640 x 480 px, .*: are width and height swapped\?"
    ):
        import_camera(info, MOUNTING)


def test_a_principal_point_far_down_as_in_a_picture_without_its_sky_is_imported(tmp_path):
    low = K - np.array([[0, 0, 0], [0, 0, 170.0], [0, 0, 0]])
    assert (
        import_camera(calibration(tmp_path / "a.yaml", "plumb_bob", PLUMB_BOB, low), MOUNTING).camera.cy_px
        > 0
    )


def kalibr(path: Path, model: str, d: tuple[float, ...], *, cameras: int = 1) -> Path:
    """As kalibr_calibrate_cameras writes it."""
    intrinsics = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
    path.write_text(
        "".join(
            f"cam{number}:\n  cam_overlaps: []\n  camera_model: pinhole\n  distortion_coeffs: {list(d)}\n"
            f"  distortion_model: {model}\n  intrinsics: {intrinsics}\n  resolution: [640, 480]\n"
            f"  rostopic: /cam{number}/image_raw\n"
            for number in range(cameras)
        )
    )
    return path


@pytest.mark.parametrize(
    ("of_kalibr", "of_ros", "d"),
    [("radtan", "plumb_bob", PLUMB_BOB[:4]), ("equidistant", "equidistant", FISHEYE), ("none", "none", ())],
)
def test_a_chain_of_kalibr_means_the_same_as_a_camera_info(tmp_path, of_kalibr, of_ros, d):
    found = import_camera(kalibr(tmp_path / "camchain.yaml", of_kalibr, d), MOUNTING)
    assert found == import_camera(calibration(tmp_path / "info.yaml", of_ros, d), MOUNTING)


def test_a_chain_of_several_cameras_is_refused_with_their_names(tmp_path):
    with pytest.raises(InputError, match=r"holds cam0, cam1: leave one camera"):
        import_camera(kalibr(tmp_path / "camchain.yaml", "radtan", PLUMB_BOB[:4], cameras=2), MOUNTING)


@pytest.mark.parametrize("name", ["Plumb Bob", "plumb-bob", "brown_conrady", "radtan"])
def test_other_names_of_a_lens_model_mean_the_same(tmp_path, name):
    found = import_camera(calibration(tmp_path / "other.yaml", f'"{name}"', PLUMB_BOB), MOUNTING)
    assert found == import_camera(calibration(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB), MOUNTING)


def test_other_names_of_a_fisheye_and_no_name_of_a_model_mean_the_same(tmp_path):
    for other, name, d in (("kannala_brandt4", "equidistant", FISHEYE), ("", "plumb_bob", PLUMB_BOB)):
        found = import_camera(calibration(tmp_path / "other.yaml", other, d), MOUNTING)
        assert found == import_camera(calibration(tmp_path / "info.yaml", name, d), MOUNTING)


@pytest.mark.parametrize(
    "names",
    [
        ("K", "D", "image_width", "image_height"),
        ("Camera_Matrix", "Distortion_Coefficients", "image_Width", "image_Height"),
    ],
)
def test_other_names_of_the_fields_of_opencv_mean_the_same(tmp_path, names):
    info = calibration(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB)
    text = info.read_text()
    for old, new in zip(
        ("camera_matrix", "distortion_coefficients", "image_width", "image_height"), names, strict=True
    ):
        text = text.replace(f"{old}:", f"{new}:")
    other = tmp_path / "opencv.yaml"
    other.write_text(text)
    assert import_camera(other, MOUNTING) == import_camera(info, MOUNTING)


def test_a_matrix_in_shares_of_the_image_is_refused(tmp_path):
    info = calibration(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB, np.diag([1 / 640, 1 / 480, 1.0]) @ K)
    with pytest.raises(InputError, match=r"is none of 640 x 480 px: is it in shares of the image"):
        import_camera(info, MOUNTING)


def test_xml_of_opencv_is_refused_with_the_way_to_yaml(tmp_path):
    path = tmp_path / "info.xml"
    path.write_text('<?xml version="1.0"?>\n<opencv_storage></opencv_storage>\n')
    with pytest.raises(InputError, match=r"is XML: let OpenCV write it as YAML"):
        import_camera(path, MOUNTING)


def test_the_verb_writes_a_camera_file_that_loads_as_the_camera(tmp_path):
    info, out = calibration(tmp_path / "info.yaml", "equidistant", FISHEYE), tmp_path / "camera.yaml"
    words = ["import", str(info), "--width", "320", "--out", str(out), "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    printed, written = json.loads(done.stdout), load(out, Camera)
    assert printed["model"] == "equidistant" and printed["fit_px"] < 0.5
    points = rays(math.radians(40.0))
    exact = import_camera(info, MOUNTING).camera.resize(320, 240)
    seen = inside(pixels_of(exact, points))
    assert np.abs(pixels_of(written, points) - pixels_of(exact, points))[seen].max() < 0.01
    assert isinstance(CliRunner().invoke(app, words).exception, InputError), "never overwritten"


def test_a_camera_info_in_place_of_a_camera_file_is_told_its_way(tmp_path):
    with pytest.raises(InputError, match=r"info\.yaml:1:1: is a camera_info of ROS; `trepid camera import`"):
        load(calibration(tmp_path / "info.yaml", "plumb_bob", PLUMB_BOB), Camera)
