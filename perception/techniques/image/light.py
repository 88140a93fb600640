"""Smoothing, light and contrast (inventory A10–A13, A17–A20)."""

import math
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from perception.techniques.image.colour import grey
from perception.techniques.image.picture import GroundView
from perception.techniques.image.rows import width_px
from trepid.types import Image, Positive

LEVELS = 256
HALF_CONTRAST = 2 * math.sqrt(2) * 0.476936  # w/σ at which erf(w/(2√2·σ)) = ½

Level = Annotated[float, Field(gt=0, lt=255)]


def clahe(
    image: Image, view: GroundView, *, clip: Positive = 2.0, tiles: Annotated[int, Field(ge=1, le=32)] = 8
) -> Image:
    """Histogram equalisation in tiles, with limited gain (A18); of colour images the lightness.

    Source: R [27]–[29], after smoothing; Zuiderveld, Contrast Limited Adaptive Histogram Equalization, Graphics
    Gems IV (1994). Limit: noise is raised as well.
    """
    equaliser = cv2.createCLAHE(clip, (tiles, tiles))
    if image.ndim == 2:
        return np.asarray(equaliser.apply(image), np.uint8)
    lab = cv2.cvtColor(image, cv2.COLOR_BGR2Lab)
    lightness = equaliser.apply(cv2.extractChannel(lab, 0))
    return np.asarray(cv2.cvtColor(cv2.insertChannel(lightness, lab, 0), cv2.COLOR_Lab2BGR), np.uint8)


def low_light(image: Image, view: GroundView, *, road_grey: Level = 90.0, most: Positive = 8.0) -> Image:
    """Brighter dark pictures: v·g, with the gain g from 1 to ``most`` that takes the road to ``road_grey`` (A19).

    The median below the horizon counts as the road. Source: R [30], whose trained network restyles night as day;
    this is its exposure alone. Limit: noise; lamps, which saturate.
    """
    road = grey(image, view)[np.isfinite(view.pixel_m)]
    gain = min(road_grey / max(float(np.median(road)), 1.0), most) if road.size else 1.0
    return image if gain <= 1 else np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


def match_histogram(
    image: Image, view: GroundView, *, mean: Level = 110.0, deviation: Positive = 45.0
) -> Image:
    """Grey levels mapped so that their histogram becomes the reference: a normal one of these moments (A20).

    See :func:`matching`. Colour images are mapped by the histogram of their luminance. Source: D 4.2, eq. 1–3,
    [14], [15], with the histogram of a training picture. Limit: pictures half in shadow.
    """
    levels = np.arange(LEVELS)
    reference = np.exp(-0.5 * ((levels - mean) / deviation) ** 2)
    table = matching(np.bincount(grey(image, view).ravel(), minlength=LEVELS), reference)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def matching(counts: NDArray[np.number], reference: NDArray[np.number]) -> NDArray[np.uint8]:
    """The table of grey levels that maps the histogram ``counts`` to ``reference``.

    h(i) = n_i/N, H(j) = Σ_{i≤j} h(i), T(j) = ⌊(K−1)·H(j)⌋ with K = 256 for both; v goes to the smallest z with
    T_ref(z) ≥ T(v). Printed: the index runs "0 … 245, 255".
    """
    own, wanted = _levels(counts), _levels(reference)
    return np.minimum(np.searchsorted(wanted, own, side="left"), LEVELS - 1).astype(np.uint8)


def _levels(counts: NDArray[np.number]) -> NDArray[np.int64]:
    """T(j) = ⌊(K−1)·H(j)⌋."""
    share = np.cumsum(counts, dtype=np.float64)
    return np.floor((LEVELS - 1) * share / share[-1] + 1e-9).astype(np.int64)


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError("must be odd")
    return value


Odd = Annotated[int, Field(ge=3, le=31), AfterValidator(_odd)]


def gaussian(
    image: Image, view: GroundView, *, sigma_px: Annotated[float, Field(gt=0, le=20)] = 1.1
) -> Image:
    """Gaussian blur, g(x, y) ∝ exp(−(x² + y²)/2σ²); σ = 1.1 px is OpenCV's choice for 5 × 5 (A10).

    Source: R [16], [17]. Limit: a stripe of width w keeps erf(w/(2√2·σ)) of its contrast.
    """
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)


def gaussian_auto(
    image: Image,
    view: GroundView,
    *,
    marking_m: Positive = 0.10,
    at_m: Positive = 15.0,
    most_px: Positive = 2.0,
) -> Image:
    """Gaussian blur that halves the contrast of a marking of ``marking_m``, ``at_m`` ahead (A13).

    With w columns of paint there, erf(w/(2√2·σ)) = ½ gives σ = w/1.349, at most ``most_px``. Source: R II.A.1.
    Coarse pictures are unchanged.
    """
    sigma_px = min(auto_sigma_px(view, marking_m, at_m), most_px)
    return gaussian(image, view, sigma_px=sigma_px) if sigma_px > 0.3 else image


def auto_sigma_px(view: GroundView, marking_m: float, at_m: float) -> float:
    """The σ that halves the contrast of a marking ``at_m`` ahead; 0 without a row for that distance."""
    row = int(np.argmin(np.abs(np.nan_to_num(view.ahead_m, nan=np.inf) - at_m)))
    return float(width_px(view, marking_m)[row]) / HALF_CONTRAST


def median(image: Image, view: GroundView, *, size_px: Odd = 3) -> Image:
    """The median of each square of ``size_px`` (A11); after ``gaussian`` in a list it is A12.

    Source: R [18]; both: R [19], [20]. Limit: stripes narrower than half of the square.
    """
    return np.asarray(cv2.medianBlur(image, size_px), np.uint8)


def median_auto(image: Image, view: GroundView, *, marking_m: Positive = 0.10, most_px: Odd = 5) -> Image:
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


def high_pass(image: Image, view: GroundView, *, sigma_px: Positive = 12.0) -> Image:
    """128 + image − its Gaussian blur: removes slow changes of light, keeps stripes and edges (A17).

    Source: R [25], [26], for omnidirectional images. Limit: worn paint; the edge of a shadow stays, with a halo.
    """
    slow = cv2.GaussianBlur(image, (0, 0), sigma_px)
    return np.asarray(np.clip(128 + image.astype(np.int16) - slow.astype(np.int16), 0, 255), np.uint8)
