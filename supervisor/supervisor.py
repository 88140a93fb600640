"""The step of the supervisor: messages in, decision out."""

import difflib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from supervisor.inputs.timers import Held, Patience
from supervisor.inputs.validated import SightingSettings
from supervisor.inputs.watchdog import Fault, Watchdog
from supervisor.modes.analyser import AnalyserSettings, Finding, analyse, explained
from supervisor.modes.modes import ModeSettings, ModeState, Situation, next_state
from supervisor.modes.speed import SpeedFactor
from supervisor.path import fusion
from supervisor.path.follow import FollowSettings
from supervisor.path.fusion import FusionSettings
from supervisor.path.hand_over import HandOver
from supervisor.rules.inference import CALM, FearResult, FearRules
from supervisor.rules.verify import load_verified
from supervisor.situation.features import FEATURES
from supervisor.situation.world_state import Observer, Outlook, unknown_features
from trepid.bounds import at_least, at_most
from trepid.causes import Cause, unknown_cause
from trepid.config import CONFIG_DIR, InputError, Settings, load, located, read
from trepid.messages import (
    Decision,
    ImageStatistics,
    LeadVehicle,
    Mode,
    SteeringEstimate,
    Stop,
    VehicleState,
)
from trepid.vehicle import Vehicle


class SupervisorSettings(Settings):
    """The contents of ``config/supervisor.yaml``."""

    cruise_speed_mps: Annotated[float, Field(gt=0)]
    sightings: SightingSettings
    analyser: AnalyserSettings
    fusion: FusionSettings
    modes: ModeSettings
    follow: FollowSettings

    @property
    def named_causes(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Every cause that the settings name, with the path of its field."""
        yield from ((("modes", *path), cause) for path, cause in self.modes.causes)


class Supervisor:
    """Rates the risk of every frame, fuses the estimates, and decides how fast to drive which path.

    Begins in STOP, also when it is restarted on the move, and leaves it only with healthy inputs: from standstill,
    or when a driver lets go who has driven so far. Its state is what earlier steps gave it: the remembered path,
    the lead's trail, the mode and its timers.
    """

    def __init__(self, rules: FearRules, settings: SupervisorSettings, vehicle: Vehicle) -> None:
        """Raises InputError when ``rules`` speak of an input that does not exist."""
        self._rules, self._settings = rules, settings
        _refuse_unknown(rules)
        for path, problem in unknown_causes(settings, rules):
            raise InputError(f"{'.'.join(map(str, path))}: {problem}")
        self._observer = Observer(rules, settings.sightings, settings.fusion, settings.follow, vehicle)
        self._mode = ModeState.initial()
        self._watchdog = Watchdog(
            fresh_s=settings.sightings.fresh_s,
            lost_s=settings.sightings.lost_s,
            frames_s=settings.modes.comfort_stop_age_s,
            state_s=settings.sightings.state_fresh_s,
        )
        self._terrified, self._calm, self._ready, self._drivable = Held(), Held(), Held(), Held()
        self._road_back, self._pathless, self._lost, self._near = Held(), Held(), Held(), Held()
        self._patience = Patience(settings.modes.stop_after_s)
        self._last_patience = Patience(settings.modes.emergency_after_s)
        self._speed = SpeedFactor(rules, settings.cruise_speed_mps)
        self._hand_over = HandOver(settings.follow.hand_over_s)
        self._driver = False  # a driver acted at the last step
        self._has_driven = False

    def adopt(self, rules: FearRules) -> None:
        """Use other rules from the next step on; mode, timers and memory stay.

        Raises InputError, and keeps the old rules, when ``rules`` name an unknown input, or when they no longer
        give a cause that the settings name: the stop for it would never come.
        """
        _refuse_unknown(rules)
        for path, cause in self._settings.named_causes:
            if cause in self._rules.causes and cause not in rules.causes:
                where = ".".join(map(str, path))
                raise InputError(
                    f"no rule gives the cause {cause!r} any more, which the settings name in {where}"
                )
        self._rules = rules
        self._observer.adopt(rules)
        self._speed.adopt(rules)

    def step(
        self,
        estimates: Mapping[str, SteeringEstimate | None],
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
    ) -> Decision:
        """The decision at ``now_s``. ``estimates`` holds the latest message of every expected estimator, or None.

        Ages are judged here. ``lead`` is None where no detector runs; "no vehicle ahead" has confidence 0.
        """
        outlook = self._observer.step(estimates, statistics, lead, state, now_s=now_s)
        driver = state is not None and state.driver_override
        felt = self._rules.evaluate(outlook.asked)
        finding = analyse(outlook.asked, self._settings.analyser, ages_s=outlook.ages_s)
        cause = CALM if felt.cause == CALM else explained(felt.cause, finding)
        fault = self._watchdog.step(
            outlook.ages_s,
            statistics_s=outlook.statistics_age_s,
            lead_s=outlook.ahead.age_s if lead else None,
            state_s=outlook.state_age_s,
            driver_override=driver,
        )
        stopped = self._mode.mode is Mode.STOP
        situation = self._situation(felt.fear, cause, fault, outlook, now_s, driver=driver)
        self._mode = next_state(self._mode, situation, final_causes=self._settings.modes.final_causes)
        self._driver = driver
        self._has_driven = self._has_driven or self._mode.mode is not Mode.STOP
        factor = self._speed.step(
            felt.fear,
            outlook.motion,
            stopping=self._mode.mode is Mode.STOP,
            begins=stopped,
            now_s=now_s,
        )
        return self._decision(outlook, felt, self._mode.cause or cause, finding, factor, now_s)

    def _situation(
        self, fear: float, cause: str, fault: Fault, outlook: Outlook, now_s: float, *, driver: bool
    ) -> Situation:
        modes, hysteresis = self._settings.modes, self._rules.file.hysteresis
        motion, path, trail = outlook.motion, outlook.fused.path, outlook.trail
        wanted = self._rules.mode(fear)
        still_wanted = self._rules.mode(at_most(fear + hysteresis.band, 1.0))
        afraid = wanted is not Mode.KEEP
        borne = cause if afraid and not trail.usable else ""  # behind a leader there is a way without a road
        standstill = motion is not None and abs(motion.speed_mps) < modes.standstill_mps
        surest = max([s.confidence or 0.0 for s in outlook.seen if s.lane], default=0.0)
        # Who would be stopped again does not start; who was stopped for such a doubt starts when it is gone.
        doubted = not {cause, self._mode.cause}.isdisjoint(modes.stop_after_s)
        startable = not (afraid and doubted)
        drivable = outlook.drivable and fear <= modes.reengage_max_fear and startable
        ready = drivable and standstill and not fault.cause
        drivable = drivable and fault.cause in ("", Cause.DRIVER_OVERRIDE)
        return Situation(
            fault=fault.cause,
            lost=fault.lost,
            blind=self._is_blind(
                fault,
                outlook,
                pathless=path is None and trail.path is None,
                cause=borne,
                terrified=wanted is Mode.STOP and not trail.usable and not driver,
                now_s=now_s,
            )
            and not driver,
            near=self._near.lasts(outlook.near and not driver, modes.near_s, now_s=now_s),
            terrified=self._terrified.lasts(wanted is Mode.STOP, hysteresis.stop_after_s, now_s=now_s),
            lasting=self._patience.ends(borne, now_s=now_s),
            afraid=afraid,
            calm=self._calm.lasts(still_wanted is Mode.KEEP, hysteresis.calm_after_s, now_s=now_s),
            cause=cause,
            path=path is not None,
            road_back=self._road_back.lasts(
                surest >= modes.road_back_confidence, modes.road_back_s, now_s=now_s
            ),
            lead=trail.usable,
            standstill=standstill,
            ready=self._ready.lasts(ready, modes.reengage_after_s, now_s=now_s),
            handed_over=self._drivable.lasts(
                drivable and (driver or self._driver), modes.reengage_after_s, now_s=now_s
            )
            and not driver,
        )

    def _is_blind(
        self, fault: Fault, outlook: Outlook, *, pathless: bool, cause: str, terrified: bool, now_s: float
    ) -> bool:
        """Whether the car moves, as far as is known, and for too long nobody who is sure has shown where to."""
        modes, last = self._settings.modes, outlook.last_motion
        moving = last is not None and abs(last.speed_mps) >= modes.standstill_mps
        lasting = self._pathless.lasts(moving and pathless, modes.blind_s, now_s=now_s)
        frameless = (
            fault.cause == Cause.STALE_DATA and min(outlook.ages_s.values()) > modes.emergency_stop_age_s
        )
        guessing = self._last_patience.ends(cause if moving else "", now_s=now_s)
        terrified = terrified and self._is_unbelieved(outlook)
        lost = self._lost.lasts(moving and terrified, modes.guess_s, now_s=now_s)
        return lasting or guessing or lost or (moving and frameless)

    def _is_unbelieved(self, outlook: Outlook) -> bool:
        """Whether every estimator is rather wrong than right."""
        return (outlook.asked["lane_confidence"] or 0.0) < self._settings.modes.guess_confidence

    def _path(self, outlook: Outlook, now_s: float) -> fusion.Path | None:
        """The road's, or where it is lost the leader's; led over from one to the other.

        None before the first drive where nobody is sure of it, or only one of several: where a driver lets go of a
        moving car too soon, such a view does not turn the wheels.
        """
        road, trail = outlook.fused.path, outlook.trail.path
        lone = len(outlook.fused.sources) < at_most(len(outlook.seen), 2)
        if not self._has_driven and (lone or self._is_unbelieved(outlook)):
            road = trail = None
        follows = trail is not None and (self._mode.mode is Mode.FOLLOW or road is None)
        return self._hand_over.step(trail if follows else road, outlook.last_motion, now_s=now_s)

    def _decision(
        self, outlook: Outlook, felt: FearResult, cause: str, finding: Finding, factor: float, now_s: float
    ) -> Decision:
        cruise_mps = self._settings.cruise_speed_mps * factor
        if self._mode.mode is Mode.FOLLOW and self._rules.mode(felt.fear) is not Mode.STOP:
            pace_mps = at_most(self._observer.pace_mps(outlook.ahead), self._settings.cruise_speed_mps)
            cruise_mps = at_least(cruise_mps, pace_mps)
        cap_mps = at_most(self._observer.speed_cap_mps(outlook.ahead), cruise_mps)
        path, fused = self._path(outlook, now_s), outlook.fused
        lane = path.lane if path else None
        lookahead_m = path.lookahead_m if path else self._settings.fusion.min_lookahead_m
        return Decision(
            t_s=max([s.t_s for s in outlook.seen if math.isfinite(s.t_s)], default=None),
            decided_s=now_s,
            mode=self._mode.mode,
            stop=self._mode.stop,
            fear=felt.fear,
            level=felt.level,
            cause=cause,
            part=finding.part if finding.cause == cause else "",
            rules=felt.texts,
            rule_strengths=felt.strengths,
            inputs=self._rules.names,
            input_values=tuple(map(outlook.asked.get, self._rules.names)),
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
            speed_factor=factor,
            speed_cap_mps=cap_mps if self._mode.stop is Stop.NONE else 0.0,
        )


def unknown_causes(
    settings: SupervisorSettings, rules: FearRules
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Path and error text of every cause in ``settings`` that neither Trepid nor ``rules`` know."""
    known = rules.file.known_causes
    for path, cause in settings.named_causes:
        problem = unknown_cause(cause, known)
        if problem:
            yield path, problem


def _refuse_unknown(rules: FearRules) -> None:
    """Raises InputError when ``rules`` speak of something that nothing measures."""
    for name in unknown_features(rules.names):
        close = difflib.get_close_matches(name, FEATURES, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(sorted(FEATURES))}"
        raise InputError(f"the fear rules speak of {name!r}, which nothing measures; {hint}")


def build(
    *,
    rules: Path = CONFIG_DIR / "fear.yaml",
    settings: Path = CONFIG_DIR / "supervisor.yaml",
    vehicle: Path = CONFIG_DIR / "vehicle.yaml",
    cruise_speed_mps: float | None = None,
) -> Supervisor:
    """A supervisor from its files; ``cruise_speed_mps`` instead of that of the settings. Raises InputError."""
    loaded, verified = load(settings, SupervisorSettings), load_verified(rules)
    for path, problem in unknown_causes(loaded, verified):
        raise InputError(located(path, problem, read(settings), settings, {}))
    if cruise_speed_mps is not None:
        loaded = loaded.model_copy(update={"cruise_speed_mps": cruise_speed_mps})
    return Supervisor(verified, loaded, load(vehicle, Vehicle))
