"""The lower end of the visible road: below it, images show the own car.

The rim of a bonnet crosses every image at the same place, from side to side: a level, leaning or arched step of the
grey level with one sign. In a single image a shadow or a kerb across the road may look the same; in a drive these
move. What lies below is neither road nor lane, and its grey level says nothing about the light on the road.
"""

from collections import deque
from itertools import product

import cv2
import numpy as np

from trepid.types import Array, Floats, Image, Mask

WIDTH_PX = 160  # of the image in which the rim is searched
ROWS = (0.6, 0.97)  # of the highest place of a rim, as shares of the height of the image
ARCHES = (0.0, 0.04, 0.08, 0.12)  # by which a rim is lower at the sides
LEANS = (-0.03, 0.0, 0.03)  # by which it is lower at the right side than in the middle
BELOW_HORIZON = 0.15  # heights of the image; of a lens 1.3 m above the ground, 8 m ahead
APART_PX, REACH_PX = 2, 2  # of the rows beside a step; from the curve of a rim to its steps
MIN_STEP_GREY, CLEAR = 6.0, 4.0  # of a step, and in medians of the steps of the lower half
MIN_SHARE, EQUAL = 0.85, 0.01  # of the columns with a step; difference of equal shares
LOOKS, SAME = 8, 0.02  # images that are remembered; heights of the image between equal rims


class LowerEnd:
    """Where the road ends in the images of one camera. Its state: the rims of the last images."""

    def __init__(self) -> None:
        self._rims: deque[float] = deque(maxlen=LOOKS)

    def step(self, image: Image, *, horizon: float = 0.0) -> float:
        """The share of the height of ``image``, (h, w, 3) BGR, above the rim of most looks; 1 without.

        ``horizon``: the share above the horizon, where trees and hills are steps across the image as well.
        """
        self._rims.append(rim(image, horizon=horizon))
        middle = float(np.median(self._rims))
        same = sum(abs(one - middle) <= SAME for one in self._rims)
        return middle if same > len(self._rims) / 2 else 1.0


def rim(image: Image, *, horizon: float = 0.0) -> float:
    """The share of the height of ``image`` above the highest place of a rim across it; 1 without one.

    With S(r, c) = g above row r − g below it, of means of 3×3 pixels, the rim is the curve
    r(x) = top + lean·x + arch·x², −1 ≤ x ≤ 1, that has a step of one sign in the most columns, and in at least
    ``MIN_SHARE`` of them. It lies at least ``BELOW_HORIZON`` below ``horizon``.
    """
    rows = round(image.shape[0] * WIDTH_PX / image.shape[1])
    small = cv2.resize(image, (WIDTH_PX, rows), interpolation=cv2.INTER_AREA)
    grey = cv2.blur(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32), (3, 3))
    step = np.zeros_like(grey)
    step[APART_PX:-APART_PX] = grey[: -2 * APART_PX] - grey[2 * APART_PX :]
    least = max(MIN_STEP_GREY, CLEAR * float(np.median(np.abs(step[rows // 2 :]))))
    tops = np.arange(round(max(ROWS[0], horizon + BELOW_HORIZON) * rows), round(ROWS[1] * rows))
    shares = np.max([_shares(sign * step > least, tops, rows) for sign in (1, -1)], axis=0)
    best = shares.max(axis=0, initial=0.0)
    if not len(tops) or best.max() < MIN_SHARE:
        return 1.0
    top = float(
        np.median(tops[best >= best.max() - EQUAL])
    )  # steps count some rows off the curve, above and below
    return (top - APART_PX) / rows


def _shares(steps: Mask, tops: Array, rows: int) -> Floats:
    """The share of the columns with a step near each curve, shape (arches and leans, tops)."""
    near = cv2.dilate(steps.astype(np.uint8), np.ones((2 * REACH_PX + 1, 1), np.uint8))
    x, column = np.linspace(-1, 1, WIDTH_PX), np.arange(WIDTH_PX)
    shares = []
    for arch, lean in product(ARCHES, LEANS):
        curve = np.round((arch * x**2 + lean * x) * rows).astype(int)
        row = tops[:, None] + curve - curve.min()
        shares.append(np.where(row < rows, near[np.minimum(row, rows - 1), column], 1).mean(axis=1))
    return np.array(shares, np.float32)
