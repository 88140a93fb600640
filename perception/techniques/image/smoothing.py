"""Smoothing that keeps the markings (inventory A10–A13, A17)."""

import math
from typing import Annotated

import cv2
import numpy as np
from pydantic import AfterValidator, Field

from perception.techniques.image.picture import View
from perception.techniques.image.rows import width_px
from trepid.types import Image, Positive

HALF_CONTRAST = 2 * math.sqrt(2) * 0.476936  # w/σ at which erf(w/(2√2·σ)) = ½


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError("must be odd")
    return value


Odd = Annotated[int, Field(ge=3, le=31), AfterValidator(_odd)]


def gaussian(image: Image, view: View, *, sigma_px: Annotated[float, Field(gt=0, le=20)] = 1.1) -> Image:
    """Gaussian blur, g(x, y) ∝ exp(−(x² + y²)/2σ²); σ = 1.1 px is OpenCV's choice for 5 × 5 (A10).

    Source: R [16], [17]. Limit: a stripe of width w keeps erf(w/(2√2·σ)) of its contrast.
    """
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)


def gaussian_auto(
    image: Image, view: View, *, marking_m: Positive = 0.10, at_m: Positive = 15.0, most_px: Positive = 2.0
) -> Image:
    """Gaussian blur that halves the contrast of a marking of ``marking_m``, ``at_m`` ahead (A13).

    With w columns of paint there, erf(w/(2√2·σ)) = ½ gives σ = w/1.349, at most ``most_px``. Source: R II.A.1.
    Coarse pictures are unchanged.
    """
    sigma_px = min(auto_sigma_px(view, marking_m, at_m), most_px)
    return gaussian(image, view, sigma_px=sigma_px) if sigma_px > 0.3 else image


def auto_sigma_px(view: View, marking_m: float, at_m: float) -> float:
    """The σ that halves the contrast of a marking ``at_m`` ahead; 0 without a row for that distance."""
    row = int(np.argmin(np.abs(np.nan_to_num(view.ahead_m, nan=np.inf) - at_m)))
    return float(width_px(view, marking_m)[row]) / HALF_CONTRAST


def median(image: Image, view: View, *, size_px: Odd = 3) -> Image:
    """The median of each square of ``size_px`` (A11); after ``gaussian`` in a list it is A12.

    Source: R [18]; both: R [19], [20]. Limit: stripes narrower than half of the square.
    """
    return np.asarray(cv2.medianBlur(image, size_px), np.uint8)


def median_auto(image: Image, view: View, *, marking_m: Positive = 0.10, most_px: Odd = 5) -> Image:
    """The median of the largest square that keeps a stripe of ``marking_m`` in its row (A13).

    A k × k median keeps a stripe of w columns that fills more than half of the square: k < 2·w. Source: R II.A.1.
    Far rows are unchanged.
    """
    limit_px = 2 * width_px(view, marking_m)[:, None]
    smooth = image.copy()
    for size in range(3, most_px + 1, 2):
        kept = np.broadcast_to(size < limit_px, image.shape[:2])
        np.copyto(smooth, cv2.medianBlur(image, size), where=kept if image.ndim == 2 else kept[..., None])
    return smooth


def high_pass(image: Image, view: View, *, sigma_px: Positive = 12.0) -> Image:
    """128 + image − its Gaussian blur: removes slow changes of light, keeps stripes and edges (A17).

    Source: R [25], [26], for omnidirectional images. Limit: worn paint; the edge of a shadow stays, with a halo.
    """
    slow = cv2.GaussianBlur(image, (0, 0), sigma_px)
    return np.asarray(np.clip(128 + image.astype(np.int16) - slow.astype(np.int16), 0, 255), np.uint8)
