"""What is measured in every image: light, likeness to other images, change since the one before.

``hash`` is the difference hash of 64 bits: the image in 9 × 8 grey values, a bit for each that is greater than its
left neighbour (N. Krawetz, Kind of Like That, 2013). Two frames are near duplicates when their hashes differ in at
most ALIKE_BITS and their small grey copies by at most ALIKE on average.

The shift of the view is that of its upper half, by phase correlation (Kuglin and Hines, 1975). Far from the car it
is proportional to the yaw rate.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.types import Floats, Image, Mask

SMALL = 32, 24  # width and height of the small grey copy
ALIKE_BITS = 2
ALIKE = 2.0 / 255.0
STILL = 0.5 / 255.0  # a change below it is noise of the encoding
UPPER = 160, 60  # width and height of the upper half, for its shift
LARGEST_SHIFT = 0.25  # a larger one is no shift of the same view
_POWERS = 2 ** np.arange(64, dtype=np.uint64)
_WINDOW = cv2.createHanningWindow(UPPER, cv2.CV_32F)
_BLOCK = 512  # rows that are compared at once


@dataclass(frozen=True, slots=True)
class ImageMeasurements:
    """Measurements of n images."""

    light: Floats  # mean grey, 0 to 1; NaN: cannot be read
    hash: NDArray[np.uint64]
    small: Image  # (n, 24, 32) grey
    change: Floats  # from the image before; NaN: there is none
    shift: Floats  # of the view to the right since the image before, in widths; NaN: there is none

    def of(self, rows: Mask) -> "ImageMeasurements":
        """Those of some images."""
        return ImageMeasurements(
            self.light[rows], self.hash[rows], self.small[rows], self.change[rows], self.shift[rows]
        )


def small_grey(image: Image) -> Image:
    """The image in grey and small."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return cv2.resize(grey, SMALL, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def hash_of(image: Image) -> int:
    """The difference hash of an image."""
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (9, 8), interpolation=cv2.INTER_AREA)
    return int((_POWERS * (grey[:, 1:] > grey[:, :-1]).ravel()).sum())


def upper_half(image: Image) -> Floats:
    """The upper half of the image in grey, for :func:`shift_between`."""
    half = cv2.cvtColor(image[: max(1, image.shape[0] // 2)], cv2.COLOR_BGR2GRAY)
    return cv2.resize(half, UPPER, interpolation=cv2.INTER_AREA).astype(np.float32)


def shift_between(before: Floats, after: Floats) -> float:
    """The shift to the right from one upper half to the next, in widths; NaN where it is none."""
    shift = cv2.phaseCorrelate(before, after, _WINDOW)[0][0] / UPPER[0]
    return shift if abs(shift) < LARGEST_SHIFT else float("nan")


def changes(small: Image, stretch: NDArray[np.int32], known: Mask) -> Floats:
    """Mean difference of each small copy from the one before in its stretch, 0 to 1; NaN without one."""
    change = np.full(len(small), np.nan, np.float32)
    if len(small) > 1:
        both = known[1:] & known[:-1] & (stretch[1:] == stretch[:-1])
        difference = np.abs(small[1:].astype(np.int16) - small[:-1]).mean(axis=(1, 2)) / 255.0
        change[1:][both] = difference[both]
    return change


def near_duplicates(look: ImageMeasurements, rows: NDArray[np.intp], others: NDArray[np.intp]) -> Mask:
    """Which of ``rows`` look like one of ``others``."""
    alike = np.zeros(len(rows), bool)
    for start in range(0, len(rows), _BLOCK):
        block = rows[start : start + _BLOCK]
        bits = np.bitwise_count(look.hash[block][:, None] ^ look.hash[others][None, :])
        for mine, other in np.argwhere(bits <= ALIKE_BITS):
            if not alike[start + mine]:
                difference = look.small[block[mine]].astype(np.int16) - look.small[others[other]]
                alike[start + mine] = np.abs(difference).mean() / 255.0 <= ALIKE
    return alike
