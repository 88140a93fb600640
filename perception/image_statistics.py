"""What the pixels alone say about how far a frame can be trusted: light, sharpness, a frozen camera."""

import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.messages import Frame, ImageStatistics

WORKING_WIDTH_PX = 320  # sharpness depends on the scale, so every camera is measured at one
OVER_EXPOSED_GREY = 250  # at or above: no detail is left (sensors and codecs clip a little below 255)
UNDER_EXPOSED_GREY = 10  # at or below: nothing but sensor noise


class ImageStatistician:
    """Statistics of every frame; remembers only the checksum of the last image and since when it is the same."""

    def __init__(self) -> None:
        self._checksum: int | None = None
        self._same_since_s = 0.0

    def step(self, frame: Frame, *, now_s: float) -> ImageStatistics:
        """Statistics of ``frame``; ``frozen_s`` runs on with ``now_s`` even when capture time stands still."""
        grey = grey_image(frame.image)
        mean, deviation = cv2.meanStdDev(grey)
        return ImageStatistics(
            t_s=frame.t_s,
            brightness=float(mean[0, 0]) / 255,
            contrast=float(deviation[0, 0]) / 255,
            over_exposed=np.count_nonzero(grey >= OVER_EXPOSED_GREY) / grey.size,
            under_exposed=np.count_nonzero(grey <= UNDER_EXPOSED_GREY) / grey.size,
            sharpness=_sharpness(grey),
            frozen_s=self._frozen_s(grey, max(frame.t_s, now_s)),
        )

    def _frozen_s(self, grey: NDArray[np.uint8], t_s: float) -> float:
        checksum = zlib.crc32(np.ascontiguousarray(grey).data)
        if checksum != self._checksum:
            self._checksum, self._same_since_s = checksum, t_s
        return max(0.0, t_s - self._same_since_s)


def _sharpness(grey: NDArray[np.uint8]) -> float:
    """Variance of the Laplacian; from its sums, which are exact and a tenth of the price of meanStdDev."""
    laplacian = cv2.Laplacian(grey, cv2.CV_16S)
    mean = cv2.sumElems(laplacian)[0] / grey.size
    return max(0.0, cv2.norm(laplacian, cv2.NORM_L2SQR) / grey.size - mean**2)


def grey_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Grey image, reduced by area averaging to at most 320 columns (inventory A04, A05)."""
    if image.shape[1] > WORKING_WIDTH_PX:
        height_px = max(1, round(image.shape[0] * WORKING_WIDTH_PX / image.shape[1]))
        image = cv2.resize(image, (WORKING_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA).astype(
            np.uint8
        )
    if image.ndim == 3 and image.shape[2] >= 3:
        return cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    return image.reshape(image.shape[:2])
