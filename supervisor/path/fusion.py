"""Fusion of estimates to one path by inverse variance. Contradicting roads are never averaged.

A calibrated confidence c is the probability that the steering angle is less than a tolerance wrong. Of a normal
error with standard deviation σ, in tolerances,

    c = P(|x| < 1) = 2·Φ(1/σ) - 1,   so   1/σ = Φ⁻¹((1 + c)/2),

and independent views are best joined with weights 1/σ² (inverse variance; Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation (2001), section 2.6). The path of the frame before, moved
with the vehicle, is one more view: its variance grows with the time since (a scalar Kalman filter), so that it has
little weight compared with a confident view and smooths unsure ones.
"""

import itertools
import math
from collections import deque
from collections.abc import Mapping
from statistics import NormalDist
from typing import NamedTuple

from supervisor.inputs.validation import ValidatedEstimate
from trepid.bounds import at_least, at_most
from trepid.clothoid import STANDING, Lane, Motion, mean_lane, pursuit_curvature
from trepid.config import Settings
from trepid.messages import EstimateKind
from trepid.types import NonNegative, Positive, PositiveShare

_NORMAL = NormalDist()
MIN_CONFIDENCE, MAX_CONFIDENCE = 0.05, 0.98  # the resolution of a calibration by thousands of frames
NO_TRUST: Mapping[str, float] = {}


class FusionSettings(Settings):
    """Section ``fusion`` of ``config/supervisor.yaml``."""

    trust: dict[str, PositiveShare]  # constant factor of each estimator's own confidence
    trust_of_others: PositiveShare
    min_lookahead_m: Positive  # where roads are compared: ℓ = max(min_lookahead_m, lookahead_s·v)
    lookahead_s: Positive
    gate_offset_m: Positive  # roads this far apart at the axle ...
    gate_lookahead_m: Positive  # ... or at ℓ are two roads
    same_road_sigmas: Positive  # differences up to so many of their standard deviations are those of one road
    usual_deviation_m: Positive  # differences of two offsets by this much are no separation anyway
    rejoin_share: PositiveShare  # of these gates, within which a rejected view is fused again
    memory_s: PositiveShare  # how long the path is remembered without estimates
    forgetting_per_s: Positive  # growth of the variance of the memory, in squared tolerances
    outlier_s: NonNegative  # a single view that contradicts the memory is used after this time ...
    begin_confidence: PositiveShare  # ... with at least this confidence; likewise without a memory
    lasting_s: PositiveShare  # the least separation over this time counts


class Path(NamedTuple):
    """The lane to drive, valid at ``t_s``."""

    t_s: float
    lane: Lane
    lookahead_m: float  # to which it was measured
    source: str
    measured: bool = True  # False: the arc of a steering angle, whose offset and heading error are unknown


class FusionResult(NamedTuple):
    """The result of the fusion."""

    path: Path | None
    sources: tuple[str, ...]  # the fused estimators
    trust: tuple[float, ...]  # their shares; sums to 1; empty when nothing was fused
    disagreement_mps2: float | None  # greatest |Δκ_cmd|·v² of two, v = ℓ/lookahead_s; None: fewer than two
    # the part beyond what both state to know, times their share (:func:`_disagreement`); 0 with fewer than two
    weighted_disagreement_mps2: float
    weighted_separation_m: float  # likewise of two lateral offsets, the least over ``lasting_s``
    unseen_s: float = math.inf  # since the newest frame with a fused lane; inf: none so far


class WeightedLane(NamedTuple):
    """A usable lane at the common time, and its weight."""

    name: str
    lane: Lane
    confidence: float  # times the trust
    weight: float  # 1/σ², per squared tolerance
    lookahead_m: float
    ahead_m: float  # lateral position of the lane at the common look-ahead, + left
    measured: bool = True  # False: the arc of a steering angle, known at the look-ahead only
    ahead_sigma_m: float = 0.0  # standard deviation of ``ahead_m``; 0: not stated
    here_sigma_m: float = 0.0  # likewise of the position at the axle
    seen: bool = True  # in this frame; False: what the estimator remembers


class Memory(NamedTuple):
    """The path of an earlier frame."""

    path: Path | None
    variance: float  # in squared tolerances, at the time of the last estimate
    seen_s: float  # time of the last estimate


