"""Sensor and codec: shot and read noise, JPEG.

At gain g the light L makes L·N/g electrons, so σ² = L·g/N + (r·g/N)². On grey levels 255·√L the shot noise is the
same at all levels, 255·√(g/N)/2 (Anscombe 1948), and the read noise 255·r·g/(2·N·√L) lies in the dark.
EMVA Standard 1288, section 2; N and r of a small webcam sensor with 2 to 3 µm pixels.
"""

from functools import lru_cache

import cv2
import numpy as np

from trepid.types import Floats, Image

FULL_WELL = 9000.0  # electrons
READ_NOISE = 4.0  # electrons
POOL = 768
DARKEST = 0.12  # √light below which a sensor's black level clips
CHROMA_PX = 3  # width over which webcams smooth colour noise


def noise_sigma(gain: float) -> Floats:
    """Standard deviation [grey levels] at each of the 256 levels."""
    root = np.maximum(np.arange(256) / 255, DARKEST)
    shot = 0.25 * gain / FULL_WELL
    read = (READ_NOISE * gain / FULL_WELL / (2 * root)) ** 2
    return np.asarray(255 * np.sqrt(shot + read), np.float32)


def noisy(image: Image, gain: float, seed: tuple[int, ...]) -> Image:
    rng = np.random.default_rng(seed)
    rows, columns = image.shape[:2]
    row, column = rng.integers(POOL - rows % POOL), rng.integers(POOL - columns % POOL)
    pool = _pool()
    noise = pool[row : row + rows, column : column + columns]
    if noise.shape != image.shape:
        tall = np.take(pool, range(row, row + rows), axis=0, mode="wrap")
        noise = np.take(tall, range(column, column + columns), axis=1, mode="wrap")
    sigma = cv2.LUT(image, noise_sigma(gain))
    return np.asarray(cv2.convertScaleAbs(np.maximum(cv2.multiply(sigma, noise) + image, 0)), np.uint8)


@lru_cache(maxsize=1)
def _pool() -> Floats:
    """Noise of standard deviation 1, mostly in brightness, (POOL, POOL, 3)."""
    rng = np.random.default_rng(1)
    grey = rng.standard_normal((POOL, POOL, 1), dtype=np.float32)
    colour = cv2.GaussianBlur(rng.standard_normal((POOL, POOL, 3), dtype=np.float32), (0, 0), CHROMA_PX / 3)
    noise = grey + 0.6 * colour / colour.std()
    return np.asarray(noise / noise.std(), np.float32)


def code_jpeg(image: Image, quality: float) -> Image:
    """``image`` after JPEG coding at ``quality``, 1..100."""
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, round(quality)])
    return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), np.uint8)
