"""From messages to the state of the world: inputs validated, estimates fused, features measured."""

import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

from supervisor.inputs.consistency import Consistency, Edges
from supervisor.inputs.road_users import WatchedUsers, judge_road_users
from supervisor.inputs.timers import Stopwatch
from supervisor.inputs.turning import TurnExcess
from supervisor.inputs.validation import (
    ValidatedEstimate,
    ValidationSettings,
    in_own_lane,
    is_frozen,
    motion_of,
    state_doubt,
    validate,
)
from supervisor.inputs.watchdog import LEAD, STATE, STATISTICS, USERS
from supervisor.path.follow import Follower, Following, FollowSettings, Lead, judge_lead
from supervisor.path.fusion import Fusion, FusionResult, FusionSettings, Path
from supervisor.path.giving_way import GivingWay, GivingWaySettings, Way
from supervisor.path.sight_speed import ReliableSight, SightSettings, SightSpeed
from supervisor.rules.inference import FearRules
from supervisor.situation.added import RATED_AS, Moment, absent_values, added_values, rating_names
from supervisor.situation.features import BEYOND, DOUBT, Features, early_features, features, rating_features
from trepid.bounds import at_least
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Motion
from trepid.messages import ImageStatistics, LeadVehicle, RoadUsers, SteeringEstimate, VehicleState


class WorldState(NamedTuple):
    """The inputs of a decision except mode and timers."""

    estimates: list[ValidatedEstimate]
    ahead: Lead
    road_users: WatchedUsers
    motion: Motion | None  # None: lost
    last_motion: Motion | None  # the last valid one
    state_age_s: float
    doubted: tuple[str, ...]  # fields of the newest state that do not hold
    statistics_age_s: float
    trust: dict[str, float]  # in every estimator by the rules, 0..1
    fused: FusionResult
    trail: Following  # of the vehicle ahead
    way: Way  # that road users leave to the car
    near: bool  # a vehicle ahead or a road user is too near for a comfort stop
    sight: ReliableSight
    sight_too_short: bool  # speed tracking cannot stop the car within the sight
    closes_in: bool  # ... nor before the vehicle ahead
    features: Features  # the inputs of the fear rules

    @property
    def ages_s(self) -> dict[str, float]:
        """Age of the latest estimate of every estimator."""
        return {e.estimator: e.age_s for e in self.estimates}

    @property
    def surest(self) -> float:
        """Greatest confidence of a usable lane or angle; 0 without one."""
        return max([e.confidence or 0.0 for e in self.estimates if e.lane], default=0.0)

    @property
    def proposal_mps(self) -> float:
        """The least speed that a driving network proposes; inf without a proposal."""
        return min([e.speed_mps for e in self.estimates if e.speed_mps is not None], default=math.inf)


