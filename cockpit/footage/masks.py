"""Masks drawn into a camera image: drivable area green, lane lines red."""

from collections.abc import Callable

import cv2
import numpy as np

from cockpit.footage.annotate import annotate
from cockpit.footage.frames import FrameResult
from perception.lane.view import as_bgr
from perception.segments.estimator import segmenter_of
from perception.segments.network import Masks
from perception.segments.settings import segment_settings
from trepid.messages import SteeringEstimate
from trepid.types import Floats, Image

AREA, LINES = ((0, 200, 0), 0.35), ((0, 0, 255), 0.8)  # BGR, and how much of it


def with_masks(image: Image, masks: Masks) -> Image:
    """A copy of ``image``, (h, w, 3) BGR, with ``masks`` drawn into it."""
    found: Floats = image.astype(np.float32)
    for mask, (colour, share) in ((masks.area, AREA), (masks.lines, LINES)):
        if mask is not None:
            weight = share * cv2.resize(mask, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)[..., None]
            found += weight * (np.array(colour, np.float32) - found)
    return found.astype(np.uint8)


def masks_and_lane() -> Callable[[FrameResult[SteeringEstimate]], Image]:
    """The drawing of a frame with its masks, its lane and the numbers of its estimate. Raises InputError."""
    segmenter = segmenter_of(segment_settings())

    def draw(one: FrameResult[SteeringEstimate]) -> Image:
        image = as_bgr(one.image)
        return annotate(with_masks(image, segmenter(image)), one.result)

    return draw
