"""Weights that even out the distribution of angles: straight roads fill most recordings."""

import numpy as np

from trepid.types import Column

BINS = 21
LARGEST = 10.0  # so that a few rare frames do not fill an epoch


def weights(
    road_wheel_rad: Column, *, bins: int = BINS, power: float = 0.5, largest: float = LARGEST
) -> Column:
    """A weight for each label, of mean 1: (1/count of its bin)^``power``, at most ``largest`` times the least.

    ``power`` 0 leaves the distribution as it is, 1 makes it even. The bins are equal parts of the range up to the
    99.9th percentile of abs(label); labels must be finite.
    """
    if not len(road_wheel_rad):
        return np.empty(0)
    most = float(np.percentile(np.abs(road_wheel_rad), 99.9)) or 1.0
    place = np.clip(((road_wheel_rad / most + 1.0) / 2.0 * bins).astype(int), 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    weight = np.maximum(count, 1)[place] ** -power
    weight = np.minimum(weight, largest * weight.min())
    return np.asarray(weight / weight.mean())
