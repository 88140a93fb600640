"""The right half of the road as a tile shows it: between the middles of its dashed yellow and its solid white line.

Photographed bends are taped by hand, of straight pieces: their lane is wider than that of the drawing, and its
middle lies farther outside. So the lane that is judged is measured in the picture of each tile. On a bend the lines
are functions of the angle around the corner, and on a straight of the way along it.
"""

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from trepid.config import InputError
from trepid.types import Array, Image, Mask

STEPS = 31  # of the way through a tile
YELLOW, WHITE_OUTSIDE, WHITE_INSIDE = (0.35, 0.65), (0.75, 1.3), (0.0, 0.3)  # from the corner, in tiles
LEAST = 5  # pixels of a line at one step
SMOOTH = 5  # steps over which a line is averaged


class TileLane(NamedTuple):
    """Boundaries of the lane by the way through a tile, from its entry to its exit; arrays of shape (STEPS,).

    From the corner of a bend, or from the left edge of a straight as it is driven, in tiles.
    """

    middle: Array
    width: Array


@cache
def picture(path: Path) -> Image:
    """The picture of a tile. Raises InputError where there is none."""
    image = cv2.imread(str(path))
    if image is None:
        raise InputError(f"{path}: no picture of a tile")
    return np.asarray(image, np.uint8)


@cache
def profile(path: Path, *, reverse: bool, turn: int) -> TileLane:
    """The lane of the tile in the picture ``path``.

    ``reverse``: entered where its drawing ends; ``turn``: 0, 1 to the left, -1 to the right. Raises InputError
    where the picture does not show both lines.
    """
    image = picture(path)
    if turn == 0 and reverse:
        image = np.ascontiguousarray(np.rot90(image, 2))
    across, along = _places(image.shape[0], corner_right=path.parent.name == "curve_right", bend=turn != 0)
    yellow, white = _paints(image)
    beyond = {1: WHITE_OUTSIDE, -1: WHITE_INSIDE, 0: WHITE_OUTSIDE}[turn]
    lines = [
        _line(across, along, mask & (across > low) & (across < high))
        for mask, (low, high) in ((yellow, YELLOW), (white, beyond))
    ]
    if any(line is None for line in lines):
        raise InputError(f"{path}: shows no yellow line with a white one beside it")
    middle, edge = (line for line in lines if line is not None)
    if turn and reverse:
        middle, edge = middle[::-1], edge[::-1]
    return TileLane((middle + edge) / 2, np.abs(edge - middle))


def _places(size: int, *, corner_right: bool, bend: bool) -> tuple[Array, Array]:
    """Across the road, in tiles, and along it, 0 to 1, of every pixel of a tile as it is drawn."""
    x, y = np.meshgrid((np.arange(size) + 0.5) / size, 1 - (np.arange(size) + 0.5) / size)
    if not bend:
        return x, y
    from_corner = 1 - x if corner_right else x
    return np.hypot(from_corner, y), np.arctan2(y, from_corner) / (math.pi / 2)


def _paints(image: Image) -> tuple[Mask, Mask]:
    """Pixels of yellow and of white lines."""
    hue, saturation, value = np.moveaxis(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), 2, 0)
    yellow = (hue > 15) & (hue < 40) & (saturation > 110) & (value > 110)
    return np.asarray(yellow), np.asarray((saturation < 70) & (value > 150))


def _line(across: Array, along: Array, on: Mask) -> Array | None:
    """Place of a line at every step, over its gaps; None where it is seen nowhere."""
    step = np.rint(along[on] * (STEPS - 1)).astype(int)
    count = np.bincount(step, minlength=STEPS)
    seen = np.flatnonzero(count >= LEAST)
    if not len(seen):
        return None
    mean = np.bincount(step, across[on], STEPS)[seen] / count[seen]
    whole = np.interp(np.arange(STEPS), seen, mean)
    kernel = np.ones(SMOOTH) / SMOOTH
    return np.convolve(np.pad(whole, SMOOTH // 2, mode="edge"), kernel, mode="valid")
