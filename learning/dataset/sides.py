"""Cameras to the left and right of the middle one: their labels, and the splits of their frames.

A camera that looks ahead from ``left_m`` beside the middle one sees what the middle one would see if the car stood
there. Its label is therefore not the recorded angle, but the one that leads from there back to the recorded path
(Bojarski et al., End to End Learning for Self-Driving Cars, 2016, section 5.2). It is computed, not recorded: these
frames serve the training alone, and only together with the frame of the middle camera of the same moment.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import NONE, SPLITS
from learning.dataset.likeness import ImageMeasurements
from learning.dataset.sources.log import Log
from learning.dataset.split import clear_duplicates
from trepid.types import Column

NO_IMAGE = "no image of this camera"
NOT_JUDGED = "side camera, of a moment that is not for training"
WITH_MIDDLE = "side camera, whose middle frame is left out"
BEYOND = "side camera, whose way back is beyond full lock"


def returning_rad(
    label_rad: float, left_m: float, turned_rad: float, *, ahead_m: float, wheelbase_m: float
) -> float:
    """Road-wheel angle [rad], + left, that leads from beside a recorded path back to it; NaN for NaN.

    The car stands ``left_m`` to the left of the recorded path and is turned by ``turned_rad`` to the left of it.
    The arc meets the recorded one, of curvature κ = tan(label)/L, at ``ahead_m`` = ℓ (pure pursuit, for small
    angles): κ − 2·left/ℓ² − 2·turned/ℓ.
    """
    curvature_1pm = math.tan(label_rad) / wheelbase_m
    back_1pm = -2 * left_m / ahead_m**2 - 2 * turned_rad / ahead_m
    return math.atan(wheelbase_m * (curvature_1pm + back_1pm))


@dataclass(frozen=True, slots=True)
class WayBack:
    """Where the path from a side camera meets the recorded one, and the car that drives it."""

    ahead_m: float
    wheelbase_m: float
    lock_rad: float | None  # None: not known

    def correct(self, log: Log, recorded_rad: Column) -> Column:
        """The labels of a side camera of the moments of ``recorded_rad``; NaN, with the reason, beyond lock."""
        found = np.array(
            [
                returning_rad(one, log.camera_left_m, 0.0, ahead_m=self.ahead_m, wheelbase_m=self.wheelbase_m)
                for one in recorded_rad.tolist()
            ]
        )
        if self.lock_rad is not None:
            for number in np.flatnonzero(np.abs(found) > self.lock_rad).tolist():
                found[number] = math.nan
                log.why[number] = log.why[number] or BEYOND
        return found


def with_sides(log: Log, side_m: float) -> Iterator[Log]:
    """``log``, then a log of each side camera that it names, row for row, ``side_m`` beside the middle one."""
    yield log
    for name, images, left_m in (("left", log.left, side_m), ("right", log.right, -side_m)):
        if any(images):
            yield replace(
                log,
                image=images,
                route=[f"{route} {name}" for route in log.route],
                why=[why or ("" if image else NO_IMAGE) for why, image in zip(log.why, images, strict=True)],
                camera_left_m=left_m,
                left=[],
                right=[],
                unread=0,
                notes=[],
            )


def moments(logs: list[Log]) -> NDArray[np.int64]:
    """For each row of ``logs`` the number of the row of the middle camera of the same moment."""
    found: list[NDArray[np.int64]] = []
    rows, middle = 0, 0
    for log in logs:
        middle = middle if log.camera_left_m else rows
        found.append(middle + np.arange(len(log)))
        rows += len(log)
    return np.concatenate(found)


def split_sides(
    names: NDArray[np.str_], reasons: NDArray[np.str_], moment: NDArray[np.int64], look: ImageMeasurements
) -> None:
    """Fill in ``names`` and ``reasons`` of the rows of side cameras, by those of the middle one.

    A row trains where its moment does; else it is left out. Rows that look like a row of a later split are too.
    """
    for row in np.flatnonzero(moment != np.arange(len(moment))).tolist():
        if not reasons[row]:
            middle = moment[row]
            trains = names[middle] == SPLITS[0]
            reasons[row] = WITH_MIDDLE if reasons[middle] else "" if trains else NOT_JUDGED
        names[row] = NONE if reasons[row] else SPLITS[0]
    clear_duplicates(names, reasons, look)
    names[reasons != ""] = NONE
