"""The step of the supervisor: messages in, decision out."""

import math
import pathlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

from pydantic import Field

from supervisor.inputs.validation import ValidationSettings
from supervisor.inputs.watchdog import FAULTS, LEAD, STATISTICS, Watchdog, cause_of_lateness
from supervisor.modes.analyser import AnalyserSettings, Finding, analyse, is_image_late, traced_cause
from supervisor.modes.doubts import Doubts, is_guess, moment
from supervisor.modes.modes import Effect, ModeSettings, ModeState, brake_of, next_state
from supervisor.modes.speed import Cap, SpeedFactor, least_cap
from supervisor.modes.waits import Bounds, Halt, StartSituation, obstacle, waits_for
from supervisor.path.follow import FollowSettings
from supervisor.path.fusion import FusionSettings, Path
from supervisor.path.giving_way import CLEAR, GivingWaySettings
from supervisor.path.sight_speed import SightSettings
from supervisor.path.trail import HandOver
from supervisor.rules.inference import CALM, FearResult, FearRules
from supervisor.rules.verify import load_verified
from supervisor.situation.added import RATED_AS, near_miss, unrated_names, wrong_ranges
from supervisor.situation.features import unknown_features
from supervisor.situation.line_warning import LineWarning, LineWarningSettings
from supervisor.situation.world_state import WorldState, WorldStateObserver
from trepid.bounds import at_most
from trepid.car.vehicle import Vehicle
from trepid.causes import Cause, unknown_cause
from trepid.config import CONFIG_DIR, InputError, Settings, default_file, fault_line, load, read, read_text
from trepid.loudness import warn
from trepid.messages import (
    Decision,
    ImageStatistics,
    LeadVehicle,
    Limit,
    Losses,
    Mode,
    RoadUsers,
    SteeringEstimate,
    Stop,
    VehicleState,
)
from trepid.processes.lateness import Lateness
from trepid.scale import ReferenceWorld
from trepid.spelling import did_you_mean
from trepid.types import Positive, Share

FieldPath = tuple[str | int, ...]


class SupervisorSettings(Settings):
    """The contents of ``config/supervisor.yaml``."""

    former_names: ClassVar = {"sightings": ("validation",)}

    cruise_speed_mps: Positive
    lost_process_speed_factor: Share
    rated_as: dict[str, str] = Field(default=dict(RATED_AS))  # estimator or kind -> its name in the rules
    validation: ValidationSettings
    analyser: AnalyserSettings
    fusion: FusionSettings
    modes: ModeSettings
    sight: SightSettings
    follow: FollowSettings
    giving_way: GivingWaySettings
    line_warning: LineWarningSettings

    def problems(self, rules: FearRules) -> Iterator[tuple[FieldPath, str]]:
        """Path and error text of every name that ``rules`` do not know, or whose stop can never come.

        A rule for fear or a missing input gives the cause of a stop; a final stop may also have the cause of a
        fault. A rule file lists the causes that it does not give under ``without``.
        """
        for key, problem in unrated_names(rules, self.rated_as):
            yield ("rated_as", key), problem
        known, given = rules.file.known_causes, rules.causes.union(rules.file.without)
        for path, cause in self.modes.causes:
            problem = unknown_cause(cause, known)
            if not problem and cause not in (given | FAULTS if "final_causes" in path else given):
                otherwise = f"a rule file that does not give it needs without: [{cause}]"
                problem = f"no rule gives the cause {cause!r}; {did_you_mean(cause, rules.causes, otherwise)}"
            if problem:
                yield path, problem

    def refuse(self, rules: FearRules, source: pathlib.Path | None) -> None:
        """Raise InputError for ``rules`` that these settings, of the file ``source``, do not fit."""
        for name, hint in unknown_features(rules.names):
            raise InputError(f"the fear rules name an unknown input {name!r}; {hint}")
        for _, fault in wrong_ranges(rules.file.inputs):
            raise InputError(f"the fear rules: {fault}")
        for path, problem in self.problems(rules):
            if source is not None:
                raise InputError(fault_line(path, problem, read(source), source))
            raise InputError(f"{'.'.join(map(str, path))}: {problem}")


