"""The look of a part of the ground: its colour and how much it varies, and by how much other pixels differ."""

import math
from typing import NamedTuple, Self

import numpy as np

from trepid.types import Array, Image

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
