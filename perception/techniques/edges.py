"""Gradients and the edges they make (inventory B03–B07)."""

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.techniques.picture import Features, Image, Kind, View

Grey = Annotated[float, Field(gt=0)]


def canny(image: Image, view: View, *, low: Grey = 50.0, high: Grey = 150.0) -> Features:
    """Edges of one pixel: gradient, non-maximum suppression, two thresholds [Sobel grey levels] (B03, B09).

    Source: R [43]–[51]; Canny, A Computational Approach to Edge Detection (1986). Cannot see: which edge is paint;
    every shadow and crack with enough contrast is one too.
    """
    return Features(np.asarray(cv2.Canny(image, low, high), np.uint8), Kind.LINE)
