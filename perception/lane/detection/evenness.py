"""How far the surface of a lane is that of the road right ahead: a pavement, a wall or a car is another one."""

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.messages import PixelPath
from trepid.types import Array, Image

WIDTH_PX = 240  # of the image in which surfaces are compared
MIN_ROWS, MIN_PIXELS, MIN_LANE_PX = 8, 30, 6
PATCH = (0.3, 0.7)  # part of the width of the lane that is compared with all of it
TEXTURE_PX, TEXTURE_FLOOR_GREY = 5, 1.0  # window of the texture; the noise of a plain surface
COLOUR_FLOOR = np.array([4.0, 1.5, 1.5])  # standard deviation of L, a and b on a plain surface
LIGHT_SHARE = 0.5  # of the deviation in L that counts, because light differs along a road
MAX_DEVIATION = 3.0  # standard deviations
PATCH_EVERY = 4  # pixel of the patch


def columns(path: PixelPath, rows_px: Array) -> Array:
    """Columns of a boundary at image rows; NaN beyond its ends."""
    if not path:
        return np.full(len(rows_px), np.nan)
    x_px, y_px = np.array(path).T
    order = y_px.argsort()
    return np.interp(rows_px, y_px[order], x_px[order], left=np.nan, right=np.nan)


def unevenness(image: Image, left: PixelPath, right: PixelPath) -> float | None:
    """Deviation of the far half of a lane from the patch right ahead: 0 on one surface; None: too little visible.

    The sum of two terms: the mean of log t over the log of the median t in the patch, where t is the mean
    absolute Laplacian of grey around a pixel; and the share of pixels whose colour (CIELAB) is more than
    ``MAX_DEVIATION`` standard deviations from the median of the patch. The patch is the middle of the near
    half. Both are relative to the patch, so they adapt to camera, light and surface.
    """
    scale = image.shape[1] / WIDTH_PX
    size = (WIDTH_PX, max(1, round(image.shape[0] / scale)))
    rows = np.arange(size[1])
    first, last = (columns(path, rows * scale) / scale for path in (left, right))
    shown = np.flatnonzero(last - first > MIN_LANE_PX)  # False for NaN
    if len(shown) < MIN_ROWS:
        return None
    top = int(shown[0])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)[top:].astype(np.uint8, copy=False)
    first, last = first[top:, None], last[top:, None]
    across = (np.arange(WIDTH_PX) - first) / np.where(last - first > MIN_LANE_PX, last - first, np.nan)
    near = np.arange(len(small))[:, None] >= len(small) / 2
    patch = (across > PATCH[0]) & (across < PATCH[1]) & near
    far = (across >= 0) & (across <= 1) & ~near
    if min(np.count_nonzero(patch), np.count_nonzero(far)) < MIN_PIXELS:
        return None
    return _rougher(small, patch, far) + _share_of_other_colour(small, patch, far)


def _rougher(image: Image, patch: NDArray[np.bool_], far: NDArray[np.bool_]) -> float:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    change = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
    texture = cv2.blur(change, (TEXTURE_PX, TEXTURE_PX)) + TEXTURE_FLOOR_GREY
    return float(np.mean(np.log(texture[far])) - np.log(np.median(texture[patch])))


def _share_of_other_colour(image: Image, patch: NDArray[np.bool_], far: NDArray[np.bool_]) -> float:
    colour = cv2.cvtColor(image, cv2.COLOR_BGR2Lab)
    own = colour[patch][::PATCH_EVERY].astype(np.float64)
    middle = np.median(own, axis=0)
    sigma = 1.48 * np.median(np.abs(own - middle), axis=0) + COLOUR_FLOOR
    deviation = (colour[far] - middle) * ((LIGHT_SHARE, 1.0, 1.0) / sigma)
    return float(np.mean((deviation * deviation) @ np.ones(3) > MAX_DEVIATION**2))
