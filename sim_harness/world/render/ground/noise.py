"""Periodic noise images for textures."""

import cv2
import numpy as np

from trepid.types import Floats


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], cell: tuple[int, int]) -> Floats:
    """Periodic noise of mean 0 and standard deviation 1 that varies over ``cell`` pixels.

    ``cell`` must divide ``shape``; (1, 1) gives white noise.
    """
    if cell == (1, 1):
        return rng.standard_normal(shape, dtype=np.float32)
    coarse = rng.standard_normal((shape[0] // cell[0], shape[1] // cell[1]), dtype=np.float32)
    padded = np.pad(coarse, 2, mode="wrap")
    size = (padded.shape[1] * cell[1], padded.shape[0] * cell[0])
    image = cv2.resize(padded, size, interpolation=cv2.INTER_CUBIC)
    image = image[2 * cell[0] : -2 * cell[0], 2 * cell[1] : -2 * cell[1]]
    return np.asarray((image - image.mean()) / (image.std() + 1e-6), np.float32)
