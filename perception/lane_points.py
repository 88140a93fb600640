"""Points of painted lines: narrow bright stripes on darker ground (inventory B02, A10, B10)."""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lateral_grid import LateralGrid
from trepid.config import Settings

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]


class MarkingSettings(Settings):
    """Section ``markings`` of ``config/perception.yaml``."""

    width_m: Positive
    half_range_m: Positive
    sigma_m: Positive
    sigma_px: Positive
    yellow_gain: Annotated[float, Field(ge=0, le=1)]
    min_contrast_grey: Positive
    noise_factor: Positive
    full_contrast_grey: Positive


@dataclass(frozen=True)
class RoadPoints:
    """Points in the vehicle frame that may belong to a boundary."""

    x_m: Array
    y_m: Array
    sigma_m: Array  # lateral standard deviation of one point
    weight: Array  # 0..1, how much the point looks like a boundary
    band: NDArray[np.int64]  # band of the grid it comes from


def marking_channel(image: NDArray[np.uint8], yellow_gain: float) -> NDArray[np.uint8]:
    """One channel in which white and yellow paint are bright on asphalt and on concrete.

    c = (R+G)/2 + g·((R+G)/2 − B): luminance without blue, plus g times the yellowness. It is grey-preserving. The
    fixed form of the adaptive projections of the review (inventory B10); blue shadows get darker, not brighter.
    """
    blue, green, red = (cv2.extractChannel(image, number) for number in range(3))  # a third faster than split
    half = cv2.addWeighted(red, 0.25, green, 0.25, 0)  # halved, so that it cannot saturate
    return cv2.addWeighted(half, 2 * (1 + yellow_gain), blue, -yellow_gain, 0).astype(np.uint8, copy=False)


class MarkingFilter:
    """Row-wise dark-bright-dark filter whose width is that of a painted line at each row's distance."""

    def __init__(self, settings: MarkingSettings, grid: LateralGrid) -> None:
        self._settings, self._grid = settings, grid
        self._step_m = settings.width_m / 2
        edges = int(np.ceil(settings.half_range_m / self._step_m))
        self._edge_m = self._step_m * np.arange(edges, -edges - 1, -1.0)
        columns = grid.camera.cx_px - grid.metre_px[:, None] * self._edge_m + 0.5
        columns = np.clip(columns, 0, grid.camera.width_px)  # nothing is known beside the image
        before = np.minimum(columns.astype(np.int64), grid.camera.width_px - 1)
        self._share_after = (columns - before).astype(np.float32)
        self._before = before + (grid.camera.width_px + 1) * np.arange(len(before))[:, None]
        self._after = self._before + 1
        area = (grid.bottom_px - grid.top_px) * grid.metre_px * settings.width_m
        self._per_pixel = (1 / area).astype(np.float32)[:, None]
        self._sigma_m = np.hypot(settings.sigma_m, settings.sigma_px / grid.metre_px)

    def response(self, channel: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Contrast [grey levels] of a stripe of paint against its brighter neighbour, per band and place.

        ``channel`` begins at the first row of the grid.
        With box means of one line width w at places −w, 0, +w: mean(0) − max(mean(−w), mean(+w)). The boxes are
        differences of the integral image, sampled between pixels: exact also where a line is thinner than one.
        """
        grid = self._grid
        integral = cv2.integral(channel, sdepth=cv2.CV_32S)
        first = int(grid.top_px[0])
        running = (integral[grid.bottom_px - first] - integral[grid.top_px - first]).astype(np.float32)
        sampled = running.take(self._after)
        before = running.take(self._before)
        sampled -= before
        sampled *= self._share_after
        sampled += before
        mean = sampled[:, 2:] - sampled[:, :-2]
        mean *= self._per_pixel
        brighter = np.maximum(mean[:, :-4], mean[:, 4:])
        return np.subtract(mean[:, 2:-2], brighter, out=brighter)

    def points(self, image: NDArray[np.uint8]) -> RoadPoints:
        """Local maxima of the response that stand out of its noise, in a BGR image of the camera's size."""
        below = image[int(self._grid.top_px[0]) :]
        response = self.response(marking_channel(below, self._settings.yellow_gain))
        noise = cv2.norm(response, cv2.NORM_L1) / max(response.size, 1)
        threshold = max(self._settings.min_contrast_grey, self._settings.noise_factor * noise)
        response[:, 0] = response[:, -1] = 0  # a peak has neighbours
        high = np.flatnonzero(response > threshold)
        peak, after = response.take(high), response.take(high + 1)
        before = response.take(high - 1)
        highest = (peak >= after) & (peak > before)
        peak, before, after = peak[highest], before[highest], after[highest]
        band, place = np.divmod(high[highest], response.shape[1])
        shift = 0.5 * (after - before) / np.maximum(2 * peak - before - after, 1e-3)
        left_m = self._edge_m[place + 3] - self._step_m * shift
        x_m, y_m = self._grid.vehicle_from_grid(self._grid.ahead_m[band], left_m)
        return RoadPoints(
            x_m=x_m,
            y_m=y_m,
            sigma_m=self._sigma_m[band],
            weight=np.minimum(peak / self._settings.full_contrast_grey, 1.0).astype(np.float64),
            band=band,
        )
