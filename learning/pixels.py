"""Changes of pixels that keep the label: other light, shadows, occlusion, noise; rain, snow and fog.

Trainings draw them at random; the tests of a network apply them one by one (:data:`SHIFTS`). All randomness comes
from a given Generator.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import cv2
import numpy as np

from trepid.types import Image

UNIFORM_SIGMA = 73.9  # standard deviation of uniform bytes: √((256² − 1)/12)
SKY = (200, 205, 210)  # BGR of fog and of falling snow
RAIN = (190, 185, 180)
SHIFT_BLUR, SHIFT_NOISE_GREY, SHIFT_RISE = 0.008, 15.0, 0.03  # of the width; [grey levels]; of the height


class Light(Protocol):
    """Bounds of another light."""

    gain: float  # exposure between 1/gain and gain
    gamma: float  # between 1/gamma and gamma
    colour: float  # gain of each channel, ±
    offset_grey: float  # black level, ±


class Blemishes(Protocol):
    """Shares of the images with a blemish, and their bounds."""

    erase: float
    erase_size: float  # largest side of a block, as a share of the image side
    blur: float
    blur_px: float  # range of σ
    noise: float
    noise_grey: float  # largest σ


def relight(image: Image, rng: np.random.Generator, bounds: Light) -> Image:
    """Another exposure, gamma, colour balance and black level, each up to its bound."""
    gains = bounds.gain ** rng.uniform(-1, 1) * (1 + bounds.colour * rng.uniform(-1, 1, (1, 3)))
    power = bounds.gamma ** rng.uniform(-1, 1)
    black = bounds.offset_grey * rng.uniform(-1, 1)
    grey = np.arange(256)[:, None] / 255
    table = 255 * gains * grey**power + black
    return as_pixels(cv2.LUT(image, np.clip(table, 0, 255).astype(np.uint8).reshape(256, 1, 3)))


def shade(image: Image, rng: np.random.Generator) -> Image:
    """One to three soft shadows or bright patches, each a random quadrilateral."""
    height, width = image.shape[:2]
    mask = np.full((height, width), 1.0, np.float32)
    for _ in range(rng.integers(1, 4)):
        corners = rng.uniform((-0.2 * width, -0.2 * height), (1.2 * width, 1.2 * height), (4, 2))
        cv2.fillPoly(
            mask, [cv2.convexHull(corners.astype(np.int32))], float(rng.choice((0.4, 0.55, 0.7, 1.4)))
        )
    soft = cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(0.5, 3)))
    return as_pixels(cv2.multiply(image, cv2.merge([soft] * 3), dtype=cv2.CV_8U))


def erase(image: Image, size: float, rng: np.random.Generator) -> Image:
    """One or two blocks of one colour: an occlusion (Zhong et al., Random Erasing, 2020)."""
    image = image.copy()
    height, width = image.shape[:2]
    for _ in range(rng.integers(1, 3)):
        h, w = np.minimum((rng.uniform(0.1, 1, 2) * size * (height, width)).astype(int) + 1, (height, width))
        top, left = rng.integers(0, max(1, height - h)), rng.integers(0, max(1, width - w))
        image[top : top + h, left : left + w] = rng.integers(0, 256, 3)
    return image


def blemish(image: Image, rng: np.random.Generator, settings: Blemishes, *, least_blur_px: float) -> Image:
    """Blocks of one colour, blur and noise, each by chance; the σ of the blur is ``least_blur_px`` at least."""
    if rng.random() < settings.erase:
        image = erase(image, settings.erase_size, rng)
    if rng.random() < settings.blur:
        image = as_pixels(cv2.GaussianBlur(image, (0, 0), least_blur_px + settings.blur_px * rng.random()))
    if rng.random() < settings.noise:
        image = add_noise(image, settings.noise_grey * rng.random(), rng)
    return image


def add_noise(image: Image, sigma_grey: float, rng: np.random.Generator) -> Image:
    """Uniform white noise: ten times cheaper to draw than normal noise."""
    noise = rng.integers(0, 256, image.shape, np.uint8)
    gain = sigma_grey / UNIFORM_SIGMA
    return as_pixels(cv2.addWeighted(image, 1, noise, gain, -127.5 * gain))


def rain(image: Image, rng: np.random.Generator) -> Image:
    """Slanted streaks of drops, a duller image."""
    height, width = image.shape[:2]
    layer = np.zeros((height, width), np.uint8)
    slant = rng.uniform(-0.3, 0.3)
    for x, y in rng.uniform((0, 0), (width, height), (rng.integers(10, 60), 2)):
        length = rng.uniform(0.04, 0.12) * height
        end = (int(x + slant * length), int(y + length))
        cv2.line(layer, (int(x), int(y)), end, int(rng.integers(60, 160)), 1, cv2.LINE_AA)
    return _lay_over(as_pixels(cv2.convertScaleAbs(image, alpha=float(rng.uniform(0.75, 1)))), layer, RAIN)


def snow(image: Image, rng: np.random.Generator) -> Image:
    """Flakes of several sizes before a paler image."""
    height, width = image.shape[:2]
    layer = np.zeros((height, width), np.uint8)
    for x, y in rng.uniform((0, 0), (width, height), (rng.integers(15, 90), 2)):
        radius = max(1, round(rng.exponential(0.008) * height))
        cv2.circle(layer, (int(x), int(y)), radius, int(rng.integers(120, 255)), -1, cv2.LINE_AA)
    pale = np.full((height, width), int(rng.uniform(0, 60)), np.uint8)
    return _lay_over(image, np.maximum(layer, pale), SKY)


def fog(image: Image, rng: np.random.Generator) -> Image:
    """Contrast lost towards a horizon between 0.3 and 0.55 of the height: light = road·t + sky·(1 − t).

    t = exp(−k/(rows below the horizon)) on a flat road (Koschmieder's law with distance ~ 1/rows).
    """
    height, width = image.shape[:2]
    below = np.maximum(np.arange(height) / height - rng.uniform(0.3, 0.55), 1e-3)
    density = np.exp(-rng.uniform(0.02, 0.15) / below)
    layer = np.repeat((255 * (1 - density)).astype(np.uint8)[:, None], width, axis=1)
    return _lay_over(image, np.minimum(layer, int(rng.uniform(100, 230))), SKY)


def _lay_over(image: Image, alpha: Image, colour: tuple[int, int, int]) -> Image:
    """``colour`` laid over ``image`` with the opacity ``alpha`` of 255."""
    share = alpha[..., None].astype(np.float32) / 255
    return (image * (1 - share) + np.array(colour, np.float32) * share).astype(np.uint8)


def as_pixels(image: cv2.typing.MatLike) -> Image:
    """``image`` with its type, which OpenCV does not declare."""
    return np.asarray(image, np.uint8)


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
    return as_pixels(cv2.GaussianBlur(image, (0, 0), SHIFT_BLUR * image.shape[1]))


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    return add_noise(image, SHIFT_NOISE_GREY, rng)


def _raise_camera(image: Image, rng: np.random.Generator) -> Image:
    """The view of a camera that looks lower: everything is SHIFT_RISE of the height farther up."""
    rows = round(SHIFT_RISE * image.shape[0])
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
"""Name -> a change that the training of a network has not shown it, of light, weather, optics or mount."""
