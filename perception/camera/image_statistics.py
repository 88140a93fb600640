"""Quality of a frame from its pixels alone: exposure, contrast, sharpness, dirt, a frozen camera."""

import math
import zlib
from collections import deque
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.grey import small_grey
from trepid.messages import Frame, ImageStatistics
from trepid.types import Image

OVER_EXPOSED_GREY = 250  # at or above: clipped (sensors and codecs clip a little below 255)
UNDER_EXPOSED_GREY = 10  # at or below: sensor noise
REMEMBERED_IMAGES = 256  # 10 s at 25 Hz: longest loop of frames that counts as frozen
SPOT_MAP_PX = (80, 60)  # a quarter of the working size, where texture and noise average out
SPOT_PX = 13  # of that map: the largest spot, a sixth of the image
SPOT_DEPTH = 0.1  # share by which a spot is darker than its surroundings; asphalt varies by half of it
SPOT_DEPTH_GREY = 5.0  # added to that; more than the noise of an image at night
SPOT_MEMORY_S = 0.2  # of the running mean of the dark spots: what stands still by chance is gone after it
STANDING_SHARE = 0.7  # of that mean, from which on a spot stands still: after 0.24 s
LARGEST_SHARE = 0.34  # of one frame in that mean, after however long a time: three frames at the least
SPATTERED = 0.45  # share of spotted tiles in two consecutive frames that counts at once
FLOW_HPS = 1.0  # [heights of the camera per second]: below, all times for spots grow in proportion
APART_S = 0.015  # between these frames at the least: in less, they are alike
STREAK_PX, THICK_PX = 8, 4  # of that map: least length of a streak along the way, least width of a blot
HORIZON = 0.48  # share of the rows above it, of a usual camera
BEARINGS = 240  # around the vanishing point
TILES = (6, 8)  # rows (a multiple of 3) and columns of tiles in which spots are counted
MIN_SPOTTED = 0.03  # share of the area of a tile with dirt: three pixels of the map in its hundred
MIN_STANDING = 0.5  # share of the dark spots that stand still: 0.65 to 0.9 with mud, 0.4 by chance with noise


class ImageStatistician:
    """Statistics of every frame. Keeps checksums of past images, and where dark spots stand still."""

    def __init__(self, horizon: float = HORIZON) -> None:
        """``horizon``: share of the rows of a frame that are above it."""
        self._horizon = round(min(max(horizon, 0.0), 1.0), 2)
        self._checksums: deque[int] = deque(maxlen=REMEMBERED_IMAGES)
        self._new_s = 0.0  # time of the last image that was new
        self._spots: Image | None = None  # dark spots of the last frame, and its time ...
        self._spots_s = 0.0
        self._standing: NDArray[np.float32] | None = None  # ... and their running mean, 0..255

    def step(self, frame: Frame, *, now_s: float, speed_hps: float | None = None) -> ImageStatistics:
        """Statistics of ``frame``; ``frozen_s`` grows with ``now_s`` even if the capture time does not.

        ``speed_hps``: of the car, in heights of the camera per second; None: not known.
        """
        grey = small_grey(frame.image)
        mean, deviation = cv2.meanStdDev(grey)
        return ImageStatistics(
            t_s=frame.t_s,
            brightness=float(mean[0, 0]) / 255,
            contrast=float(deviation[0, 0]) / 255,
            over_exposed=np.count_nonzero(grey >= OVER_EXPOSED_GREY) / grey.size,
            under_exposed=np.count_nonzero(grey <= UNDER_EXPOSED_GREY) / grey.size,
            sharpness=_sharpness(grey),
            frozen_s=self._freeze_s(grey, max(frame.t_s, now_s)),
            spots=self._spot_share(grey, frame.t_s, speed_hps),
        )

    def _freeze_s(self, grey: Image, t_s: float) -> float:
        """Time [s] without a new image: with a single image, two in turn, or a loop of ``REMEMBERED_IMAGES``.

        Images of a live sensor never repeat, because of its noise.
        """
        checksum = zlib.crc32(np.ascontiguousarray(grey).data)
        if checksum in self._checksums:
            self._checksums.remove(checksum)
        else:
            self._new_s = t_s
        self._checksums.append(checksum)
        return max(0.0, t_s - self._new_s)

    def _spot_share(self, grey: Image, t_s: float, speed_hps: float | None) -> float:
        """Share of tiles with a dark spot that stands still; 0 in the first frame.

        A spot stands still when the running mean over SPOT_MEMORY_S contains it; dirt that covers SPATTERED of the
        tiles counts from its second frame on. Patterns of the ground, joints and shadows stand still by chance for
        two frames, seldom longer. Streaks along the way look the same while they pass, and do not count. All that a
        car sees stands still with it: then nothing is learned, and what was known of the lens is kept.
        """
        spots, before = _without_streaks(_dark_spots(grey), self._horizon), self._spots
        dt_s, self._spots, self._spots_s = max(t_s - self._spots_s, 0.0), spots, t_s
        dt_s *= 1.0 if speed_hps is None else min(abs(speed_hps) / FLOW_HPS, 1.0)
        if before is None or self._standing is None:
            self._standing = np.zeros(spots.shape, np.float32)
            return 0.0
        share = min(1.0 - math.exp(-dt_s / SPOT_MEMORY_S), LARGEST_SHARE)
        cv2.accumulateWeighted(spots, self._standing, share)
        seen = _areas(spots)
        at_once = _spotted_share(cv2.min(before, spots), seen)
        lasting = np.multiply(self._standing > 255 * STANDING_SHARE, 255, dtype=np.uint8)
        counts = dt_s >= APART_S and at_once >= SPATTERED
        return at_once if counts else _spotted_share(lasting, seen)


