"""What the pixels alone say about how far a frame can be trusted: light, sharpness, dirt, a frozen camera."""

import zlib
from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.messages import Frame, ImageStatistics

WORKING_WIDTH_PX = 320  # sharpness depends on the scale, so every camera is measured at one
OVER_EXPOSED_GREY = 250  # at or above: no detail is left (sensors and codecs clip a little below 255)
UNDER_EXPOSED_GREY = 10  # at or below: nothing but sensor noise
REMEMBERED_IMAGES = 256  # 10 s at 25 Hz: a loop of at most this many frames is seen to repeat
SPOT_MAP_PX = (80, 60)  # spots are looked for at a quarter of the working size: texture and noise average out
SPOT_PX = 13  # of that map, the largest spot: a sixth of the picture
SPOT_DEPTH = 0.1  # by this share of its surroundings a spot is darker; asphalt varies by half of it
SPOT_DEPTH_GREY = 5.0  # ... and by so much more, which the noise of a night picture does not reach
SPOT_FRAMES = 2  # in so many frames in a row it stands where it was
TILES = (6, 8)  # rows (a multiple of 3) and columns of the picture in which spots are counted
SPOTTED = 0.03  # of a tile's area: three pixels of the map in its hundred
STANDING = (
    0.5  # of its dark spots stand still, where dirt is: 0.65 to 0.9 do of mud; noise keeps 0.4 by chance
)

Map = NDArray[np.uint8]


class ImageStatistician:
    """Statistics of every frame; remembers checksums of past images and where their dark spots were."""

    def __init__(self) -> None:
        self._checksums: deque[int] = deque(maxlen=REMEMBERED_IMAGES)
        self._new_s = 0.0  # when the last image came that had not been seen before
        self._spots: deque[Map] = deque(maxlen=SPOT_FRAMES)

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
            spots=self._spotted(grey),
        )

    def _frozen_s(self, grey: Map, t_s: float) -> float:
        """How long only images have come that came before: one image, two by turns, or a loop.

        Sensor noise never repeats. An image that is met again counts as remembered anew.
        """
        checksum = zlib.crc32(np.ascontiguousarray(grey).data)
        if checksum in self._checksums:
            self._checksums.remove(checksum)
        else:
            self._new_s = t_s
        self._checksums.append(checksum)
        return max(0.0, t_s - self._new_s)

    def _spotted(self, grey: Map) -> float:
        """Share of tiles with a dark spot that has stood still for SPOT_FRAMES frames; 0 before that.

        That of the third of the picture, upper, middle or lower, which has least: dirt is everywhere, while clouds
        stand in the sky, trees at the horizon, and cracks, snow and vehicles on the road. A third whose spots
        mostly come and go is not dirty, however many happen to stand.
        """
        self._spots.append(_dark_spots(grey))
        if len(self._spots) < SPOT_FRAMES:
            return 0.0
        standing = self._spots[0]
        for spots in list(self._spots)[1:]:
            standing = cv2.min(standing, spots).astype(np.uint8, copy=False)
        rows, columns = TILES
        share = cv2.resize(standing, (columns, rows), interpolation=cv2.INTER_AREA)
        spotted = (share >= 255 * SPOTTED).reshape(3, -1).mean(axis=1)
        stood, seen = _areas(standing), _areas(self._spots[-1])
        return float(np.where(stood > STANDING * seen, spotted, 0.0).min())


def _areas(spots: Map) -> NDArray[np.int64]:
    """How many pixels of the upper, middle and lower third are set."""
    return np.array([cv2.countNonZero(third) for third in np.split(spots, 3)])


def _dark_spots(grey: Map) -> Map:
    """255 where the small picture is darker than to the left and right and also than above and below.

    By the closing (black-hat transform) with a row and with a column: a line, a track or the edge of the road is
    darker in one direction only.
    """
    small = cv2.resize(grey, SPOT_MAP_PX, interpolation=cv2.INTER_AREA)
    around = cv2.min(_closed(small, (SPOT_PX, 1)), _closed(small, (1, SPOT_PX)))
    depth = cv2.subtract(around, small)
    return cv2.compare(
        depth, cv2.addWeighted(around, SPOT_DEPTH, around, 0.0, SPOT_DEPTH_GREY), cv2.CMP_GT
    ).astype(np.uint8, copy=False)


def _closed(image: cv2.typing.MatLike, size: tuple[int, int]) -> cv2.typing.MatLike:
    return cv2.morphologyEx(image, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_RECT, size))


def _sharpness(grey: Map) -> float:
    """Variance of the Laplacian; from its sums, which are exact and a tenth of the price of meanStdDev."""
    laplacian = cv2.Laplacian(grey, cv2.CV_16S)
    mean = cv2.sumElems(laplacian)[0] / grey.size
    return max(0.0, cv2.norm(laplacian, cv2.NORM_L2SQR) / grey.size - mean**2)


def grey_image(image: NDArray[np.uint8]) -> Map:
    """Grey image, reduced by area averaging to at most 320 columns (inventory A04, A05)."""
    if image.shape[1] > WORKING_WIDTH_PX:
        height_px = max(1, round(image.shape[0] * WORKING_WIDTH_PX / image.shape[1]))
        image = cv2.resize(image, (WORKING_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA).astype(
            np.uint8
        )
    if image.ndim == 3 and image.shape[2] >= 3:
        return cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    return image.reshape(image.shape[:2])
