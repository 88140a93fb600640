"""Claims about augmentation."""

import numpy as np
import pytest

from perception.augment import Augmentation, augment, nonsense

CALM = Augmentation(
    flip=0, shift_px=0, roll_rad=0, gain=1, gamma=1, colour=0, offset_grey=0, shadows=0, blur=0, blur_px=0,
    noise=0, noise_grey=0, erase=0, erase_size=0, border=0, border_size=0,
)  # fmt: skip
WILD = Augmentation(
    flip=0.5, shift_px=1, roll_rad=0.02, gain=1.6, gamma=1.5, colour=0.1, offset_grey=20, shadows=0.5, blur=0.5,
    blur_px=1.5, noise=0.5, noise_grey=15, erase=0.5, erase_size=0.3, border=0.2, border_size=0.2,
)  # fmt: skip
LANE = np.array([0.3, 0.02, 0.01, 0.012], np.float32)


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (66, 200, 3), dtype=np.uint8)


def test_without_strength_nothing_changes():
    image, lane = augment(picture(), LANE, CALM, np.random.default_rng(1))
    assert np.array_equal(image, picture()) and np.array_equal(lane, LANE)


def test_a_mirrored_image_has_the_mirrored_lane():
    mirror = CALM.model_copy(update=dict(flip=1.0))
    image, lane = augment(picture(), LANE, mirror, np.random.default_rng(1))
    assert np.array_equal(image, picture()[:, ::-1]) and np.array_equal(lane, -LANE)


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