class Apart(NamedTuple):
    """Significant difference of the lateral offsets of two views, times the share of the less confident one."""

    t_s: float
    offset_m: float


class Fusion:
    """Fuses estimates; remembers the last path and moves it with the vehicle."""

    def __init__(self, settings: FusionSettings) -> None:
        self._settings = settings
        self._memory = self._before = Memory(None, math.inf, -math.inf)
        self._left_out: frozenset[str] = frozenset()  # rejected at the last frame
        self._apart: deque[Apart] = deque()  # of the last ``lasting_s``, of frames with two views

    @property
    def offset_m(self) -> float | None:
        """Lateral offset of the vehicle from the path of the last step [m]; None without one."""
        path = self._memory.path
        return path.lane.offset_m if path is not None and path.measured else None

    def step(
        self,
        sightings: list[ValidatedEstimate],
        motion: Motion | None,
        *,
        now_s: float,
        trust: Mapping[str, float] = NO_TRUST,
    ) -> FusionResult:
        """One path from the usable estimates; without any, the moved memory for up to ``memory_s``.

        ``trust`` is the present factor of the confidence of each estimator, 1 for estimators without one.
        """
        moving = motion or STANDING
        used = [s for s in sightings if s.lane is not None]
        t_s = max([s.t_s for s in used]) if used else now_s
        if t_s > self._memory.seen_s:  # a frame counts once, also with several decisions
            self._before = self._memory
        coasted = self._coast(moving, t_s)
        lookahead_m = at_least(
            self._settings.lookahead_s * abs(moving.speed_mps), self._settings.min_lookahead_m
        )
        views = [self._view(s, moving, t_s, lookahead_m, trust=trust.get(s.estimator, 1.0)) for s in used]
        remembered = self._remembered_lane(coasted, t_s, lookahead_m)
        group = self._agreeing(views, remembered, t_s)
        self._left_out = frozenset([view.name for view in views if view not in group])
        raw_1pm, weighted_1pm, separation_m = _disagreement(views, lookahead_m, self._settings)
        if raw_1pm is not None:
            separation_m = self._lasting_m(Apart(t_s, separation_m))
        if remembered and not group:  # all rejected: the memory counts as another estimator
            _, held_1pm, held_m = _disagreement([*views, remembered], lookahead_m, self._settings)
            weighted_1pm, separation_m = at_least(held_1pm, weighted_1pm), at_least(held_m, separation_m)
        total = sum([view.weight for view in group])
        if group:
            self._memory = self._join_lanes(group, remembered, t_s, lookahead_m)
        else:
            self._memory = self._before._replace(path=coasted)
        speed2 = (lookahead_m / self._settings.lookahead_s) ** 2  # a slower car comes to that place as well
        return FusionResult(
            path=self._memory.path,
            sources=tuple([view.name for view in group]),
            trust=tuple([view.weight / total for view in group]),
            disagreement_mps2=None if raw_1pm is None else raw_1pm * speed2,
            weighted_disagreement_mps2=weighted_1pm * speed2,
            weighted_separation_m=separation_m,
            unseen_s=at_least(now_s - self._memory.seen_s, 0.0),
        )

    def _lasting_m(self, now: Apart) -> float:
        """The least separation over ``lasting_s``, because short errors of one estimator do not count.

        Frames with a single view do not reduce it. The disagreement about the command has no such delay.
        """
        past = self._apart
        # Only the last decision of a frame counts; also after a step back in time.
        while past and past[-1].t_s >= now.t_s:
            past.pop()
        while past and past[0].t_s < now.t_s - self._settings.lasting_s:
            past.popleft()
        past.append(now)
        return min([apart.offset_m for apart in past])

    def _view(
        self, sighting: ValidatedEstimate, motion: Motion, t_s: float, lookahead_m: float, *, trust: float
    ) -> WeightedLane:
        assert sighting.lane is not None and sighting.confidence is not None
        always = self._settings.trust.get(sighting.estimator, self._settings.trust_of_others)
        confidence = trust * sighting.confidence
        lane = sighting.lane.after(motion, t_s - sighting.t_s)
        return WeightedLane(
            name=sighting.estimator,
            lane=lane,
            confidence=at_least(confidence, MIN_CONFIDENCE),
            weight=information(always * confidence),
            lookahead_m=sighting.lookahead_m,
            ahead_m=lane.y_m(lookahead_m),
            measured=sighting.kind is EstimateKind.LANE,
            ahead_sigma_m=sighting.sigma_m(lookahead_m),
            here_sigma_m=sighting.sigma_m(0.0),
            seen=not sighting.from_memory,
        )

    def _coast(self, motion: Motion, t_s: float) -> Path | None:
        """The remembered path at ``t_s``, or None when it is older than ``memory_s``."""
        path, _, seen_s = self._before
        if path is None or t_s - seen_s > self._settings.memory_s:
            return None
        return Path(t_s, path.lane.after(motion, t_s - path.t_s), path.lookahead_m, "memory", path.measured)

    def _remembered_lane(self, path: Path | None, t_s: float, lookahead_m: float) -> WeightedLane | None:
        """The memory as a view, whose variance grows with its age."""
        if path is None:
            return None
        unseen_s = at_least(t_s - self._before.seen_s, 0.0)
        weight = 1 / (self._before.variance + self._settings.forgetting_per_s * unseen_s)
        return WeightedLane(
            "memory", path.lane, 1.0, weight, path.lookahead_m, path.lane.y_m(lookahead_m), path.measured
        )

    def _agreeing(
        self, views: list[WeightedLane], memory: WeightedLane | None, t_s: float
    ) -> list[WeightedLane]:
        """The views of one road: that of the memory, or without a memory that of the view with the greatest weight.

        Views that see a road decide it, and what an estimator remembers only while it is more confident: it has
        moved the memory here itself, and agrees with it also where the road has bent away.
        If no view agrees with the memory: the views that agree with each other, at once; a single view only with a
        confidence of at least ``begin_confidence`` and a memory without an estimate for ``outlier_s``.
        """
        if not views:
            return []
        surest = max([view.confidence for view in views if view.seen], default=0.0)
        leading = [view for view in views if view.seen or view.confidence > surest]
        if memory is None:
            first, new = max(leading, key=lambda view: view.weight), True
        else:
            first = min(leading, key=lambda v: _apart_m(v, memory))
            new = self._contradict(first, memory)
        group = [view for view in views if view is first or not self._contradict(view, first)]
        if new and len(group) < 2 and not self._begins(first, t_s):
            return []
        return group

    def _begins(self, view: WeightedLane, t_s: float) -> bool:
        """Whether ``view`` alone may replace the remembered road."""
        sure = view.confidence >= self._settings.begin_confidence
        return sure and t_s - self._before.seen_s > self._settings.outlier_s

    def _contradict(self, a: WeightedLane, b: WeightedLane) -> bool:
        """Whether two lanes lie too far apart at the axle or at the look-ahead.

        The gates of a view rejected at the last frame are smaller (``rejoin_share``), so that small errors of the
        other view do not join it to the path again.
        """
        here_m, ahead_m = _here_m(a, b), abs(a.ahead_m - b.ahead_m)
        share = self._settings.rejoin_share if {a.name, b.name} & self._left_out else 1.0
        return (
            here_m > share * self._settings.gate_offset_m or ahead_m > share * self._settings.gate_lookahead_m
        )

    def _join_lanes(
        self, group: list[WeightedLane], memory: WeightedLane | None, t_s: float, lookahead_m: float
    ) -> Memory:
        """The weighted mean of ``group``, and of the memory where it agrees.

        Angles bend the mean of the lanes so that its position at the look-ahead is the mean of all. Angles alone
        are driven without the memory.
        """
        lanes = [view for view in group if view.measured]
        angles = [view for view in group if not view.measured]
        joined = lanes
        known = memory if memory is not None and memory.measured else None
        if lanes and known and not any(self._contradict(view, known) for view in group):
            joined = [*lanes, known]
        total = sum([view.weight for view in joined])
        lane = _mean(joined, total) if lanes else None
        if angles:
            lane, total = _lead_by_angles(lane, total, angles, lookahead_m)
        assert lane is not None
        path = Path(
            t_s=t_s,
            lane=lane,
            lookahead_m=min([view.lookahead_m for view in group]),
            source="+".join([view.name for view in group]),
            measured=bool(lanes),
        )
        return Memory(path, 1 / total, t_s)