class Supervisor:
    """Rates the risk of every frame, fuses the estimates, and decides the path and the speed cap.

    It begins in STOP, also after a restart on the move, and leaves STOP only with healthy inputs: from standstill,
    or when a driver lets go of a moving car. Its state is the remembered path, the trail of the vehicle ahead, the
    mode and its timers. It alone holds the rules; its parts get them at every step.

    It computes in the reference world (:mod:`trepid.scale`), in which rules and settings hold. The inputs of the
    rules, and their values in a decision, are lengths and speeds of that world.
    """

    def __init__(
        self,
        rules: FearRules,
        settings: SupervisorSettings,
        vehicle: Vehicle,
        *,
        source: pathlib.Path | None = None,
    ) -> None:
        """``source`` is the file of ``settings``, for errors. Raises InputError as :meth:`adopt`."""
        enlargement = 1 / vehicle.scale
        self._reference, vehicle = ReferenceWorld(vehicle.scale), vehicle.in_reference_world
        self._settings, self._source = settings, source
        self.adopt(rules)
        validation = settings.validation.of_vehicle(vehicle)
        self._observer = WorldStateObserver(
            validation,
            settings.fusion,
            settings.follow,
            settings.giving_way,
            settings.sight,
            vehicle,
            rated_as=settings.rated_as,
            enlargement=enlargement,
        )
        self._line_warning = LineWarning(settings.line_warning, vehicle)
        self._lateness = Lateness(settings.validation.late)
        self._watchdog = Watchdog(validation, frames_s=settings.modes.comfort_stop_age_s)
        self._doubts = Doubts(settings.modes)
        self._bounds = Bounds(settings.modes, validation, vehicle.standstill_mps, 1 / enlargement)
        self._mode = ModeState.initial()
        self._speed = SpeedFactor(settings.cruise_speed_mps)
        self._hand_over = HandOver(settings.follow.hand_over_s)
        self._stop = self._mode.stop  # the stop of the mode, or a brake without a change of the mode
        self._driver = self._has_driven = False  # a driver acted at the last step; the car has driven

    def adopt(self, rules: FearRules) -> None:
        """Use ``rules`` from the next step on; mode, timers and memory stay.

        Raises InputError, and keeps the old rules, when ``rules`` name an unknown input, do not rate a name in the
        settings, or do not give a cause in the settings: the stop for it would never come.
        """
        self._settings.refuse(rules, self._source)
        self._rules = rules

    @property
    def late_at_s(self) -> float:
        """When the next decision is due at the latest, because a message is late from then on; inf: never."""
        return self._lateness.next_s

    def step(
        self,
        estimates: Mapping[str, SteeringEstimate | None],
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
        malformed: Collection[str] = (),
        losses: Losses | None = None,
        lead_sent_s: float = math.nan,
        road_users: RoadUsers | None = None,
    ) -> Decision:
        """The decision at ``now_s``. ``estimates`` holds the latest message of every expected estimator, or None.

        The step computes the age of every message. ``lead`` is None where no detector runs; "no vehicle ahead" has
        confidence 0. ``road_users`` is None where nothing looks for people, to whom the car is then blind.
        ``malformed`` names the estimators, and "statistics", "lead", "road_users", "state", whose newest message
        could not be decoded, or is of a clock that stepped back: the input is broken. ``losses``: the newest report
        of the launcher. ``lead_sent_s``: publication of ``lead``, which the detector sends after the decision about
        its frame; NaN: with this step.
        """
        enlarged = self._reference.enlarge
        estimates = {name: enlarged(f"estimate {name}", estimate) for name, estimate in estimates.items()}
        statistics, road_users = enlarged("statistics", statistics), enlarged("road_users", road_users)
        lead, state = enlarged("lead", lead), enlarged("state", state)
        rules, driver = self._rules, state is not None and state.driver_override
        world = self._observer.step(
            *(rules, estimates, statistics, lead, state),
            now_s=now_s,
            malformed=malformed,
            road_users=road_users,
        )
        rated = rules.evaluate(world.features)
        finding = analyse(world.features, self._settings.analyser, ages_s=world.ages_s, doubted=world.doubted)
        cause = CALM if rated.cause == CALM else traced_cause(rated.cause, finding, world.sight.cause)
        fault = self._watchdog.step(
            world.ages_s,
            statistics_s=world.statistics_age_s,
            lead_s=world.ahead.age_s if lead else None,
            road_users_s=world.road_users.age_s if road_users else None,
            state_s=world.state_age_s,
            state=state,
            now_s=now_s,
            process_lost=losses is not None and bool(losses.stop),
        )
        senders = {**estimates, STATISTICS: statistics, LEAD: lead}
        ages_s = {**world.ages_s, STATISTICS: world.statistics_age_s, LEAD: world.ahead.age_s}
        possible = {n: m.t_s for n, m in senders.items() if m and math.isfinite(ages_s[n])}
        late = self._lateness.step(possible, now_s=now_s, came_s={LEAD: lead_sent_s})
        modes, begins = self._settings.modes, self._mode.mode is Mode.STOP
        view = StartSituation(world, rules, self._bounds, self._mode, rated.fear, cause, losses)
        now = moment(
            world,
            rules,
            modes,
            standstill_mps=self._bounds.standstill_mps,
            fear=rated.fear,
            cause=cause,
            part=finding.part if finding.cause == cause == Cause.DOUBTED_STATE else "",
            fault=fault,
            late=bool(late) or is_image_late(world.features, self._settings.analyser),
            drivable=obstacle(view) is None,
            driver=driver,
            driven=self._driver,
        )
        situation = self._doubts.step(now, rules.file.hysteresis, now_s=now_s)
        self._mode = next_state(self._mode, situation, final_causes=modes.final_causes)
        for_people = world.way.hard and not driver
        self._stop = Stop.EMERGENCY if for_people else brake_of(situation.effects, self._mode)
        if Effect.BRAKE_HARD in situation.effects:
            cause = world.sight.cause if world.sight_too_short else Cause.LEAD_CLOSE
        elif Effect.HOLD_BACK in situation.effects:
            cause = cause_of_lateness(late, estimates) if late else Cause.FROZEN_CAMERA
        self._driver = driver
        self._has_driven = self._has_driven or self._mode.mode is not Mode.STOP
        factor = self._speed.step(
            rules,
            rated.fear,
            world.motion,
            stopping=self._mode.mode is Mode.STOP,
            begins=begins,
            now_s=now_s,
        )
        wanted_mps = self._settings.cruise_speed_mps * factor
        if for_people or (cause == CALM and world.way.cap_mps < wanted_mps):
            cause = Cause.PERSON
        elif cause == CALM and world.sight.cap_mps < wanted_mps:
            cause = world.sight.cause or CALM
        by = self._speed.limited_by
        if losses is not None and losses.slow:
            by = Limit.PROCESS if factor > self._settings.lost_process_speed_factor else by
            factor = at_most(factor, self._settings.lost_process_speed_factor)
            cause = Cause.LOST_PROCESS if cause == CALM else cause
        follows = self._mode.mode is Mode.FOLLOW and rules.mode(rated.fear) is not Mode.STOP
        cap = Cap(0.0, Limit.STOP, factor)
        if self._stop is Stop.NONE:
            cap = least_cap(
                world, self._observer.follower, factor, by, self._settings.cruise_speed_mps, follows=follows
            )
        decision = self._decision(world, rated, self._mode.cause or cause, finding, cap, now_s)
        braked_for = "" if for_people or self._stop is self._mode.stop else str(cause)
        lead_mps, cap_mps = self._observer.follower.speed_cap_mps(world.ahead), decision.speed_cap_mps
        halt = Halt(self._mode, now, self._doubts.healthy_s, self._stop, braked_for, late, cap_mps, lead_mps)
        return self._reference.restore(replace(decision, waits_for=waits_for(view, halt)))

    def _path(self, world: WorldState, now_s: float) -> Path | None:
        """The path of the road, or the trail of the vehicle ahead where the road is lost, blended at a change.

        None before the first drive while estimates are unsure or lone: a driver may let go of the car too soon.
        """
        road, trail = world.fused.path, world.trail.path
        lone = len(world.fused.sources) < at_most(len(world.estimates), 2)
        if not self._has_driven and (lone or is_guess(world, self._settings.modes)):
            road = trail = None
        follows = trail is not None and (self._mode.mode is Mode.FOLLOW or road is None)
        return self._hand_over.step(trail if follows else road, world.last_motion, now_s=now_s)

    def _decision(
        self, world: WorldState, rated: FearResult, cause: str, finding: Finding, cap: Cap, now_s: float
    ) -> Decision:
        path, fused, names = self._path(world, now_s), world.fused, self._rules.names
        way = world.way if world.way.sets(cap.speed_mps) else CLEAR
        lane = path.lane if path else None
        lookahead_m = path.lookahead_m if path else self._settings.fusion.min_lookahead_m
        return Decision(
            t_s=max([e.t_s for e in world.estimates if math.isfinite(e.t_s)], default=None),
            decided_s=now_s,
            mode=self._mode.mode,
            stop=self._stop,
            fear=rated.fear,
            level=rated.level,
            cause=str(cause),
            part=finding.part if finding.cause == cause else self._mode.part,
            rules=rated.texts,
            rule_strengths=rated.strengths,
            inputs=names,
            input_values=tuple(map(world.features.get, names)),
            path_t_s=path.t_s if path else None,
            lateral_offset_m=lane.offset_m if lane else None,
            heading_error_rad=lane.heading_rad if lane else None,
            curvature_1pm=lane.curvature_at(lookahead_m) if lane else None,
            curvature_rate_1pm2=lane.curvature_rate_1pm2 if lane else None,
            lookahead_m=lookahead_m,
            path_source=path.source if path else "none",
            sources=fused.sources,
            trust=fused.trust,
            disagreement_mps2=fused.disagreement_mps2,
            speed_factor=cap.factor,
            speed_cap_mps=cap.speed_mps,
            limited_by=cap.limited_by,
            lane_unseen_s=fused.unseen_s if math.isfinite(fused.unseen_s) else None,
            lead_m=world.ahead.distance_m,
            road_user=way.kind,
            road_user_m=way.ahead_m,
            **self._line_warning.step(world, now_s=now_s)._asdict(),
            sight_m=world.sight.sight_m,
            sight_cause=world.sight.cause,
            sight_cap_mps=world.sight.cap_mps if math.isfinite(world.sight.cap_mps) else None,
        )


