"""The orientation of a mounted camera: images of a turned or mirrored camera made upright."""

from typing import Literal

import cv2
import numpy as np

from trepid.config import Settings
from trepid.types import Image

_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
_FLIPS = {"horizontal": 1, "vertical": 0}


class Mount(Settings):
    """Section ``mount`` of ``config/camera_source.yaml``: the image is mirrored, then turned."""

    mirror: Literal["none", "horizontal", "vertical"] = "none"
    rotate_deg: Literal[0, 90, 180, 270] = 0  # clockwise

    def upright(self, image: Image) -> Image:
        """The corrected image; 90 and 270 degrees exchange width and height. The values of the pixels are exact."""
        if self.mirror != "none":
            image = np.asarray(cv2.flip(image, _FLIPS[self.mirror]), np.uint8)
        if self.rotate_deg:
            image = np.asarray(cv2.rotate(image, _TURNS[self.rotate_deg]), np.uint8)
        return image