def _mean(views: list[WeightedLane], total: float) -> Lane:
    """The mean lane of ``views`` by their weights, which sum to ``total``."""
    return mean_lane([view.lane for view in views], [view.weight / total for view in views])


def _lead_by_angles(
    lane: Lane | None, weight: float, angles: list[WeightedLane], lookahead_m: float
) -> tuple[Lane, float]:
    """``lane`` with ``weight``, bent by ``angles``, and the sum of all weights; without a lane the mean arc.

    With y the lateral position at the look-ahead ℓ, the share s of the angles in the weights and the curvature κ at
    the axle: κ + s·2·(y_angles - y_lane)/ℓ² leads to (1 - s)·y_lane + s·y_angles.
    """
    of_angles = sum([view.weight for view in angles])
    arc, total = _mean(angles, of_angles), weight + of_angles
    if lane is None:
        return arc, total
    aside_m = arc.y_m(lookahead_m) - lane.y_m(lookahead_m)
    bent_1pm = of_angles / total * pursuit_curvature(aside_m, lookahead_m)
    return lane._replace(curvature_1pm=lane.curvature_1pm + bent_1pm), total


def information(confidence: float) -> float:
    """1/σ² of a view whose error is below one tolerance with probability ``confidence``, per squared tolerance."""
    bounded = at_most(at_least(confidence, MIN_CONFIDENCE), MAX_CONFIDENCE)
    return _NORMAL.inv_cdf((1 + bounded) / 2) ** 2


