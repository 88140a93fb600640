"""Colour images to the one channel that the later stages work on (inventory A04, A07, A08, B10)."""

import cv2
import numpy as np

from perception.techniques.picture import Image, View


def grey(image: Image, view: View) -> Image:
    """Luminance, Y = 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601) (A04).

    Source: R [8]–[12]. Cannot see: yellow paint on concrete, which has the same luminance.
    """
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
