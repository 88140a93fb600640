"""Features of estimates over time: how steady lanes are, and how weak the edges of an unmarked road are.

A road does not jump, so the change of the lane from frame to frame, moved by odometry, is the error of an estimator
without memory, measured without ground truth. For a network on images unlike its training data it grows before its
confidence falls (compare Michelmore et al., Evaluating uncertainty quantification in end-to-end autonomous driving
control, 2018; ensembles and dropout measure the same at several times the price). Jitter is the rms jump from frame
to frame over the last half second: an error at present; or the systematic drift, if that is larger: the change over
the last DRIFT_M of way at one point of the road, beyond the greatest jump in it. That is of estimators that track
lines or edges: a curvature that is wrong by the same amount in every frame hardly jumps, but the lane turns away
from the road that it described before. Path jitter is the rms jump between frames STEP_M apart over the last
PATH_JITTER_M of road: a road unlike the training data.

The edges of an unmarked road are measured all along. Trodden snow has edges of its own in patches, between which
the edges of the road come and go: single frames look valid, the mean over the way does not.

Means over the way do not change at standstill, because the image of a standing car does not change.
"""

import math
from typing import NamedTuple

from supervisor.inputs.validation import ValidatedEstimate, surest_of_marking
from trepid.bounds import at_least, at_most
from trepid.clothoid import STANDING, Lane, Motion

MEMORY_S = 0.5  # over which jumps are averaged: twelve frames
PATH_JITTER_M = 10.0  # ... or of the way: the length of a comfort stop, after which the value still holds
STEP_M = 0.3  # of way between the frames compared for it: images of a creeping car are nearly the same
DRIFT_M = 3.0  # of way between the frames compared for the drift: a third of the way to AHEAD_M
DRIFT_S = 1.0  # for which it counts: at 3 m/s and more until the next one
KNOWN_M = 0.05  # jump of the network on roads like its training data ...
KNOWN_SHARE = 0.2  # ... and its weight before the first jump
AHEAD_M = 8.0  # where lanes are compared, or nearer (_comparison_m): a second ahead of the shuttle
LONGEST_S = 0.3  # longest time between two compared estimates; as fresh_s, the age of a usable estimate
EDGES_M = 20.0  # patches of snow are some metres long; a comfort stop from 8 m/s takes 16 m
LONG_UNMARKED_M = 30.0  # longer than any gap between dashes, which is 12 m on motorways


class RunningMean(NamedTuple):
    """A mean whose weights decay exponentially with distance or time: weighted sum, and sum of the weights."""

    total: float
    weight: float = 1.0

    @property
    def mean(self) -> float:
        """The weighted mean."""
        return self.total / self.weight

    def after(self, value: float, step: float, *, length: float) -> "RunningMean":
        """The mean with ``value`` over ``step``; former values keep exp(-step/length) of their weight.

        ``step`` and ``length`` have one unit, of way or of time.
        """
        kept = math.exp(-step / length)
        return RunningMean(kept * self.total + (1 - kept) * value, kept * self.weight + (1 - kept))

    def moved_mean(self, value: float, step: float, *, length: float) -> "RunningMean":
        """:meth:`after` for a mean of weight 1, in the form mean + share·(value - mean), which rounds otherwise."""
        share = 1.0 - math.exp(-step / length)
        return RunningMean(self.total + share * (value - self.total))


class Steadiness(NamedTuple):
    """Jumps of a lane at AHEAD_M, root mean square."""

    jitter_m: float  # over the last MEMORY_S, or the systematic drift; 0 without two lanes to compare
    path_jitter_m: float  # over the last PATH_JITTER_M of way, begun with KNOWN_M


class _PathJitter(NamedTuple):
    """Running mean of squared jumps by way."""

    before: Lane  # the lane to compare the next one with, moved by odometry
    way_m: float = 0.0  # driven since that frame
    square_m2: RunningMean = RunningMean(KNOWN_SHARE * KNOWN_M**2, KNOWN_SHARE)

    def after(self, lane: Lane, motion: Motion, dt_s: float, ahead_m: float) -> "_PathJitter":
        """With the lane ``dt_s`` later, weighted by the way since the last, once that is STEP_M."""
        before, way_m = self.before.after(motion, dt_s), self.way_m + abs(motion.speed_mps) * dt_s
        if way_m < STEP_M:
            return self._replace(before=before, way_m=way_m)
        jump_m = lane.y_m(ahead_m) - before.y_m(ahead_m)
        return _PathJitter(lane, 0.0, self.square_m2.after(jump_m**2, way_m, length=PATH_JITTER_M))