def _apart_m(a: WeightedLane, b: WeightedLane) -> float:
    return _here_m(a, b) + abs(a.ahead_m - b.ahead_m)


def _here_m(a: WeightedLane, b: WeightedLane) -> float:
    """Distance of two lanes at the axle [m]; 0 where one of them is an angle, which has no offset."""
    return abs(a.lane.offset_m - b.lane.offset_m) if a.measured and b.measured else 0.0


def _disagreement(
    views: list[WeightedLane], lookahead_m: float, settings: FusionSettings
) -> tuple[float | None, float, float]:
    """Greatest |Δκ_cmd| [1/m] of two views, plain and significant, and greatest significant |Δe| [m].

    Significant is the part of the difference Δy at the look-ahead ℓ for which the deviations σ that the views state
    do not account, as a curvature: 2·max(0, |Δy| - z·√(σ_a² + σ_b²))/ℓ² with z = ``same_road_sigmas``; likewise of
    the difference Δe of the offsets at the axle, max(0, |Δe| - max(0, z·√(σ_a² + σ_b²) - ``usual_deviation_m``))
    with the σ there: the sets of the rules contain the usual deviation, also of views that state none. Two views of
    one road differ by N(0, σ_a² + σ_b²) (the test of association of two tracks; Bar-Shalom and Li,
    Multitarget-Multisensor Tracking (1995)); the excess over z deviations estimates a difference that is usually 0
    (soft threshold; Donoho, De-noising by soft-thresholding, IEEE Trans. IT 41 (1995)). A view that states no
    deviation has σ = 0. An estimator outside its world is no view: its confidence is below
    ``validation.min_confidence``.

    The significant parts are weighted with the lower confidence of the two over the highest of all views: a view of
    low confidence is probably an outlier, also where it contradicts another one and a third view is sure.
    """
    plain, significant, separation_m = None, 0.0, 0.0
    highest = max([view.confidence for view in views], default=1.0)
    for a, b in itertools.combinations(views, 2):
        apart_1pm = abs(pursuit_curvature(a.ahead_m, lookahead_m) - pursuit_curvature(b.ahead_m, lookahead_m))
        ahead_m = settings.same_road_sigmas * math.hypot(a.ahead_sigma_m, b.ahead_sigma_m)
        here_m = settings.same_road_sigmas * math.hypot(a.here_sigma_m, b.here_sigma_m)
        known_1pm = at_least(apart_1pm - pursuit_curvature(ahead_m, lookahead_m), 0.0)
        unusual_m = at_least(here_m - settings.usual_deviation_m, 0.0)
        known_m = at_least(_here_m(a, b) - unusual_m, 0.0)
        share = at_most(b.confidence, a.confidence) / highest
        plain = at_least(apart_1pm, plain or 0.0)
        significant = at_least(known_1pm * share, significant)
        separation_m = at_least(known_m * share, separation_m)
    return plain, significant, separation_m
