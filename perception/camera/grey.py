"""Grey images."""

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.types import Image

WORKING_WIDTH_PX = 320  # one scale for all cameras: statistics and self-calibration depend on it


def grey(image: Image) -> Image:
    """``image`` (grey or BGR) in grey."""
    if image.ndim == 2 or image.shape[2] == 1:
        return image.reshape(image.shape[:2])
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def small(image: NDArray[np.uint8]) -> Image:
    """``image``, reduced by area averaging to at most ``WORKING_WIDTH_PX`` columns (inventory A04, A05)."""
    if image.shape[1] <= WORKING_WIDTH_PX:
        return image
    height_px = max(1, round(image.shape[0] * WORKING_WIDTH_PX / image.shape[1]))
    return np.asarray(
        cv2.resize(image, (WORKING_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA), np.uint8
    )


def small_grey(image: NDArray[np.uint8]) -> Image:
    """:func:`small` in grey."""
    image = small(image)
    if image.ndim == 3 and image.shape[2] >= 3:
        return cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    return image.reshape(image.shape[:2])