def _spotted_share(standing: cv2.typing.MatLike, seen: NDArray[np.int64]) -> float:
    """Share of tiles with a spot in ``standing``, where the thirds of the frame have ``seen`` dark pixels.

    The minimum over the upper, middle and lower third of the image: dirt is in all of them, clouds, trees and
    objects on the road are not. A third where most spots moved counts as clean.
    """
    rows, columns = TILES
    share = cv2.resize(standing, (columns, rows), interpolation=cv2.INTER_AREA)
    spotted = (share >= 255 * MIN_SPOTTED).reshape(3, -1).mean(axis=1)
    return float(np.where(_areas(standing) > MIN_STANDING * seen, spotted, 0.0).min())


def _areas(spots: cv2.typing.MatLike) -> NDArray[np.int64]:
    """Number of pixels set in the upper, middle and lower third."""
    third = len(spots) // 3
    return np.array([cv2.countNonZero(spots[row : row + third]) for row in (0, third, 2 * third)])


def _dark_spots(grey: Image) -> Image:
    """255 where the reduced image is darker than left and right of it and than above and below it.

    Closing (black-hat transform) with a row and with a column; a line, a track or the edge of the road is
    darker in one direction only.
    """
    small = cv2.resize(grey, SPOT_MAP_PX, interpolation=cv2.INTER_AREA)
    around = cv2.min(_close_gaps(small, (SPOT_PX, 1)), _close_gaps(small, (1, SPOT_PX)))
    depth = cv2.subtract(around, small)
    return cv2.compare(
        depth, cv2.addWeighted(around, SPOT_DEPTH, around, 0.0, SPOT_DEPTH_GREY), cv2.CMP_GT
    ).astype(np.uint8, copy=False)


def _without_streaks(spots: Image, horizon: float) -> Image:
    """``spots`` without the thin ones that run towards the vanishing point.

    A kerb, a seam and texture that the motion blurs lie along the flow of the image, so that they stand still in it
    while the car moves. They are found as runs of STREAK_PX along the radius in an image of bearing and radius, and
    kept where they are THICK_PX wide in every direction, as dirt is.
    """
    to_polar, back = _polar_maps(horizon)
    runs = cv2.remap(spots, *to_polar, cv2.INTER_NEAREST)
    runs = cv2.morphologyEx(runs, cv2.MORPH_OPEN, _rectangle((STREAK_PX, 1)))
    streaks = cv2.dilate(
        cv2.remap(runs, *back, cv2.INTER_NEAREST), _rectangle((3, 3))
    )  # with their ragged sides
    thick = cv2.morphologyEx(spots, cv2.MORPH_OPEN, _rectangle((THICK_PX, THICK_PX)))
    return cv2.subtract(spots, cv2.subtract(streaks, thick)).astype(np.uint8, copy=False)


Maps = tuple[NDArray[np.float32], NDArray[np.float32]]  # columns and rows of the source


@cache
def _polar_maps(horizon: float) -> tuple[Maps, Maps]:
    """From the map to an image with a row per bearing and a column per pixel of radius, and back."""
    width, height = SPOT_MAP_PX
    middle, row = (width - 1) / 2, horizon * height
    bearing = np.linspace(0.0, math.tau, BEARINGS, endpoint=False)[:, None]
    radius = np.arange(math.ceil(math.hypot(middle, height)) + 1)
    y, x = np.mgrid[:height, :width] - np.array([row, middle])[:, None, None]
    there = middle + radius * np.cos(bearing), row + radius * np.sin(bearing)
    back = np.hypot(x, y), np.arctan2(y, x) % math.tau * (BEARINGS / math.tau)
    to_polar, from_polar = (tuple(one.astype(np.float32) for one in maps) for maps in (there, back))
    return (to_polar[0], to_polar[1]), (from_polar[0], from_polar[1])


def _close_gaps(image: cv2.typing.MatLike, size: tuple[int, int]) -> cv2.typing.MatLike:
    return cv2.morphologyEx(image, cv2.MORPH_CLOSE, _rectangle(size))


@cache
def _rectangle(size: tuple[int, int]) -> cv2.typing.MatLike:
    return cv2.getStructuringElement(cv2.MORPH_RECT, size)


def _sharpness(grey: Image) -> float:
    """Variance of the Laplacian, from its sums; exact, and ten times as fast as meanStdDev."""
    laplacian = cv2.Laplacian(grey, cv2.CV_16S)
    mean = cv2.sumElems(laplacian)[0] / grey.size
    return max(0.0, cv2.norm(laplacian, cv2.NORM_L2SQR) / grey.size - mean**2)
