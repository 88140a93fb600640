"""How far the boundaries of a lane are visible in the image: lines and kerbs are, the edge of a guess is not."""

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.evenness import columns
from trepid.messages import PixelPath
from trepid.types import Array, Image

WIDTH_PX = 320  # of the image in which boundaries are searched
MIN_ROWS, MIN_LANE_PX = 6, 12
STEPS = 80  # places across the lane
BEYOND = 20  # places beyond each boundary
APART = 4  # places between the two sides of a line or a step: 5 % of the lane
NEAR = 4  # places of a boundary
INNER = (0.2, 0.8)  # part of the lane whose texture is the standard
CLEAR, FLOOR_GREY = 2.5, 3.0  # times the texture; that of a plain surface


def visible_share(
    image: Image, left: PixelPath, right: PixelPath, *, which: tuple[bool, bool] = (True, True)
) -> float | None:
    """The lesser share of the rows in which the left and the right boundary are visible; None: too little is shown.

    ``which``: the boundaries that count; no pixel shows the middle of a road without a line.

    A boundary is visible in a row where a line |2·g(0) − g(−a) − g(a)|/2 or a step |g(a) − g(−a)| of the grey level
    g, with a = ``APART``, within ``NEAR`` of it is ``CLEAR`` times the median of the same inside the lane. A
    boundary beside the image has no share.
    """
    scale = image.shape[1] / WIDTH_PX
    size = (WIDTH_PX, max(1, round(image.shape[0] / scale)))
    first, last = (columns(path, np.arange(size[1]) * scale) / scale for path in (left, right))
    rows = np.flatnonzero(last - first > MIN_LANE_PX)  # False for NaN
    if len(rows) < MIN_ROWS:
        return None
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    across = np.arange(-BEYOND, STEPS + BEYOND + 1) / STEPS
    column = first[rows, None] + (last - first)[rows, None] * across
    clear = _change(grey.astype(np.float32), rows, column)
    clear[(column < 0) | (column > WIDTH_PX - 1)] = np.nan
    inner = clear[:, (across > INNER[0]) & (across < INNER[1])]
    known = np.isfinite(inner).any(axis=1)
    clear, inner = clear[known], inner[known]
    clear /= np.nanmedian(inner, axis=1)[:, None] + FLOOR_GREY
    shares = [_share(clear[:, at - NEAR : at + NEAR + 1]) for at in _places(which)]
    return min((share for share in shares if share is not None), default=None)


def _places(which: tuple[bool, bool]) -> list[int]:
    return [at for at, counts in zip((BEYOND, BEYOND + STEPS), which, strict=True) if counts]


def _change(grey: NDArray[np.float32], rows: NDArray[np.intp], column: Array) -> NDArray[np.float32]:
    """The greater of line and step at each place (row, column), 0 near the ends."""
    row = np.repeat(rows[:, None], column.shape[1], axis=1).astype(np.float32)
    flat = cv2.remap(grey, column.astype(np.float32), row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    flat = cv2.blur(flat, (3, 3))
    before, middle, after = flat[:, : -2 * APART], flat[:, APART:-APART], flat[:, 2 * APART :]
    change = np.zeros_like(flat)
    change[:, APART:-APART] = np.maximum(np.abs(middle - (before + after) / 2), np.abs(after - before))
    return change.astype(np.float32, copy=False)


def _share(clear: NDArray[np.float32]) -> float | None:
    """Share of the rows inside the image with a clear place; None where too few are."""
    inside = np.isfinite(clear).all(axis=1)
    if np.count_nonzero(inside) < MIN_ROWS:
        return None
    return float(np.mean(clear[inside].max(axis=1) > CLEAR))
