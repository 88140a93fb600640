"""Changes of the images of a test that a network has not been trained on: light, weather, optics, mount."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import cv2
import numpy as np

from learning.pixels import add_noise, as_pixels, fog, rain, shade, snow
from trepid.types import Image

BLUR, NOISE_GREY, RISE = 0.008, 15.0, 0.03  # of the width; [grey levels]; of the height


class ImageChange(Protocol):
    """A change of an image."""

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """The changed image."""
        ...


def _lit(gain: float) -> ImageChange:
    def lit(image: Image, rng: np.random.Generator) -> Image:
        return as_pixels(cv2.convertScaleAbs(image, alpha=gain))

    return lit


def _blur(image: Image, rng: np.random.Generator) -> Image:
    return as_pixels(cv2.GaussianBlur(image, (0, 0), BLUR * image.shape[1]))


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    return add_noise(image, NOISE_GREY, rng)


def _raise_camera(image: Image, rng: np.random.Generator) -> Image:
    """The view of a camera that looks lower: everything is RISE of the height farther up."""
    rows = round(RISE * image.shape[0])
    return np.concatenate([image[rows:], np.repeat(image[-1:], rows, axis=0)])


SHIFTS: Mapping[str, ImageChange] = MappingProxyType(
    {
        "half the light": _lit(0.5),
        "twice the light": _lit(2.0),
        "shadows": shade,
        "blur": _blur,
        "noise": _noisy,
        "rain": rain,
        "snow": snow,
        "fog": fog,
        "camera tilted": _raise_camera,
    }
)
"""Name of a shift -> changed image."""