def build(
    *,
    rules: pathlib.Path | None = None,
    settings: pathlib.Path = CONFIG_DIR / "supervisor.yaml",
    vehicle: pathlib.Path = CONFIG_DIR / "vehicle.yaml",
    cruise_speed_mps: float | None = None,
) -> Supervisor:
    """A supervisor from its files; ``cruise_speed_mps`` instead of that of the settings. Raises InputError.

    Without ``rules`` those of the car, else ``config/fear.yaml``. Rules and settings hold in the reference world
    (:mod:`trepid.scale`), and the values of the inputs in a decision are those of that world, at every scale.
    """
    rules = rules or default_file("fear.yaml")
    loaded, verified = load(settings, SupervisorSettings), load_verified(rules)
    for name, hint in unknown_features(verified.names):
        raise InputError(fault_line(("inputs", name), f"unknown input; {hint}", read(rules), rules))
    for name, fault in wrong_ranges(verified.file.inputs):
        raise InputError(fault_line(("inputs", name, "range"), fault, read(rules), rules))
    _warn_of_near_misses(settings, read_text(settings), verified)
    car = load(vehicle, Vehicle)
    if cruise_speed_mps is not None:
        loaded = loaded.model_copy(update={"cruise_speed_mps": cruise_speed_mps / car.scale})
    return Supervisor(verified, loaded, car, source=settings)


@lru_cache(maxsize=16)  # one warning a file
def _warn_of_near_misses(settings: pathlib.Path, _: str, rules: FearRules) -> None:
    """Report keys of ``rated_as`` and ``fusion.trust`` that are nearly the name of a known estimator or kind."""
    loaded = load(settings, SupervisorSettings)
    keys = [("rated_as", name) for name in loaded.rated_as]
    for path in [*keys, *(("fusion", "trust", name) for name in loaded.fusion.trust)]:
        hint = near_miss(rules, path[-1])
        if hint:
            warning = f"warning: no rule rates an estimator {path[-1]!r}; {hint}"
            warn("trepid:", fault_line(path, warning, read(settings), settings))
