"""What does not look like road: the look of a part of the ground, and the upright sides of things that stand on it.

The ground ends at the horizon of the camera, and whatever lies on it, as paint, shadows and joints, lies below. A
thing that is taller than the lens is high hides the horizon: each of its sides is an edge that runs, in one column
of the image, from above the horizon down to its base. The row of the base gives its distance on flat ground.
"""

import math
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.sight.settings import HiddenSettings
from trepid.car.camera import Camera
from trepid.types import Array, Image, Mask

AROUND_RAD = 0.02  # to both sides of the horizon: an edge has its contrast here
SAMPLE = 2  # every second row gives the usual step of the ground
BLOCK_PX = 16  # of the colours of JPEG and MPEG at half resolution; two of their brightness
BREAK_PX = 3  # a gap of one row does not break an edge
SAME_PX = 2  # columns between two edges that are one
GRAIN_PX = 3  # rows below the horizon that may still show what is beyond it


class Edge(NamedTuple):
    """A side of a thing."""

    column_px: float
    base_row_px: float  # in which it meets the ground on which it stands


class UprightEdges:
    """Looks for upright edges in images of one camera."""

    def __init__(self, camera: Camera, settings: HiddenSettings) -> None:
        self._settings = settings
        self._horizon = round(camera.horizon_row_px)
        self._up_px = math.ceil(1.5 * settings.above_rad * camera.fy_px)
        self._least_up_px = round(settings.above_rad * camera.fy_px)
        self._around_px = math.ceil(AROUND_RAD * camera.fy_px)
        self._last = min(
            self._horizon + math.ceil(camera.height_m * camera.fy_px / settings.near_m), camera.height_px
        )
        self._least_base_px = math.ceil(camera.height_m * camera.fy_px / settings.far_m)

    @property
    def is_usable(self) -> bool:
        """Whether the image shows enough above and below the horizon."""
        return self._horizon >= self._up_px and self._last - self._horizon > 2 * self._least_base_px

    def find(self, image: Image) -> list[Edge]:
        """The edges in ``image`` (BGR), from left to right."""
        band = image[self._horizon - self._up_px : self._last]
        difference = cv2.absdiff(band[:, 2:], band[:, :-2])
        blue, green, red = cv2.split(difference)
        step = cv2.blur(cv2.max(cv2.max(blue, green), red), (1, BREAK_PX))
        up = self._up_px
        least = self._least_steps(step[up + GRAIN_PX :: SAMPLE])
        steep = cv2.dilate((step >= least).astype(np.uint8), np.ones((1, 3), np.uint8))
        is_edge = cv2.morphologyEx(steep, cv2.MORPH_CLOSE, np.ones((BREAK_PX, 1), np.uint8)) > 0
        around = step[up - self._around_px : up + self._around_px].mean(axis=0, dtype=np.float32)
        down_px = _run(is_edge[up:])
        stands = (_run(is_edge[:up][::-1]) >= self._least_up_px) & (around >= 0.8 * least)
        columns = np.flatnonzero(stands & (down_px >= self._least_base_px))
        if len(columns) == 0:
            return []
        edges = []
        for one in np.split(columns, np.flatnonzero(np.diff(columns) > SAME_PX) + 1):
            column_px = (
                float(one @ around[one] / around[one].sum()) + 1.0
            )  # a difference lacks the first column
            edges.append(Edge(column_px, self._horizon + float(np.median(down_px[one])) - 0.5))
        return edges

    def _least_steps(self, ground: np.ndarray) -> NDArray[np.float32]:
        """The least step of an edge in each column, by the usual step of the ``ground`` in columns of its phase.

        An image that was compressed by blocks steps at their sides: in every eighth or sixteenth column.
        """
        phases = ground[:, : ground.shape[1] // BLOCK_PX * BLOCK_PX].reshape(-1, BLOCK_PX)
        usual = np.partition(phases, len(phases) // 2, axis=0)[len(phases) // 2]
        least = np.maximum(self._settings.least_step_grey, self._settings.step_multiple * usual)
        return np.resize(least, ground.shape[1]).astype(np.float32)


def _run(is_edge: Mask) -> np.ndarray:
    """Rows from the first one on in which each column is an edge."""
    return np.where(is_edge.all(axis=0), len(is_edge), np.argmin(is_edge, axis=0))


LEAST_PIXELS = 30
NOISE_GREY = 2.0  # least deviation of a colour


class Look(NamedTuple):
    """Colour of a part of the ground, and its deviation."""

    mean: Array  # (3,)
    covariance: Array  # (3, 3)
    inverse: Array  # of the covariance

    @classmethod
    def of(cls, pixels: Array) -> Self | None:
        """The look of ``pixels`` (n, 3), by their median and the spread of nine tenths of them, so that painted
        lines do not count; None of too few."""
        if len(pixels) < LEAST_PIXELS:
            return None
        middle = np.asarray(np.median(pixels, axis=0), float)
        covariance = _covariance(pixels, middle)
        return cls(middle, covariance, np.asarray(np.linalg.inv(covariance), float))

    def distance(self, pixels: Image | Array) -> Array:
        """Deviations between ``pixels`` (..., 3) and this look (Mahalanobis 1936)."""
        off = pixels.astype(float) - self.mean
        return np.asarray(np.sqrt(((off @ self.inverse) * off).sum(axis=-1)))

    def apart(self, other: "Look") -> float:
        """Deviations between two looks: the separation of Fisher (1936)."""
        off = self.mean - other.mean
        return math.sqrt(float(off @ np.linalg.solve(self.covariance + other.covariance, off)) * 2.0)


def _covariance(pixels: Array, middle: Array) -> Array:
    """Covariance around ``middle`` of the nine tenths of ``pixels`` nearest to it, with the noise of the camera."""
    off = pixels - middle
    size = np.abs(off).sum(axis=1)
    inner = off[size <= np.partition(size, int(0.9 * len(size)))[int(0.9 * len(size))]]
    return np.asarray(inner.T @ inner / len(inner) + NOISE_GREY**2 * np.eye(3))
