"""Likelihood of road against the rest for each pixel, by colour (inventory B13, B16)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.config import Settings
from trepid.types import Floats, Image, Positive, Share

Where = NDArray[np.bool_] | NDArray[np.intp]  # a mask, or the indices of its pixels

BINS = 32
LIT_L = 50.0  # L* of sunlit ground; chroma is compared at this lightness
MIN_L, MAX_L = 10.0, 70.0  # darker pixels are noise, brighter ones snow or paint
LIGHT_BIN = (np.arange(256) // 8).astype(np.uint8)


def _chroma_bins() -> NDArray[np.intp]:
    """Bin of each a or b (0..255, neutral: 128) at each lightness (0..255), scaled to L* = ``LIT_L``; flat.

    L* + 16, a* and b* are proportional to cube roots of X, Y and Z, so less light scales all three by one
    factor. Without this scaling, grass in the shade is as grey as a road.
    """
    light = np.clip(np.arange(256) * (100 / 255), MIN_L, MAX_L)
    lit = (np.arange(256) - 128) * ((LIT_L + 16) / (light[:, None] + 16))
    return np.clip(lit // 2 + BINS // 2, 0, BINS - 1).astype(np.intp).ravel()


CHROMA_BIN = _chroma_bins()


class SurfaceSettings(Settings):
    """Section ``surface`` of ``config/perception.yaml``."""

    chroma_limit: Positive
    light_limit: Positive
    light_weight: Share
    smoothing: Positive


@dataclass(frozen=True)
class SurfaceBins:
    """Histogram bins of each pixel of an image."""

    chroma: NDArray[np.intp]
    light: NDArray[np.intp]


def surface_bins(image: Image) -> SurfaceBins:
    """Bins of the CIELAB colour: one of the chroma (a, b) scaled to full light, one of the lightness L."""
    light, a, b = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2Lab))
    shade = light.astype(np.intp) * 256
    return SurfaceBins(
        chroma=CHROMA_BIN[shade + a] * BINS + CHROMA_BIN[shade + b],
        light=cv2.LUT(light, LIGHT_BIN).astype(np.intp),
    )


def road_likelihood(bins: SurfaceBins, road: Where, rest: Where, settings: SurfaceSettings) -> Floats:
    """Log-likelihood ratio road : rest of each pixel; positive for road.

    Chroma separates grass, soil and snow from asphalt in any light. Lightness separates a pavement from a
    road but changes with every shadow, so its weight is lower. Both ratios come from smoothed histograms of
    the pixels in ``road`` (road) and ``rest`` (mostly not road), are limited, and are added as if
    independent. The histograms adapt to the light of every frame, without a threshold (B15).
    """
    chroma = _log_ratio(bins.chroma, road, rest, (BINS, BINS), settings.smoothing, settings.chroma_limit)
    light = _log_ratio(bins.light, road, rest, (1, BINS), settings.smoothing, settings.light_limit)
    by_chroma = np.take(chroma, bins.chroma, mode="clip")
    return by_chroma + np.take(np.float32(settings.light_weight) * light, bins.light, mode="clip")


def _log_ratio(
    bins: NDArray[np.intp], road: Where, rest: Where, shape: tuple[int, int], smoothing: float, limit: float
) -> Floats:
    """log(p_road/p_rest) of each bin, within ±``limit``; ``smoothing`` pixels are added, spread over all bins."""
    ratio = _density(_of(bins, road), shape, smoothing) / _density(_of(bins, rest), shape, smoothing)
    return np.minimum(np.maximum(np.log(ratio), -limit), limit).astype(np.float32).ravel()


def _of(bins: NDArray[np.intp], where: Where) -> NDArray[np.intp]:
    return bins.ravel()[where.ravel()]


def _density(bins: NDArray[np.intp], shape: tuple[int, int], smoothing: float) -> NDArray[np.float64]:
    count = np.bincount(bins, minlength=shape[0] * shape[1]).astype(np.float64).reshape(shape)
    kernel = (3 if shape[1] > 1 else 1, 3 if shape[0] > 1 else 1)
    spread = cv2.GaussianBlur(count, kernel, 0, borderType=cv2.BORDER_REPLICATE) + smoothing / count.size
    return np.asarray(spread / spread.sum(), np.float64)
