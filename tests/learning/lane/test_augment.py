"""Claims about augmentation."""

import numpy as np
import pytest

from learning.lane.augment import Augmentation, Augmenter, nonsense
from perception.net.canonical import CanonicalView, crop_camera, lane_of_row, row_of_lane
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CALM = Augmentation(
    **dict.fromkeys(Augmentation.model_fields, 0.0) | dict(gain=1.0, gamma=1.0),
)
WILD = Augmentation(
    **dict.fromkeys(Augmentation.model_fields, 0.3)
    | dict(gain=1.6, gamma=1.5, noise_grey=15.0, offset_grey=20.0)
)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CANONICAL = crop_camera(CAMERA, top_px=82, bottom_px=202, width_px=200, height_px=66)
LANE = np.array([0.3, 0.02, 0.01, 0.012, 3.4], np.float32)


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (66, 200, 3), dtype=np.uint8)


def augment(image, lane, settings, rng):
    return Augmenter(settings, CANONICAL, lookahead_m=10.0)(image, lane, rng)


def test_without_strength_nothing_changes():
    image, lane = augment(picture(), LANE, CALM, np.random.default_rng(1))
    assert np.array_equal(image, picture()) and np.allclose(lane, LANE, atol=1e-7)


def test_a_mirrored_image_has_the_mirrored_lane():
    mirror = CALM.model_copy(update=dict(flip=1.0))
    image, lane = augment(picture(), LANE, mirror, np.random.default_rng(1))
    assert np.array_equal(image, picture()[:, ::-1]) and np.allclose(lane, [*-LANE[:4], LANE[4]], atol=1e-7)


def test_the_same_generator_state_gives_the_same_image_and_leaves_the_source_alone():
    source = picture()
    one, two = (augment(source, LANE, WILD, np.random.default_rng(7))[0] for _ in range(2))
    assert np.array_equal(one, two)
    assert np.array_equal(source, picture())


@pytest.mark.parametrize("seed", range(40))
def test_images_keep_their_size_and_type(seed):
    rng = np.random.default_rng(seed)
    for image in (augment(picture(), LANE, WILD, rng)[0], nonsense(picture(), rng)):
        assert image.shape == (66, 200, 3) and image.dtype == np.uint8


def test_a_bonnet_hides_the_lowest_rows_alone():
    settings = CALM.model_copy(update=dict(bonnet=1.0, bonnet_size=0.3))
    for seed in range(20):
        image, lane = augment(picture(), LANE, settings, np.random.default_rng(seed))
        changed = (image != picture()).any(axis=2)
        assert changed[-1, 100] and not changed[: int(0.7 * 66) - 1].any()
        assert np.allclose(lane, LANE, atol=1e-7)


@pytest.mark.parametrize("change", [dict(coarse=1.0, coarse_scale=0.4), dict(coded=1.0, coded_quality=20.0)])
def test_fewer_pixels_and_coding_lose_noise_and_keep_the_lane(change):
    settings, light = CALM.model_copy(update=change), np.full((66, 200, 3), 180, np.uint8)
    for seed in range(5):
        image, lane = augment(picture(), LANE, settings, np.random.default_rng(seed))
        assert (image != picture()).any() and image.std() < picture().std()
        assert np.allclose(lane, LANE, atol=1e-7)
        assert np.abs(augment(light, LANE, settings, np.random.default_rng(seed))[0] - 180.0).max() <= 1


@pytest.mark.parametrize("raised", [0.8, 1.0, 1.3])
def test_the_lane_from_another_height_is_inverted_by_inference(raised):
    camera = CAMERA.model_copy(update=dict(height_m=raised * CAMERA.height_m))
    shifted = Augmenter(CALM, CANONICAL, lookahead_m=10.0).lane_from(LANE, raised)
    view, (lane, width_m) = CanonicalView(camera, CANONICAL), lane_of_row(shifted, 10.0)
    assert row_of_lane(view.lane(lane), width_m * view.scale, 10.0) == pytest.approx(LANE, abs=1e-6)


@pytest.mark.parametrize("raised", [0.8, 1.3])
def test_road_points_move_in_the_image_as_projected_from_the_other_height(raised):
    points = np.array([(4.0, 1.5), (8.0, -1.5), (20.0, 3.0)])
    camera = CANONICAL.model_copy(update=dict(height_m=raised * CANONICAL.height_m))
    before = np.column_stack([CANONICAL.pixel_from_road(points), np.ones(3)])
    matrix = Augmenter(CALM, CANONICAL, lookahead_m=10.0).pixel_from_pixel(raised)
    after = (matrix @ before.T).T
    assert after[:, :2] / after[:, 2:] == pytest.approx(camera.pixel_from_road(points))
