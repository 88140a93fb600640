"""How steadily an estimator sees: its lane now against its lane before, moved by odometry.

A road does not jump. What an estimator without a memory shows from frame to frame is therefore its own error made
visible, without any truth: for a network on pictures unlike those it learned from it grows before its confidence
falls (compare Michelmore et al., Evaluating uncertainty quantification in end-to-end autonomous driving control,
2018; ensembles and dropout measure the same at several times the price).
"""

import math
from typing import NamedTuple

from supervisor.lane import STANDING, Lane, Motion
from supervisor.sightings import Sighting

MEMORY_S = 0.5  # over which jumps are averaged: twelve frames
AHEAD_M = 8.0  # where lanes are compared: a second ahead at the speed of the shuttle
LONGEST_S = 0.3  # two sightings further apart are not compared; as fresh_s, the age of a usable estimate


class _Track(NamedTuple):
    """What is remembered of one estimator."""

    t_s: float
    lane: Lane
    square_m2: float  # running mean of squared jumps


class Consistency:
    """Root mean square jump of each estimator's lane at AHEAD_M over the last MEMORY_S."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def step(self, seen: list[Sighting], motion: Motion | None) -> dict[str, float]:
        """The jitter [m] of every estimator; 0 for one that has not yet shown two lanes to compare."""
        moving = motion or STANDING
        return {s.estimator: self._jitter_m(s, moving) for s in seen}

    def _jitter_m(self, s: Sighting, motion: Motion) -> float:
        track = self._tracks.get(s.estimator)
        if s.lane is not None and (track is None or s.t_s != track.t_s):
            track = self._tracks[s.estimator] = _updated(track, s.lane, s.t_s, motion)
        return math.sqrt(track.square_m2) if track and s.lane is not None else 0.0


def _updated(track: _Track | None, lane: Lane, t_s: float, motion: Motion) -> _Track:
    """The running mean forgets by exp(-dt / MEMORY_S); it begins anew after a gap."""
    dt_s = math.inf if track is None else t_s - track.t_s
    if track is None or not 0 < dt_s <= LONGEST_S:
        return _Track(t_s, lane, 0.0)
    jump_m = lane.y_m(AHEAD_M) - track.lane.after(motion, dt_s).y_m(AHEAD_M)
    kept = math.exp(-dt_s / MEMORY_S)
    return _Track(t_s, lane, kept * track.square_m2 + (1 - kept) * jump_m**2)
