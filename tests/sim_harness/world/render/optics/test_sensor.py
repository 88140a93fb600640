"""Noise and JPEG of the sensor."""

import cv2
import numpy as np
import pytest

from sim_harness.world.render.optics.sensor import code_jpeg, noise_sigma, noisy


@pytest.mark.parametrize("gain", [4.0, 30.0])
@pytest.mark.parametrize("level", [60, 120, 190])
def test_noise_has_the_deviation_of_shot_and_read_noise(gain, level):
    even = np.full((240, 320, 3), level, np.uint8)
    noise = noisy(even, gain, (1, 2, 3)).astype(float) - level
    assert noise.std() == pytest.approx(noise_sigma(gain)[level], rel=0.05)
    assert abs(noise.mean()) < 0.5


def test_shot_noise_is_the_root_of_the_electrons():
    assert noise_sigma(1.0)[255] == pytest.approx(255 * 0.5 / 9000**0.5, rel=0.01)


def test_jpeg_of_full_quality_changes_little():
    image = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8), (9, 9), 0
    )
    assert np.abs(code_jpeg(image, 100).astype(int) - image).mean() < 2
