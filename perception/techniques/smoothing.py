"""Less noise, as far as the markings stay (inventory A10–A13)."""

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.techniques.picture import Image, View


def gaussian(image: Image, view: View, *, sigma_px: Annotated[float, Field(gt=0, le=20)] = 1.1) -> Image:
    """Gaussian blur, g(x, y) ∝ exp(−(x² + y²)/2σ²); σ = 1.1 px is OpenCV's choice for 5 × 5 (A10).

    Source: R [16], [17]. Cannot keep: a stripe thinner than about 2σ loses half of its contrast.
    """
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)
