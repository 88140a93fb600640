"""Points of painted lines: narrow bright stripes on darker ground (inventory B02, A10, B10)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.grid import LateralGrid
from perception.lane.model.geometry import RoadPoints
from trepid.config import Settings
from trepid.types import Array, Positive, Share

MAX_DOUBLE_M = 0.32  # between the middles of the stripes of a double line (RMS-1: 0.24; MUTCD: 0.2 to 0.3)
MIN_CONTRAST_RATIO = 0.4  # of one stripe of a double line over the other
SPAN = 7  # box edges, half a line width apart, of one response


class MarkingSettings(Settings):
    """Section ``markings`` of ``config/perception.yaml``."""

    width_m: Positive
    half_range_m: Positive
    sigma_m: Positive
    sigma_px: Positive
    yellow_gain: Share
    min_contrast_grey: Positive
    noise_factor: Positive
    full_contrast_grey: Positive


def marking_channel(image: NDArray[np.uint8], yellow_gain: float) -> NDArray[np.uint8]:
    """One channel in which white and yellow paint are bright on asphalt and on concrete.

    c = (R+G)/2 + g·((R+G)/2 − B): luminance without blue, plus g times the yellowness; grey stays grey and
    blue shadows get darker. The fixed form of the adaptive projections of the review (inventory B10).
    """
    blue, green, red = (cv2.extractChannel(image, number) for number in range(3))  # a third faster than split
    half = cv2.addWeighted(red, 0.25, green, 0.25, 0)  # halved, so that it cannot saturate
    return cv2.addWeighted(half, 2 * (1 + yellow_gain), blue, -yellow_gain, 0).astype(np.uint8, copy=False)


class MarkingFilter:
    """Row-wise dark-bright-dark filter as wide as a painted line at the distance of each row.

    The visible places of each band, with a margin, are stored from left to right, and the bands from far to
    near, in one flat array, because near bands have few places inside the image.
    """

    def __init__(self, settings: MarkingSettings, grid: LateralGrid) -> None:
        self._settings, self._grid = settings, grid
        self._step_m = settings.width_m / 2
        edges = int(np.ceil(settings.half_range_m / self._step_m))
        edge_m = self._step_m * np.arange(edges, -edges - 1, -1.0)
        width_px = grid.camera.width_px
        columns = grid.camera.cx_px - grid.metre_px[:, None] * edge_m + 0.5
        band, place = np.nonzero(_widen((columns > 0) & (columns < width_px), SPAN // 2 + 1))
        columns = np.clip(columns[band, place], 0, width_px)  # there are no pixels beside the image
        before = np.minimum(columns.astype(np.int64), width_px - 1)
        self._share_after = (columns - before).astype(np.float32)
        self._before = before + (width_px + 1) * band
        self._after = self._before + 1
        area = (grid.bottom_px - grid.top_px) * grid.metre_px * settings.width_m
        self._per_pixel = (1 / area).astype(np.float32)[band[1:-1]]
        middle = slice(SPAN // 2, -(SPAN // 2))
        self._band, self._left_m = band[middle], edge_m[place[middle]]
        in_one_band = band[SPAN - 1 :] == band[: 1 - SPAN]
        in_one_band[1:-1] &= in_one_band[2:] & in_one_band[:-2]  # a peak has neighbours
        in_one_band[[0, -1]] = False
        self._across_bands = np.flatnonzero(~in_one_band)
        self._places = max(1, int(np.count_nonzero(in_one_band)))
        self._sigma_m = np.hypot(settings.sigma_m, settings.sigma_px / grid.metre_px)

    def response(self, channel: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Contrast [grey levels] of a stripe of paint against its brighter neighbour, per place.

        ``channel`` begins at the first row of the grid. With box means of one line width w at places −w, 0,
        +w: mean(0) − max(mean(−w), mean(+w)). The boxes are differences of the integral image, sampled
        between pixels: exact also where a line is thinner than one.
        """
        grid = self._grid
        integral = cv2.integral(channel, sdepth=cv2.CV_32S)
        first = int(grid.top_px[0])
        running = (integral[grid.bottom_px - first] - integral[grid.top_px - first]).astype(np.float32)
        sampled = running.take(self._after, mode="clip")  # never clips; faster than a check of the bounds
        before = running.take(self._before, mode="clip")
        sampled -= before
        sampled *= self._share_after
        sampled += before
        mean = sampled[2:] - sampled[:-2]
        mean *= self._per_pixel
        brighter = np.maximum(mean[:-4], mean[4:])
        response = np.subtract(mean[2:-2], brighter, out=brighter)
        response[self._across_bands] = 0
        return response

    def points(self, image: NDArray[np.uint8]) -> RoadPoints:
        """Local maxima of the response above its noise, in a BGR image of the size of the camera."""
        settings = self._settings
        below = image[int(self._grid.top_px[0]) :]
        response = self.response(marking_channel(below, settings.yellow_gain))
        noise = cv2.norm(response, cv2.NORM_L1) / self._places
        high = np.flatnonzero(response > max(settings.min_contrast_grey, settings.noise_factor * noise))
        peak, after = response.take(high), response.take(high + 1, mode="clip")
        before = response.take(high - 1, mode="clip")
        highest = np.flatnonzero((peak >= after) & (peak > before))
        peak, before, after, at = peak[highest], before[highest], after[highest], high[highest]
        shift = 0.5 * (after - before) / np.maximum(2 * peak - before - after, 1e-3)
        band, left_m, half_m, peak = _join_twins(
            self._band[at], self._left_m[at] - self._step_m * shift, peak
        )
        x_m, y_m = self._grid.vehicle_from_grid(self._grid.ahead_m[band], left_m)
        return RoadPoints(
            x_m=x_m,
            y_m=y_m,
            sigma_m=self._sigma_m[band],
            weight=np.minimum(peak / settings.full_contrast_grey, 1.0).astype(np.float64),
            band=band,
            half_m=half_m,
        )


def _join_twins(
    band: NDArray[np.int64], left_m: Array, contrast: NDArray[np.float32]
) -> tuple[NDArray[np.int64], Array, Array, NDArray[np.float32]]:
    """The points with the two stripes of a double line replaced by one point in their middle, where the lane ends.

    Only stripes of similar contrast are joined, not a line and the verge next to it. Returns band, place,
    distance to the two stripes (0 for a single stripe) and contrast.
    """
    twin = (band[1:] == band[:-1]) & (left_m[:-1] - left_m[1:] < MAX_DOUBLE_M)
    twin &= np.minimum(contrast[1:], contrast[:-1]) > MIN_CONTRAST_RATIO * np.maximum(
        contrast[1:], contrast[:-1]
    )
    first, half_m = np.flatnonzero(twin), np.zeros(len(band))
    if not len(first):
        return band, left_m, half_m, contrast
    first = first[np.concatenate([[True], np.diff(first) > 1])]  # of three in a row the first two
    half_m[first] = (left_m[first] - left_m[first + 1]) / 2
    left_m[first] -= half_m[first]
    alone = np.ones(len(band), bool)
    alone[first + 1] = False
    return band[alone], left_m[alone], half_m[alone], contrast[alone]


def _widen(shown: NDArray[np.bool_], places: int) -> NDArray[np.bool_]:
    """``shown`` extended by ``places`` on both sides."""
    kernel = np.ones((1, 2 * places + 1), np.uint8)
    return cv2.dilate(shown.astype(np.uint8), kernel) > 0