class _Drift(NamedTuple):
    """The last change of the lane over DRIFT_M of way, at the point of the road that lay AHEAD_M ahead before.

    Or over the look-ahead of the first frame, where that is shorter: its lane is not stated beyond.
    """

    before: Lane  # the lane to compare the next one with, moved by odometry
    known_m: float  # up to which its lane was stated
    way_m: float = 0.0  # driven since that frame
    jump_m: float = 0.0  # the greatest from frame to frame since then
    age_s: float = 0.0  # of that frame
    change_m: float = 0.0  # when it was taken, beyond the greatest jump

    @property
    def drift_m(self) -> float:
        """The change; 0 once it is older than DRIFT_S, as at standstill."""
        return self.change_m if self.age_s <= DRIFT_S else 0.0

    def after(self, lane: Lane, motion: Motion, dt_s: float, *, jump_m: float, ahead_m: float) -> "_Drift":
        """With the lane ``dt_s`` later, which jumped by ``jump_m`` from the one before."""
        greatest_m = at_least(abs(jump_m), self.jump_m)
        before, way_m = self.before.after(motion, dt_s), self.way_m + abs(motion.speed_mps) * dt_s
        if way_m < at_most(DRIFT_M, self.known_m):
            return self._replace(before=before, way_m=way_m, jump_m=greatest_m, age_s=self.age_s + dt_s)
        there_m = at_least(at_most(self.known_m - way_m, ahead_m), 0.0)
        change_m = abs(lane.y_m(there_m) - before.y_m(there_m))
        return _Drift(lane, ahead_m, change_m=at_least(change_m - greatest_m, 0.0))


class _Track(NamedTuple):
    """Memory of one estimator."""

    t_s: float
    lane: Lane
    ahead_m: float  # up to which the lane may be compared
    square_m2: RunningMean  # of squared jumps by time
    path_jitter: _PathJitter
    drift: _Drift

    def after(self, lane: Lane, t_s: float, motion: Motion, ahead_m: float) -> "_Track":
        """The means with the jump to ``lane``; after a gap there is no jump, and the mean by time restarts."""
        dt_s = t_s - self.t_s
        if not 0 < dt_s <= LONGEST_S:
            anew = self.path_jitter._replace(before=lane, way_m=0.0)
            return _Track(t_s, lane, ahead_m, RunningMean(0.0), anew, _Drift(lane, ahead_m))
        common_m = at_most(self.ahead_m, ahead_m)
        jump_m = lane.y_m(common_m) - self.lane.after(motion, dt_s).y_m(common_m)
        square_m2 = self.square_m2.after(jump_m**2, dt_s, length=MEMORY_S)
        path_jitter = self.path_jitter.after(lane, motion, dt_s, common_m)
        drift = self.drift.after(lane, motion, dt_s, jump_m=jump_m, ahead_m=ahead_m)
        return _Track(t_s, lane, ahead_m, square_m2, path_jitter, drift)


class Consistency:
    """Steadiness of the lane of every estimator."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def step(self, seen: list[ValidatedEstimate], motion: Motion | None) -> dict[str, Steadiness]:
        """The steadiness of every estimator."""
        return {s.estimator: self._steadiness(s, motion or STANDING) for s in seen}

    def _steadiness(self, s: ValidatedEstimate, motion: Motion) -> Steadiness:
        track, ahead_m = self._tracks.get(s.estimator), _comparison_m(s)
        if s.lane is not None and track is None:
            mean, drift = RunningMean(0.0), _Drift(s.lane, ahead_m)
            track = _Track(s.t_s, s.lane, ahead_m, mean, _PathJitter(s.lane), drift)
        elif s.lane is not None and track is not None and s.t_s != track.t_s:
            track = track.after(s.lane, s.t_s, motion, ahead_m)
        if track is None:
            return Steadiness(0.0, KNOWN_M)
        self._tracks[s.estimator] = track
        jitter_m = math.sqrt(track.square_m2.mean) if s.lane is not None else 0.0
        drift_m = track.drift.drift_m if s.marked is not None else 0.0  # marked: it tracks lines or edges
        return Steadiness(at_least(drift_m, jitter_m), math.sqrt(track.path_jitter.square_m2.mean))


def _comparison_m(s: ValidatedEstimate) -> float:
    """Where the lanes of an estimator are compared: AHEAD_M, or its look-ahead, where its lane is stated."""
    return at_most(AHEAD_M, s.lookahead_m)


class EdgeWay(NamedTuple):
    """The edges of a road without lines over the last metres of way."""

    doubt: float  # mean of 1 - confidence of edges, of 0 for lines, the nearer the heavier [0..1]
    unmarked_m: float  # without lines, less that with lines since, 0..LONG_UNMARKED_M


class Edges:
    """Edges of a road without lines over the way: how weak they are, and for how long there have been no lines."""

    def __init__(self) -> None:
        self._doubt = RunningMean(0.0)
        self._unmarked_m = math.inf  # no lines yet
        self._last_s: float | None = None

    def step(self, seen: list[ValidatedEstimate], motion: Motion | None, *, now_s: float) -> EdgeWay:
        """The means over the last EDGES_M and the way without lines.

        Without an estimator of marking the doubt stays as it is, and the way grows; lines take back what they last.
        """
        way_m = 0.0 if self._last_s is None else abs((motion or STANDING).speed_mps) * (now_s - self._last_s)
        self._last_s, way_m = now_s, at_least(way_m, 0.0)
        known_m, self._unmarked_m = at_most(self._unmarked_m, LONG_UNMARKED_M), self._unmarked_m + way_m
        estimate = surest_of_marking(seen)
        if estimate is not None:
            doubt = 0.0 if estimate.marked else 1.0 - (estimate.confidence or 0.0)
            self._doubt = self._doubt.moved_mean(doubt, way_m, length=EDGES_M)
            if estimate.marked:  # not all of it at once: patches of snow look like lines in single frames
                self._unmarked_m = at_least(known_m - way_m, 0.0) if math.isfinite(self._unmarked_m) else 0.0
        return EdgeWay(self._doubt.mean, at_most(self._unmarked_m, LONG_UNMARKED_M))
