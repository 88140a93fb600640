"""Estimates to one path. Roads that contradict each other are never averaged."""

import itertools
import math
from typing import Annotated, NamedTuple

from pydantic import Field

from supervisor.lane import STANDING, Lane, Motion, mean_lane, pursuit_curvature_1pm
from supervisor.sightings import Sighting
from trepid.bounds import at_least, at_most
from trepid.config import Settings

Positive = Annotated[float, Field(gt=0)]


class FusionSettings(Settings):
    """Section ``fusion`` of ``config/supervisor.yaml``."""

    trust: dict[
        str, Annotated[float, Field(gt=0, le=1)]
    ]  # how far each estimator's own confidence is believed
    trust_of_others: Annotated[float, Field(gt=0, le=1)]
    min_lookahead_m: Positive  # where roads are compared: ℓ = max(min_lookahead_m, lookahead_s·v)
    lookahead_s: Positive
    gate_offset_m: Positive  # roads this far apart at the axle ...
    gate_lookahead_m: Positive  # ... or at ℓ are two roads
    memory_s: Annotated[float, Field(gt=0, le=1)]  # how long the path is remembered when nothing is seen


class Path(NamedTuple):
    """The lane to drive, valid at ``t_s``."""

    t_s: float
    lane: Lane
    lookahead_m: float  # how far it was seen
    source: str


class Fused(NamedTuple):
    """What the estimates come to."""

    path: Path | None
    sources: tuple[str, ...]
    trust: tuple[float, ...]  # sums to 1; empty when nothing was fused
    disagreement_mps2: float | None  # greatest |Δκ_cmd|·v² of two estimates; None with fewer than two
    weighted_disagreement_mps2: float  # the same, times the share of the less sure; 0 with fewer than two
    weighted_separation_m: float  # likewise, how far apart they place the car across the lane


class _View(NamedTuple):
    """A usable lane at the common time, and its weight."""

    name: str
    lane: Lane
    confidence: float
    weight: float
    lookahead_m: float
    ahead_m: float  # where the lane is at the common look-ahead, + left


class Fusion:
    """Fuses estimates; remembers the last path and moves it with the vehicle."""

    def __init__(self, settings: FusionSettings) -> None:
        self._settings = settings
        self._memory: Path | None = None
        self._seen_s = -math.inf  # when the memory was last seen by an estimator

    def step(self, sightings: list[Sighting], motion: Motion | None, *, now_s: float) -> Fused:
        """One path from the usable sightings; the moved memory for a while when there are none."""
        moving = motion or STANDING
        used = [s for s in sightings if s.lane is not None]
        t_s = max([s.t_s for s in used]) if used else now_s
        memory = self._coast(moving, t_s)
        lookahead_m = at_least(
            self._settings.lookahead_s * abs(moving.speed_mps), self._settings.min_lookahead_m
        )
        views = [self._view(s, moving, t_s, lookahead_m) for s in used]
        group = self._agreeing(views, memory, lookahead_m)
        total = sum([view.weight for view in group])
        trust = [view.weight / total for view in group]
        if group:
            self._seen_s = t_s
            self._memory = _join(group, trust, t_s)
        else:
            self._memory = memory
        raw_1pm, weighted_1pm, separation_m = _disagreement(views, lookahead_m)
        speed2 = moving.speed_mps**2
        return Fused(
            path=self._memory,
            sources=tuple([view.name for view in group]),
            trust=tuple(trust),
            disagreement_mps2=None if raw_1pm is None else raw_1pm * speed2,
            weighted_disagreement_mps2=weighted_1pm * speed2,
            weighted_separation_m=separation_m,
        )

    def _view(self, sighting: Sighting, motion: Motion, t_s: float, lookahead_m: float) -> _View:
        assert sighting.lane is not None and sighting.confidence is not None
        trust = self._settings.trust.get(sighting.estimator, self._settings.trust_of_others)
        lane = sighting.lane.after(motion, t_s - sighting.t_s)
        weight, ahead_m = trust * sighting.confidence, lane.y_m(lookahead_m)
        return _View(sighting.estimator, lane, sighting.confidence, weight, sighting.lookahead_m, ahead_m)

    def _coast(self, motion: Motion, t_s: float) -> Path | None:
        """The remembered path at ``t_s``, or None when it was last seen too long ago."""
        memory = self._memory
        if memory is None or t_s - self._seen_s > self._settings.memory_s:
            return None
        return Path(t_s, memory.lane.after(motion, t_s - memory.t_s), memory.lookahead_m, "memory")

    def _agreeing(self, views: list[_View], memory: Path | None, lookahead_m: float) -> list[_View]:
        """The views that show one road: that of the memory, without one that of the most trusted view."""
        if not views:
            return []
        if memory is None:
            first = max(views, key=lambda view: view.weight)
        else:
            offset_m, ahead_m = memory.lane.offset_m, memory.lane.y_m(lookahead_m)
            first = min(views, key=lambda v: abs(v.lane.offset_m - offset_m) + abs(v.ahead_m - ahead_m))
        return [view for view in views if view is first or not self._contradict(view, first)]

    def _contradict(self, a: _View, b: _View) -> bool:
        """Whether two lanes lie too far apart at the axle or at the look-ahead."""
        here_m, ahead_m = abs(a.lane.offset_m - b.lane.offset_m), abs(a.ahead_m - b.ahead_m)
        return here_m > self._settings.gate_offset_m or ahead_m > self._settings.gate_lookahead_m


def _join(group: list[_View], trust: list[float], t_s: float) -> Path:
    """The mean of the views that agree."""
    return Path(
        t_s=t_s,
        lane=mean_lane([view.lane for view in group], trust),
        lookahead_m=min([view.lookahead_m for view in group]),
        source="+".join([view.name for view in group]),
    )


def _disagreement(views: list[_View], lookahead_m: float) -> tuple[float | None, float, float]:
    """Greatest |Δκ_cmd| [1/m] of two views, plain and weighted, and greatest weighted |Δe| [m].

    The weight is the lesser confidence over the greater: an unsure view beside a sure one is an outlier rather
    than a contradiction.
    """
    plain, weighted, separation_m = None, 0.0, 0.0
    for a, b in itertools.combinations(views, 2):
        apart = abs(
            pursuit_curvature_1pm(a.ahead_m, lookahead_m) - pursuit_curvature_1pm(b.ahead_m, lookahead_m)
        )
        share = at_most(b.confidence, a.confidence) / at_least(b.confidence, a.confidence)
        plain = at_least(apart, plain or 0.0)
        weighted = at_least(apart * share, weighted)
        separation_m = at_least(abs(a.lane.offset_m - b.lane.offset_m) * share, separation_m)
    return plain, weighted, separation_m
