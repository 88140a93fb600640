"""Filters along image rows whose width is a length on the road at that row; they need no warp of the picture."""

from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.techniques.image.picture import FeatureKind, Features, GroundView
from trepid.types import Floats, Image

MAX_HAT_PX = 41  # wider paint is nearer than the nearest row


def width_px(view: GroundView, width_m: float) -> NDArray[np.float64]:
    """``width_m`` on the road in columns, for every row; 0 above the horizon."""
    return np.nan_to_num(width_m / view.pixel_m, nan=0.0)


def row_means(image: Image, edges_m: tuple[float, ...], view: GroundView) -> list[Floats]:
    """Means of the boxes between neighbours of ``edges_m``, which lie that far to the left of every pixel.

    Exact between pixels; edges outside of the picture are moved to its border. 0 above the horizon.
    """
    road = np.flatnonzero(np.isfinite(view.pixel_m))
    first = int(road[0]) if len(road) else image.shape[0]
    running = np.zeros((image.shape[0] - first, image.shape[1] + 1), np.float32)
    np.cumsum(image[first:], axis=1, dtype=np.float32, out=running[:, 1:])
    metre_px = width_px(view, 1.0).astype(np.float32)[first:, None]
    places = _places(metre_px.tobytes(), image.shape[1], edges_m)
    sums = [_between(running, index, share) for index, share in places]
    means = []
    for (left_m, before), (right_m, after) in pairwise(zip(edges_m, sums, strict=True)):
        mean = np.zeros(image.shape, np.float32)
        np.divide(after - before, np.maximum(metre_px * np.float32(left_m - right_m), 1e-3), out=mean[first:])
        means.append(mean)
    return means


@lru_cache(maxsize=8)  # of a camera at rest they are those of the last frame
def _places(
    metre_px: bytes, columns: int, edges_m: tuple[float, ...]
) -> tuple[tuple[NDArray[np.intp], Floats], ...]:
    """Place in the running sums of each edge of each pixel: flat index and share of the way to the next one.

    ``metre_px``: float32 of every row, a metre on the road in columns.
    """
    row_px = np.frombuffer(metre_px, np.float32)[:, None]
    middles = np.arange(columns, dtype=np.float32) + np.float32(0.5)
    found = []
    for edge_m in edges_m:
        place = np.clip(middles - row_px * np.float32(edge_m), 0, columns)
        index = np.minimum(place.astype(np.intp), columns - 1)
        place -= index.astype(np.int32)
        found.append((index + (columns + 1) * np.arange(len(row_px))[:, None], place))
    return tuple(found)


def _between(running: Floats, index: NDArray[np.intp], share: Floats) -> Floats:
    """The running sums between columns, by linear interpolation."""
    flat = running.ravel()
    low = flat.take(index, mode="clip")
    high = flat[1:].take(index, mode="clip")
    high -= low
    high *= share
    high += low
    return np.asarray(high, np.float32)


def row_top_hat(image: Image, view: GroundView, width_m: float) -> Image:
    """Image minus its opening along the row by ``width_m``: bright stripes narrower than that remain.

    Rows with the same odd kernel are filtered together, so that the width follows the distance.
    """
    sizes = 2 * np.ceil(width_px(view, width_m) / 2).astype(int) + 1
    sizes = np.minimum(sizes, min(MAX_HAT_PX, image.shape[1] // 2 * 2 - 1))
    hat = np.zeros_like(image)
    for size in np.unique(sizes[sizes > 1]):
        rows = np.flatnonzero(sizes == size)
        part = slice(int(rows[0]), int(rows[-1]) + 1)  # nearer rows are wider: a group is a run
        kernel = np.ones((1, int(size) + 2), np.uint8)
        hat[part] = cv2.morphologyEx(image[part], cv2.MORPH_TOPHAT, kernel)
    return hat


def upright_line(response: Floats, least: float) -> Features:
    """The responses above ``least`` that are the greatest among their neighbours in the row, as line features."""
    left = np.pad(response[:, :-1], ((0, 0), (1, 0)), constant_values=np.inf)
    right = np.pad(response[:, 1:], ((0, 0), (0, 1)), constant_values=np.inf)
    peak = (response >= right) & (response > left)
    return Features(np.where(peak & (response > least), response, np.float32(0)), FeatureKind.LINE)
