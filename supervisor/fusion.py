"""Estimates to one path. Roads that contradict each other are never averaged."""

import itertools
import math
from typing import Annotated, NamedTuple

from pydantic import Field

from supervisor.lane import STANDING, Lane, Motion, mean_lane
from supervisor.sightings import Sighting
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
        t_s = max((s.t_s for s in used), default=now_s)
        memory = self._coast(moving, t_s)
        lookahead_m = max(self._settings.min_lookahead_m, self._settings.lookahead_s * abs(moving.speed_mps))
        views = [self._view(s, moving, t_s) for s in used]
        group = self._agreeing(views, memory, lookahead_m)
        if group:
            self._seen_s = t_s
            self._memory = self._join(group, t_s)
        else:
            self._memory = memory
        raw_1pm, weighted_1pm, separation_m = _disagreement(views, lookahead_m)
        speed2 = moving.speed_mps**2
        total = sum(view.weight for view in group)
        return Fused(
            path=self._memory,
            sources=tuple(view.name for view in group),
            trust=tuple(view.weight / total for view in group),
            disagreement_mps2=None if raw_1pm is None else raw_1pm * speed2,
            weighted_disagreement_mps2=weighted_1pm * speed2,
            weighted_separation_m=separation_m,
        )

    def _view(self, sighting: Sighting, motion: Motion, t_s: float) -> _View:
        assert sighting.lane is not None and sighting.confidence is not None
        trust = self._settings.trust.get(sighting.estimator, self._settings.trust_of_others)
        lane = sighting.lane.after(motion, t_s - sighting.t_s)
        weight = trust * sighting.confidence
        return _View(sighting.estimator, lane, sighting.confidence, weight, sighting.lookahead_m)

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
            first = min(views, key=lambda view: sum(_gaps_m(view.lane, memory.lane, lookahead_m)))
        return [view for view in views if not self._contradict(view.lane, first.lane, lookahead_m)]

    def _contradict(self, a: Lane, b: Lane, lookahead_m: float) -> bool:
        here_m, ahead_m = _gaps_m(a, b, lookahead_m)
        return here_m > self._settings.gate_offset_m or ahead_m > self._settings.gate_lookahead_m

    def _join(self, group: list[_View], t_s: float) -> Path:
        total = sum(view.weight for view in group)
        return Path(
            t_s=t_s,
            lane=mean_lane([view.lane for view in group], [view.weight / total for view in group]),
            lookahead_m=min(view.lookahead_m for view in group),
            source="+".join(view.name for view in group),
        )


def _gaps_m(a: Lane, b: Lane, lookahead_m: float) -> tuple[float, float]:
    """How far two lanes lie apart at the axle and at the look-ahead [m]."""
    return abs(a.offset_m - b.offset_m), abs(a.y_m(lookahead_m) - b.y_m(lookahead_m))


def _disagreement(views: list[_View], lookahead_m: float) -> tuple[float | None, float, float]:
    """Greatest |Δκ_cmd| [1/m] of two views, plain and weighted, and greatest weighted |Δe| [m].

    The weight is the lesser confidence over the greater: an unsure view beside a sure one is an outlier rather
    than a contradiction.
    """
    plain, weighted, separation_m = None, 0.0, 0.0
    for a, b in itertools.combinations(views, 2):
        apart = abs(a.lane.pursuit_curvature_1pm(lookahead_m) - b.lane.pursuit_curvature_1pm(lookahead_m))
        share = min(a.confidence, b.confidence) / max(a.confidence, b.confidence)
        plain = max(plain or 0.0, apart)
        weighted = max(weighted, apart * share)
        separation_m = max(separation_m, abs(a.lane.offset_m - b.lane.offset_m) * share)
    return plain, weighted, separation_m
