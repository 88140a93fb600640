"""A dark road as light as one by day."""

import cv2
import numpy as np

from trepid.types import Image

ROAD_ROWS = 0.7  # the road right ahead is below this share of the height of the image


def brighten_road(image: Image, *, grey: float, max_gain: float) -> Image:
    """``image``, BGR, times the gain that gives the road right ahead the median ``grey``, 1 to ``max_gain``.

    A street at dusk keeps its contrasts, but they are below those that a road has by day. The grey level is that of
    the green channel in the lower rows of the middle third. An image that is light enough is returned itself.
    """
    height, width = image.shape[:2]
    ahead = image[int(ROAD_ROWS * height) :: 4, width // 3 : 2 * width // 3 : 4, 1]
    gain = min(grey / max(float(np.median(ahead)), 1.0), max_gain)
    if gain <= 1:
        return image
    return cv2.convertScaleAbs(image, alpha=gain).astype(np.uint8, copy=False)