class WorldStateObserver:
    """Computes the world state from the messages. Keeps the path, the trail, and how steady estimates have been."""

    def __init__(
        self,
        validation: ValidationSettings,
        fusion: FusionSettings,
        follow: FollowSettings,
        giving_way: GivingWaySettings,
        sight: SightSettings,
        vehicle: Vehicle,
        *,
        rated_as: Mapping[str, str] = RATED_AS,
        enlargement: float = 1.0,
    ) -> None:
        """``enlargement``: of the world of all these relative to that of the car (:mod:`trepid.scale`)."""
        self._validation, self._rated_as = validation, rated_as
        self._enlargement = enlargement
        self._vehicle = vehicle
        self._half_width_m, self._wheelbase_m = vehicle.track_m / 2, vehicle.wheelbase_m
        self._fusion, self.follower = Fusion(fusion), Follower(follow, vehicle)
        self._giving_way = GivingWay(giving_way, vehicle)
        self._sight = SightSpeed(
            sight,
            front_m=vehicle.wheelbase_m + vehicle.front_overhang_m,
            drive_lag_s=vehicle.accel_lag_s,
        )
        self._consistency, self._edges = Consistency(), Edges()
        self._saturated, self._single = Stopwatch(), Stopwatch()
        self._turn_excess = TurnExcess(vehicle)
        self._last_motion: Motion | None = None

    def step(
        self,
        rules: FearRules,
        estimates: Mapping[str, SteeringEstimate | None],
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
        malformed: Collection[str] = (),
        road_users: RoadUsers | None = None,
    ) -> WorldState:
        """The world state at ``now_s`` from the latest messages; None where there has been none.

        ``malformed`` names the estimators, and STATISTICS, LEAD, USERS, STATE, whose newest message could not be
        decoded: their values count as broken, their ages as those of the last valid message.
        """
        limits = self._validation
        # Rules that do not rate an incomplete state get the motion without a measured yaw rate as lost.
        known = self._vehicle if DOUBT in rules.inputs else None
        newest = None if STATE in malformed else state
        motion = motion_of(newest, now_s=now_s, settings=limits, vehicle=known)
        self._last_motion = moving = motion or self._last_motion
        ahead = judge_lead(lead, motion, now_s=now_s, settings=limits, malformed=LEAD in malformed)
        watched = judge_road_users(
            road_users, motion, now_s=now_s, settings=limits, malformed=USERS in malformed
        )
        statistics_age_s = limits.age_s(statistics, now_s=now_s)
        valid = statistics_age_s <= limits.fresh_s and STATISTICS not in malformed
        fresh = statistics if valid else None
        frozen = self._unusable(fresh, moving)
        seen = self._validate(estimates, now_s=now_s, frozen=frozen, malformed=malformed)
        state_age_s = limits.age_s(state, now_s=now_s)
        rated = rating_names({e.estimator: e.kind for e in seen}, rules, self._rated_as)
        steadiness = self._consistency.step(seen, moving)
        early = early_features(
            seen,
            fresh,
            ahead,
            motion,
            state_age_s=state_age_s,
            state_doubt=state_doubt(newest, now_s=now_s, settings=limits),
            steadiness=steadiness,
            edges=self._edges.step(seen, moving, now_s=now_s),
            saturated_s=self._saturated.step(state is not None and state.saturated is True, now_s=now_s),
            turn_excess_mps2=self._turn_excess.step(newest, motion, now_s=now_s) / self._enlargement,
            enlargement=self._enlargement,
            rated_as=rated,
            absent=absent_values(rules, len(seen)),
        )
        now = Moment(tuple(seen), fresh, ahead, motion, early, now_s)
        early = added_values(rules.names, now) | early  # Trepid's own inputs take precedence
        voices, trust = rules.trust(early), dict[str, float]()
        one_each = len(set(rated.values())) == len(rated)
        for e in seen:  # of several that are rated by one name, each by its own features
            if (name := rated[e.estimator]) in voices:
                own = voices if one_each else rules.trust(early | rating_features(name, [e], steadiness))
                trust[e.estimator] = own[name].trust
        fused = self._fusion.step(seen, moving, now_s=now_s, trust=trust)
        alone = len(seen) > 1 and len(fused.sources) == 1
        road = fused.path if fused.sources else None
        trail = self.follower.step(ahead, road, moving, now_s=now_s)
        way = self._giving_way.step(watched, fused.path or trail.path, moving, now_s=now_s)
        inputs = features(
            early,
            seen,
            fused,
            motion,
            trust=trust,
            rated_as=rated,
            # Nothing has ever checked the only estimator of a car.
            single_source_s=self._single.step(alone, now_s=now_s) if len(seen) > 1 else BEYOND,
            half_width_m=self._half_width_m,
            way=None if watched.users is None else way,
            enlargement=self._enlargement,
        )
        sight = self._sight.step(
            None if frozen else fresh,
            moving,
            age_s=statistics_age_s,
            now_s=now_s,
            leader_m=self.follower.ahead_m(ahead),
            bend_1pm=_bend_1pm(fused.path),
            watches=lead is not None,
        )
        inputs["sight"] = None if fresh is None else self._sight.share(sight, early["speed"])
        return WorldState(
            estimates=seen,
            ahead=ahead,
            road_users=watched,
            motion=motion,
            last_motion=moving,
            state_age_s=state_age_s,
            doubted=newest.doubted if newest else (),
            statistics_age_s=statistics_age_s,
            trust=trust,
            fused=fused,
            trail=trail,
            way=way,
            near=self.follower.is_near(ahead, moving) or way.hard,
            sight=sight,
            sight_too_short=self._sight.is_too_fast(sight, moving),
            closes_in=self.follower.is_closing_in(ahead, moving, self._sight.firm),
            features=inputs,
        )

    def _unusable(self, statistics: ImageStatistics | None, motion: Motion | None) -> bool:
        """Whether the image repeats for so long that its lanes are not used; also where the vehicle may move."""
        limits = self._validation
        return statistics is not None and is_frozen(
            statistics.frozen_s,
            motion and motion.speed_mps,
            after_s=limits.unused_frozen_s,
            from_mps=limits.moving_mps,
            if_unknown=True,
        )

    def _validate(
        self,
        estimates: Mapping[str, SteeringEstimate | None],
        *,
        now_s: float,
        frozen: bool,
        malformed: Collection[str],
    ) -> list[ValidatedEstimate]:
        """The validated estimates, each moved into the lane of the last path."""
        before_m = self._fusion.offset_m
        return [
            in_own_lane(
                validate(
                    name,
                    estimate,
                    now_s=now_s,
                    settings=self._validation,
                    wheelbase_m=self._wheelbase_m,
                    frozen=frozen,
                    malformed=name in malformed,
                ),
                before_m,
            )
            for name, estimate in estimates.items()
        ]


def _bend_1pm(path: Path | None) -> float:
    """The greatest curvature of the seen lane [1/m]; 0 without one."""
    if path is None:
        return 0.0
    return at_least(abs(path.lane.curvature_1pm), abs(path.lane.curvature_at(path.lookahead_m)))
