"""Equalised light and contrast (inventory A18–A20)."""

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.techniques.image.colour import grey
from perception.techniques.image.picture import View
from trepid.types import Image, Positive

LEVELS = 256

Level = Annotated[float, Field(gt=0, lt=255)]


def clahe(
    image: Image, view: View, *, clip: Positive = 2.0, tiles: Annotated[int, Field(ge=1, le=32)] = 8
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


def low_light(image: Image, view: View, *, road_grey: Level = 90.0, most: Positive = 8.0) -> Image:
    """Brighter dark pictures: v·g, with the gain g from 1 to ``most`` that takes the road to ``road_grey`` (A19).

    The median below the horizon counts as the road. Source: R [30], whose trained network restyles night as day;
    this is its exposure alone. Limit: noise; lamps, which saturate.
    """
    road = grey(image, view)[np.isfinite(view.pixel_m)]
    gain = min(road_grey / max(float(np.median(road)), 1.0), most) if road.size else 1.0
    return image if gain <= 1 else np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


def match_histogram(image: Image, view: View, *, mean: Level = 110.0, deviation: Positive = 45.0) -> Image:
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
