"""Which lines may bound the lane on which side: what a user knows of a track and the image does not show."""

from typing import NamedTuple, Self

import numpy as np

from perception.tape.floor import TapePoints
from perception.tape.settings import RoleSettings, YellowSide
from trepid.types import Array

REMEMBERED = 0.5  # weight of a line that has left the image, whose place has the errors of odometry
YELLOW_SHARE, YELLOW_GREY = 0.4, 20.0  # of the contrast in yellow by that in grey, and its least value


class VotingPoints(NamedTuple):
    """Points of lines, and their weights (n,) where they lie left and right of the middle of a lane."""

    points: TapePoints
    left: Array
    right: Array

    @classmethod
    def of(cls, points: TapePoints, settings: RoleSettings) -> Self:
        """``points`` with the weights of the lines that ``settings`` describe."""
        weight = np.where(points.way_m > 0, REMEMBERED, 1.0)
        if settings.yellow is YellowSide.ANY:
            return cls(points, weight, weight)
        grey, yellow = points.contrast[:, 0], points.contrast[:, 1]
        own = (yellow > YELLOW_GREY) & (yellow > YELLOW_SHARE * np.abs(grey))
        sides = weight * own, weight * ~own
        return cls(points, *(sides if settings.yellow is YellowSide.LEFT else sides[::-1]))

    def weight(self, left_m: Array) -> Array:
        """Weight of every point at ``left_m`` left of the middle of a lane; lanes may be a further first axis."""
        return np.where(left_m > 0, self.left, self.right)
