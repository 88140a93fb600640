"""Which marks a lane has: paint along its boundaries, and what its boundaries do not explain.

Lines of a lane run along its boundaries. Reflections of lamps on a polished or wet surface, paint of a junction,
and parked cars are bright pieces all over the surface, of which a wrong lane joins some.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.evenness import columns
from trepid.messages import PixelPath
from trepid.types import Image

WIDTH_PX = 240  # of the image in which marks are searched
MIN_ROWS, MIN_LANE_PX, MIN_PIXELS = 8, 6, 20
STEPS, BEYOND = 40, 10  # places across the lane, and beyond each boundary
APART = 5  # places between a mark and the surface on both sides: an eighth of the lane
CLEAR, FLOOR_GREY = 3.0, 10.0  # times the median difference of the surface, and more than this
ALONG = 4  # places of a mark from its boundary
SURFACE, INNER, PATCH = (0.08, 0.92), (0.15, 0.85), (0.3, 0.7)  # parts of the width of the lane
TEXTURE_FLOOR_GREY = 1.0
MAX_ROUGH = (-0.5, 1.5)


class Marks(NamedTuple):
    """What is on the surface of a lane; the values of the worst one where too little of it is visible."""

    rough: float = MAX_ROUGH[1]  # log of the mean texture over the usual one of the near half
    inside: float = 1.0  # share of the rows with a mark inside
    along: float = 0.0  # lesser share, of both boundaries, of the rows with a mark along it


def marks(
    image: Image, left: PixelPath, right: PixelPath, *, which: tuple[bool, bool] = (True, True)
) -> Marks:
    """The marks of the lane between ``left`` and ``right``, along those boundaries of which ``which`` is true.

    The lane is resampled to rows of equal width. A mark is a place whose grey level is above those ``APART`` to
    both sides by more than ``FLOOR_GREY`` + ``CLEAR`` times the median of this difference. The texture is the
    absolute Laplacian of this image; ``rough`` = log((mean in the lane + 1)/(median in the patch ahead + 1)),
    within ``MAX_ROUGH``: one surface has about 0, at every light.
    """
    scale = image.shape[1] / WIDTH_PX
    size = (WIDTH_PX, max(1, round(image.shape[0] / scale)))
    first, last = (columns(path, np.arange(size[1]) * scale) / scale for path in (left, right))
    rows = np.flatnonzero(last - first > MIN_LANE_PX)  # False for NaN
    if len(rows) < MIN_ROWS:
        return Marks()
    across = np.arange(-BEYOND, STEPS + BEYOND + 1) / STEPS
    column = first[rows, None] + (last - first)[rows, None] * across
    visible = (column >= 0) & (column <= WIDTH_PX - 1)
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    row = np.repeat(rows[:, None], len(across), axis=1).astype(np.float32)
    flat = cv2.remap(
        grey, column.astype(np.float32), row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float32)
    rough = _rough(flat, across, visible)
    if rough is None:
        return Marks()
    bright = _bright(flat) & visible
    along = min(
        float(bright[:, at - ALONG : at + ALONG + 1].any(axis=1).mean())
        for at, counts in zip((BEYOND, BEYOND + STEPS), which, strict=True)
        if counts
    )
    return Marks(rough, float(bright[:, _within(across, INNER)].any(axis=1).mean()), along)


def _rough(
    flat: NDArray[np.float32], across: NDArray[np.float64], visible: NDArray[np.bool_]
) -> float | None:
    """None where too little of the lane right ahead is visible."""
    texture = np.abs(cv2.Laplacian(flat, cv2.CV_32F))
    half = len(flat) // 2
    patch = texture[half:, _within(across, PATCH)][visible[half:, _within(across, PATCH)]]
    if len(patch) < MIN_PIXELS:
        return None
    surface = texture[:, _within(across, SURFACE)][visible[:, _within(across, SURFACE)]]
    usual = float(np.median(patch)) + TEXTURE_FLOOR_GREY
    return float(np.clip(np.log((float(surface.mean()) + TEXTURE_FLOOR_GREY) / usual), *MAX_ROUGH))


def _bright(flat: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Places that are marks."""
    above = np.zeros_like(flat)
    above[:, APART:-APART] = flat[:, APART:-APART] - np.maximum(flat[:, : -2 * APART], flat[:, 2 * APART :])
    return np.asarray(above > CLEAR * np.median(np.abs(above[:, APART:-APART])) + FLOOR_GREY)


def _within(across: NDArray[np.float64], part: tuple[float, float]) -> NDArray[np.bool_]:
    return np.asarray((across > part[0]) & (across < part[1]))
