"""From messages to what the supervisor knows: every input judged, the estimates joined, the features measured."""

from collections.abc import Mapping
from typing import NamedTuple

from supervisor.inputs.beside import in_own_lane
from supervisor.inputs.consistency import Consistency
from supervisor.inputs.timers import Stopwatch
from supervisor.inputs.validated import Sighting, SightingSettings, age_s, is_frozen, motion_of, sight
from supervisor.inputs.weak_edges import WeakEdges
from supervisor.path.follow import Follower, Following, FollowSettings, Lead, judge_lead
from supervisor.path.fusion import Fused, Fusion, FusionSettings
from supervisor.rules.inference import FearRules
from supervisor.situation.features import ESTIMATOR_SUFFIXES, FEATURES, Features, early_features, features
from trepid.clothoid import Motion
from trepid.messages import ImageStatistics, LeadVehicle, SteeringEstimate, VehicleState
from trepid.vehicle import Vehicle


class Outlook(NamedTuple):
    """What is known at one moment."""

    seen: list[Sighting]
    ahead: Lead
    motion: Motion | None  # None: lost
    last_motion: Motion | None  # a lost vehicle is taken to go on as it went
    state_age_s: float
    statistics_age_s: float
    trust: dict[str, float]  # of the rules in every estimator, 0..1
    fused: Fused
    trail: Following  # of the vehicle ahead
    near: bool  # it is too near for a comfort stop
    asked: Features  # what the fear rules may ask about

    @property
    def ages_s(self) -> dict[str, float]:
        """Age of the latest estimate of every estimator."""
        return {s.estimator: s.age_s for s in self.seen}

    @property
    def drivable(self) -> bool:
        """Every expected estimator has answered of late, if only that it sees no lane, and one sees one."""
        return bool(self.seen) and None not in [s.confidence for s in self.seen] and bool(self.fused.sources)


class Observer:
    """Makes an outlook of the messages. Remembers the path, the trail, and how well was seen."""

    def __init__(
        self,
        rules: FearRules,
        sightings: SightingSettings,
        fusion: FusionSettings,
        follow: FollowSettings,
        vehicle: Vehicle,
    ) -> None:
        self.adopt(rules)
        self._limits = sightings
        self._half_width_m = vehicle.track_m / 2
        self._fusion, self._follower = Fusion(fusion), Follower(follow, vehicle)
        self._consistency, self._weak_edges = Consistency(), WeakEdges()
        self._saturated, self._single = Stopwatch(), Stopwatch()
        self._last_motion: Motion | None = None

    def adopt(self, rules: FearRules) -> None:
        """Ask what ``rules`` ask about from the next step on."""
        self._rules = rules
        self._expected = [name for name in rules.names if name.endswith(ESTIMATOR_SUFFIXES)]

    def speed_cap_mps(self, lead: Lead) -> float:
        """Greatest speed behind ``lead`` [m/s], inf without one."""
        return self._follower.speed_cap_mps(lead)

    def pace_mps(self, lead: Lead) -> float:
        """The speed up to which fear slows nobody down who follows ``lead`` [m/s]; 0 without a trail."""
        return self._follower.pace_mps(lead)

    def step(
        self,
        estimates: Mapping[str, SteeringEstimate | None],
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
    ) -> Outlook:
        """The outlook at ``now_s`` of the latest messages; None where there has been none."""
        limits = self._limits
        motion = motion_of(state, now_s=now_s, settings=limits)
        self._last_motion = moving = motion or self._last_motion
        ahead = judge_lead(lead, motion, now_s=now_s, settings=limits)
        statistics_age_s = age_s(statistics.t_s if statistics else None, now_s=now_s, settings=limits)
        fresh = statistics if statistics_age_s <= limits.fresh_s else None
        frozen = is_frozen(fresh, moving, settings=limits)
        before_m = self._fusion.offset_m
        seen = [
            in_own_lane(sight(name, e, now_s=now_s, settings=limits, frozen=frozen), before_m)
            for name, e in estimates.items()
        ]
        state_age_s = age_s(state.t_s if state else None, now_s=now_s, settings=limits)
        early = early_features(
            seen,
            fresh,
            ahead,
            motion,
            state_age_s=state_age_s,
            steadiness=self._consistency.step(seen, moving),
            edge_doubt=self._weak_edges.step(seen, moving, now_s=now_s),
            saturated_s=self._saturated.step(state is not None and state.saturated is True, now_s=now_s),
            expected=self._expected,
        )
        trust = {name: voice.trust for name, voice in self._rules.trust(early).items()}
        fused = self._fusion.step(seen, moving, now_s=now_s, trust=trust)
        alone = len(seen) > 1 and len(fused.sources) == 1
        asked = features(
            early,
            seen,
            fused,
            motion,
            trust=trust,
            single_source_s=self._single.step(alone, now_s=now_s),
            half_width_m=self._half_width_m,
        )
        road = fused.path if fused.sources else None
        trail = self._follower.step(ahead, road, moving, now_s=now_s)
        near = self._follower.is_near(ahead, moving)
        return Outlook(
            seen, ahead, motion, moving, state_age_s, statistics_age_s, trust, fused, trail, near, asked
        )


def unknown_features(names: tuple[str, ...]) -> list[str]:
    """Those of ``names`` that nothing measures."""
    return [name for name in names if name not in FEATURES and not name.endswith(ESTIMATOR_SUFFIXES)]
