"""Exposure of a frame under the section's light: vignette, haze, gain, gamma, glare, blur, noise."""

import math
from functools import cached_property, lru_cache

import cv2
import numpy as np

from sim_harness.world.roads.appearance import Light
from trepid.car.camera import Camera
from trepid.types import Floats, Image

SUN_ELEVATION_RAD = 0.09
SUN_BGR = (0.90, 0.97, 1.0)
HAZE_GREY = 205.0
VIGNETTE = 0.18  # light lost in the corners
POOL = 1024  # side of the pool of noise
POOL_SIGMA = 32.0
MIN_BLUR_PX = 0.2


class Exposure:
    """The optics and the sensor of one camera."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        radius2 = ((u - camera.cx_px) / camera.width_px) ** 2 + ((v - camera.cy_px) / camera.height_px) ** 2
        light = 255 * (1 - VIGNETTE * radius2 / 0.5)
        # Relative light of every pixel, 255 at the image centre.
        self.vignette = np.repeat(np.clip(light, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)

    def expose(
        self,
        image: Image,
        light: Light,
        *,
        sun_bearing_rad: float,
        seed: tuple[int, int],
        vignetted: bool = False,
    ) -> Image:
        """The exposed frame; ``sun_bearing_rad``: left of the camera's axis; ``seed``: of the noise.

        ``vignetted``: vignetting is already applied to ``image``.
        """
        if not vignetted:
            image = np.asarray(cv2.multiply(image, self.vignette, scale=1 / 255), np.uint8)
        if light.haze > 0:
            hazy = cv2.addWeighted(image, 1 - light.haze, image, 0, HAZE_GREY * light.haze)
            image = np.asarray(hazy, np.uint8)
        if light.gain != 1 or light.gamma != 1:
            image = np.asarray(cv2.LUT(image, _curve(light.gain, light.gamma)), np.uint8)
        if light.glare > 0:
            image = np.asarray(cv2.add(image, self._sun(light.glare, sun_bearing_rad)), np.uint8)
        if light.blur_px > MIN_BLUR_PX:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), light.blur_px), np.uint8)
        return self._noisy(image, light.noise, seed) if light.noise > 0 else image

    @cached_property
    def _glare(self) -> Floats:
        """Grey levels that a low sun adds at full strength, (height, 3 width, 3), the sun in the middle column.

        A saturated disc with a wide halo, its reflection on the road, and veiling glare over the whole image.
        """
        camera = self._camera
        u, v = np.meshgrid(np.arange(3 * camera.width_px), np.arange(camera.height_px))
        right = (u - 1.5 * camera.width_px) / camera.fx_px
        up = (camera.horizon_row_px - v) / camera.fx_px
        radius = np.hypot(right, up - SUN_ELEVATION_RAD)
        light = 400 * np.exp(-((radius / 0.10) ** 2)) + 190 * np.exp(-radius / 0.35) + 25
        below = np.clip(-up, 0, None)
        light += 210 * (up < 0) * np.exp(-((right / (0.10 + 0.25 * below)) ** 2)) * np.exp(-below / 0.6)
        return (light[:, :, None] * np.array(SUN_BGR)).astype(np.float32)

    def _sun(self, strength: float, bearing_rad: float) -> Image:
        width = self._camera.width_px
        bearing = math.remainder(bearing_rad, math.tau)
        if abs(bearing) > 1.2:
            column = 2 * width if bearing > 0 else 0
        else:
            sun = self._camera.cx_px - self._camera.fx_px * math.tan(bearing)
            column = round(min(max(1.5 * width - sun, 0), 2 * width))
        glare = self._glare[:, column : column + width]
        return np.asarray(cv2.convertScaleAbs(glare, alpha=strength), np.uint8)

    def _noisy(self, image: Image, sigma: float, seed: tuple[int, int]) -> Image:
        rng = np.random.default_rng(seed)
        rows, columns = image.shape[:2]
        row, column = rng.integers(POOL - rows), rng.integers(POOL - columns)
        noise = _noise_pool()[row : row + rows, column : column + columns]
        gain = sigma / POOL_SIGMA
        return np.asarray(cv2.addWeighted(image, 1, noise, gain, -128 * gain), np.uint8)


@lru_cache(maxsize=1)
def _noise_pool() -> Image:
    """White noise of deviation POOL_SIGMA around 128, (POOL, POOL, 3)."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((POOL, POOL, 3), dtype=np.float32)
    return np.clip(128 + POOL_SIGMA * noise, 0, 255).astype(np.uint8)


@lru_cache(maxsize=64)
def _curve(gain: float, gamma: float) -> Image:
    levels = np.arange(256) / 255
    return np.asarray(np.clip(255 * (gain * levels**gamma), 0, 255), np.uint8)
