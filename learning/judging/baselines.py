"""Predictions without an image: straight ahead, the mean of the training, the angle of a moment ago."""

import numpy as np
from numpy.typing import NDArray

from learning.judging.scores import Angles

AGO_S = 0.2


def previous(angles: Angles, t_s: Angles, stretch: NDArray[np.int64], *, ago_s: float = AGO_S) -> Angles:
    """The newest angle of the same stretch that is at least ``ago_s`` old at each frame; NaN without one.

    Frames are in the order of stretches and time. A delay of 0.2 s is about that of a driver, so that this baseline
    has seen the driver steer; an image model has not.
    """
    found = np.full(len(angles), np.nan)
    for number in np.unique(stretch):
        (inside,) = np.nonzero(stretch == number)
        at = np.searchsorted(t_s[inside], t_s[inside] - ago_s + 1e-6, side="right") - 1
        known = at >= 0
        found[inside[known]] = angles[inside[at[known]]]
    return found
