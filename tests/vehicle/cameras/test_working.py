"""The one place in which live images are turned, cropped and scaled."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame
from vehicle.cameras.working import Unfit, Working, WorkingSettings

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def working(**settings: object) -> Working:
    return Working(WorkingSettings.model_validate({"source": "video", **settings}), CAMERA)


def frame(width: int, height: int, t_s: float = 1.0) -> Frame:
    return Frame(t_s=t_s, image=np.full((height, width, 3), 100, np.uint8))


@pytest.mark.parametrize("size", [(320, 240), (640, 480), (1600, 1200), (160, 120), (324, 244)])
def test_every_resolution_becomes_the_working_size_and_keeps_its_time(size: tuple[int, int]) -> None:
    result = working().step(frame(*size, t_s=7.5))
    assert result.image.shape == (240, 320, 3) and result.t_s == 7.5


def test_an_image_of_the_working_size_is_not_changed() -> None:
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    assert np.array_equal(working().step(Frame(t_s=1.0, image=image)).image, image)


@settings(max_examples=15)
@given(scale=st.sampled_from([2, 3, 4, 5]), ahead_m=st.floats(5, 30), bearing=st.floats(-0.4, 0.4))
def test_the_intrinsics_scale_with_the_image(scale: int, ahead_m: float, bearing: float) -> None:
    large = CAMERA.resize(CAMERA.width_px * scale, CAMERA.height_px * scale)
    road_m = [[CAMERA.x_m + ahead_m, bearing * ahead_m]]
    (u, v), (wanted_u, wanted_v) = large.pixel_from_road(road_m)[0], CAMERA.pixel_from_road(road_m)[0]
    row, column = np.indices((large.height_px, large.width_px), sparse=True)
    blob = 255 * np.exp(-((column - u) ** 2 + (row - v) ** 2) / (2 * (4 * scale) ** 2))
    image = np.repeat(np.round(blob).astype(np.uint8)[:, :, None], 3, axis=2)
    scaled = working().step(Frame(t_s=1.0, image=image)).image[:, :, 0].astype(float)
    row, column = np.indices(scaled.shape)
    assert (scaled * column).sum() / scaled.sum() == pytest.approx(wanted_u, abs=0.05)
    assert (scaled * row).sum() / scaled.sum() == pytest.approx(wanted_v, abs=0.05)


def test_a_resolution_that_changes_in_the_middle_is_refused_and_never_stretched() -> None:
    step = working(fit="stretch")
    step.step(frame(640, 480))
    with pytest.raises(Unfit, match="1280 x 720 px refused: the camera began with 640 x 480"):
        step.step(frame(1280, 720))
    assert step.step(frame(640, 480)).image.shape == (240, 320, 3)  # the first one goes on


def test_another_aspect_ratio_is_refused_with_the_remedy() -> None:
    with pytest.raises(
        InputError, match=r"1280 x 720 px upright.*320 x 240.*trepid camera calibrate.*fit: crop"
    ):
        working().step(frame(1280, 720))


def test_a_turned_camera_is_compared_upright() -> None:
    assert working(mount={"rotate_deg": 90}).step(frame(480, 640)).image.shape == (240, 320, 3)
    with pytest.raises(InputError, match="480 x 640 px upright"):
        working(mount={"rotate_deg": 90}).step(frame(640, 480))


def test_a_crop_keeps_the_middle_and_the_proportions() -> None:
    image = np.zeros((720, 1280, 3), np.uint8)
    image[:, 160:1120] = 200  # 960 x 720 around the middle: 4:3
    assert working(fit="crop").step(Frame(t_s=1.0, image=image)).image.min() == 200


def test_grey_images_and_images_with_alpha_become_bgr() -> None:
    for shape in ((240, 320), (240, 320, 1), (240, 320, 4)):
        assert working().step(Frame(t_s=1.0, image=np.full(shape, 9, np.uint8))).image.shape == (240, 320, 3)


@pytest.mark.parametrize(
    "image", [np.zeros((240, 320, 3)), np.zeros((240, 320, 2), np.uint8), np.zeros((0, 9, 3), np.uint8)]
)
def test_other_layouts_are_refused(image: np.ndarray) -> None:
    with pytest.raises(Unfit, match="refused"):
        working().step(Frame(t_s=1.0, image=image))
