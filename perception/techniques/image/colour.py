"""Colour images to the single channel of the later stages (inventory A04, A06, A08, B10)."""

import math
from typing import Literal

import cv2
import numpy as np

from perception.techniques.image.picture import GroundView
from perception.techniques.image.rows import row_top_hat
from trepid.config import InputError
from trepid.types import Floats, Image, Positive

CHANNELS = {
    "bgr": (None, "bgr"),
    "hsv": (cv2.COLOR_BGR2HSV, "hsv"),
    "hls": (cv2.COLOR_BGR2HLS, "hls"),
    "ycbcr": (cv2.COLOR_BGR2YCrCb, "yrb"),  # OpenCV's order: Y, Cr, Cb
    "yuv": (cv2.COLOR_BGR2YUV, "yuv"),
    "lab": (cv2.COLOR_BGR2Lab, "lab"),
}
ROAD_GREY, TEXTURE_GREY = 96.0, 12.0  # grey level of the road, and of one standard deviation of it
MIN_SAMPLES = 30  # of paint; fewer are noise
SENSOR_GREY = 2.0  # standard deviation of sensor noise: keeps the scatter invertible
USUAL = 80.0  # percentile of the top-hat reached by texture and noise
OUTSTANDING = 5.0  # multiple of it from which a pixel is paint


def grey(image: Image, view: GroundView) -> Image:
    """Luminance, Y = 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601) (A04). Source: R [8]–[12].

    Limit: yellow paint on concrete, which has the same luminance.
    """
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def binary(image: Image, view: GroundView) -> Image:
    """White above the threshold that separates the grey levels best, else black (A06).

    Otsu, A Threshold Selection Method from Gray-Level Histograms (1979): the greatest variance between the two
    classes. Source: R [14], [58], [64]. Limit: a picture with sky, or with sun and shadow.
    """
    return np.asarray(cv2.threshold(grey(image, view), 0, 255, cv2.THRESH_OTSU)[1], np.uint8)


def channel(
    image: Image,
    view: GroundView,
    *,
    space: Literal["bgr", "hsv", "hls", "ycbcr", "yuv", "lab"] = "hls",
    name: Literal["b", "g", "r", "h", "s", "v", "l", "y", "u", "a"] = "l",
) -> Image:
    """One channel of a colour space; of YCbCr, "b" and "r" are Cb and Cr (A08).

    Source: R [67]–[70]. V of HSV and L of HLS respond to white, b of Lab and Cb to yellow. Raises InputError when
    the space has no such channel.
    """
    code, letters = CHANNELS[space]
    if name not in letters:
        raise InputError(f"{space} has no channel {name!r}; it has {', '.join(letters)}")
    if image.ndim == 2:
        return image
    converted = image if code is None else cv2.cvtColor(image, code)
    return np.asarray(cv2.extractChannel(converted, letters.index(name)), np.uint8)


def hsi(image: Image) -> tuple[Floats, Floats, Floats]:
    """Hue [rad, −π..π, 0 = red], saturation and intensity, 0..1 each, of a BGR image (A07).

    I = (R+G+B)/3, S = 1 − min(R,G,B)/I, H = atan2(√3·(G−B), 2R−G−B). Source: R [15], [66] ("HIS"); Gonzalez and
    Woods, Digital Image Processing, section 6.2. Hue is noise where S is near 0.
    """
    blue, green, red = np.moveaxis(image.astype(np.float32) / 255, 2, 0)
    intensity = (blue + green + red) / 3
    lowest = np.minimum(np.minimum(blue, green), red)
    saturation = 1 - np.divide(lowest, intensity, out=np.ones_like(lowest), where=intensity > 0)
    hue = np.arctan2(math.sqrt(3.0) * (green - blue), 2 * red - green - blue)
    return hue, saturation, intensity


def adaptive_grey(image: Image, view: GroundView, *, marking_m: Positive = 0.15) -> Image:
    """Projections of colour in which white and yellow paint differ most from the road of this frame (B10).

    Fisher's discriminant g = wᵀ·(R,G,B) with w = S_w⁻¹·(μ_paint − μ_road), once for white and once for yellow
    paint; road becomes grey 96 ± 12, the brighter of both projections counts. The samples of paint are pixels that
    stand out of their row (top-hat of ``marking_m`` in any channel); luminance without such samples. Printed:
    "random vectors", an error for adaptive ones. Source: R [65]; Fisher, The Use of Multiple Measurements in
    Taxonomic Problems (1936).
    """
    if image.ndim == 2:
        return image
    road = np.isfinite(view.pixel_m)
    pixels = image.astype(np.float32)
    hats = np.stack([row_top_hat(image[:, :, i], view, marking_m) for i in range(3)], axis=2)
    scatter = np.percentile(hats[road][::2, ::2].reshape(-1, 3), USUAL, axis=0) + SENSOR_GREY
    standing_out = (hats / scatter).max(axis=2)
    paint = (standing_out > OUTSTANDING) & road[:, None]
    plain = (standing_out < 1) & road[:, None]
    if np.count_nonzero(paint) < MIN_SAMPLES or np.count_nonzero(plain) < MIN_SAMPLES:
        return grey(image, view)
    ground = pixels[plain][:: max(1, np.count_nonzero(plain) // 4000)]
    projected = []
    for colour in _white_and_yellow(pixels[paint], ground):
        weights = discriminant(colour, ground)
        on_road = ground @ weights
        projected.append((pixels @ weights - on_road.mean()) / max(float(on_road.std()), 1e-6))
    grey_levels = ROAD_GREY + TEXTURE_GREY * np.maximum.reduce(projected)
    return np.asarray(np.clip(grey_levels, 0, 255), np.uint8)


def _white_and_yellow(found: Floats, ground: Floats) -> list[Floats]:
    """White and yellow paint; the blue of yellow rises less above the road than its red and green."""
    rise = found - ground.mean(axis=0)
    yellow = rise[:, 0] < 0.5 * rise[:, 1:].mean(axis=1)
    return [part for part in (found[~yellow], found[yellow]) if len(part) >= MIN_SAMPLES // 2]


def discriminant(paint: Floats, ground: Floats) -> Floats:
    """Fisher's w = S_w⁻¹·(μ_paint − μ_road) of colours, shape (n, 3) each; S_w is the scatter within both."""
    within = np.cov(paint.T) + np.cov(ground.T) + SENSOR_GREY**2 * np.eye(3)
    return np.asarray(np.linalg.solve(within, paint.mean(axis=0) - ground.mean(axis=0)), np.float32)
