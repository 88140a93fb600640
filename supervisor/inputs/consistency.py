"""Steadiness of an estimator: its lane now compared with its lane before, moved by odometry.

A road does not jump, so the change of the lane from frame to frame is the error of an estimator without memory,
measured without ground truth. For a network on images unlike its training data it grows before its confidence
falls (compare Michelmore et al., Evaluating uncertainty quantification in end-to-end autonomous driving control,
2018; ensembles and dropout measure the same at several times the price).

Jitter is the rms jump from frame to frame over the last half second: an error at present. Path jitter is the rms
jump between frames STEP_M apart over the last PATH_JITTER_M of road: a road unlike the training data. Path jitter
decays with distance only, because the image of a standing car does not change.
"""

import math
from typing import NamedTuple

from supervisor.inputs.running_mean import RunningMean
from supervisor.inputs.validated import ValidatedEstimate
from trepid.clothoid import STANDING, Lane, Motion

MEMORY_S = 0.5  # over which jumps are averaged: twelve frames
PATH_JITTER_M = 10.0  # ... or of the way: the length of a comfort stop, after which the value still holds
STEP_M = 0.3  # of way between the frames compared for it: images of a creeping car are nearly the same
KNOWN_M = 0.05  # jump of the network on roads like its training data ...
KNOWN_SHARE = 0.2  # ... and its weight before the first jump
AHEAD_M = 8.0  # where lanes are compared: a second ahead at the speed of the shuttle
LONGEST_S = 0.3  # longest time between two compared estimates; as fresh_s, the age of a usable estimate


class Steadiness(NamedTuple):
    """Root mean square jump of a lane at AHEAD_M."""

    jitter_m: float  # over the last MEMORY_S; 0 without a lane now, or without two lanes to compare
    path_jitter_m: float  # over the last PATH_JITTER_M of way, begun with KNOWN_M


class _PathJitter(NamedTuple):
    """Running mean of squared jumps by way."""

    before: Lane  # the lane to compare the next one with, moved by odometry
    way_m: float = 0.0  # driven since that frame
    square_m2: RunningMean = RunningMean(KNOWN_SHARE * KNOWN_M**2, KNOWN_SHARE)

    def after(self, lane: Lane, motion: Motion, dt_s: float) -> "_PathJitter":
        """With the lane ``dt_s`` later, weighted by the way since the last, once that is STEP_M."""
        before, way_m = self.before.after(motion, dt_s), self.way_m + abs(motion.speed_mps) * dt_s
        if way_m < STEP_M:
            return self._replace(before=before, way_m=way_m)
        jump_m = lane.y_m(AHEAD_M) - before.y_m(AHEAD_M)
        return _PathJitter(lane, 0.0, self.square_m2.after(jump_m**2, way_m, length=PATH_JITTER_M))


class _Track(NamedTuple):
    """Memory of one estimator."""

    t_s: float
    lane: Lane
    square_m2: RunningMean  # of squared jumps by time
    path_jitter: _PathJitter


class Consistency:
    """Steadiness of the lane of every estimator."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def step(self, seen: list[ValidatedEstimate], motion: Motion | None) -> dict[str, Steadiness]:
        """The steadiness of every estimator."""
        moving = motion or STANDING
        return {s.estimator: self._steadiness(s, moving) for s in seen}

    def _steadiness(self, s: ValidatedEstimate, motion: Motion) -> Steadiness:
        track = self._tracks.get(s.estimator)
        if s.lane is not None and (track is None or s.t_s != track.t_s):
            track = self._tracks[s.estimator] = _updated(track, s.lane, s.t_s, motion)
        if track is None:
            return Steadiness(0.0, KNOWN_M)
        jitter_m = math.sqrt(track.square_m2.mean) if s.lane is not None else 0.0
        return Steadiness(jitter_m, math.sqrt(track.path_jitter.square_m2.mean))


def _updated(track: _Track | None, lane: Lane, t_s: float, motion: Motion) -> _Track:
    """The means with the jump to ``lane``; after a gap there is no jump, and the mean by time restarts."""
    if track is None:
        return _Track(t_s, lane, RunningMean(0.0), _PathJitter(lane))
    dt_s = t_s - track.t_s
    if not 0 < dt_s <= LONGEST_S:
        return _Track(t_s, lane, RunningMean(0.0), track.path_jitter._replace(before=lane, way_m=0.0))
    jump_m = lane.y_m(AHEAD_M) - track.lane.after(motion, dt_s).y_m(AHEAD_M)
    square_m2 = track.square_m2.after(jump_m**2, dt_s, length=MEMORY_S)
    return _Track(t_s, lane, square_m2, track.path_jitter.after(lane, motion, dt_s))
