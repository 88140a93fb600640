"""The step of the supervisor: messages in, decision out."""

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from supervisor import fusion
from supervisor.features import ESTIMATOR_SUFFIX, FEATURES, Features, features
from supervisor.follow import Follower, FollowSettings, Lead, judge_lead
from supervisor.fusion import Fused, Fusion, FusionSettings
from supervisor.inference import FearResult, FearRules
from supervisor.lane import Motion
from supervisor.modes import Held, ModeSettings, ModeState, Situation, next_state
from supervisor.sightings import Sighting, SightingSettings, age_s, is_frozen, motion_of, sight
from supervisor.verify import load_verified
from supervisor.watchdog import DRIVER, Fault, Watchdog
from trepid.bounds import at_least, at_most
from trepid.config import CONFIG_DIR, InputError, Settings, load
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
    fusion: FusionSettings
    modes: ModeSettings
    follow: FollowSettings


class Supervisor:
    """Rates the risk of every frame, fuses the estimates, and decides how fast to drive which path.

    Begins in STOP, also when it is restarted on the move, and leaves it only with healthy inputs: from standstill,
    or when a driver lets go who has driven so far. Its state is what earlier steps gave it: the remembered path,
    the lead's trail, the mode and its timers.
    """

    def __init__(self, rules: FearRules, settings: SupervisorSettings, vehicle: Vehicle) -> None:
        """Raises InputError when ``rules`` speak of an input that does not exist."""
        self._rules, self._settings = rules, settings
        self._opinions = _opinions(rules)
        self._fusion = Fusion(settings.fusion)
        self._follower = Follower(settings.follow, vehicle)
        self._mode = ModeState.initial()
        self._watchdog = Watchdog(
            fresh_s=settings.sightings.fresh_s,
            lost_s=settings.sightings.lost_s,
            frames_s=settings.modes.comfort_stop_age_s,
            state_s=settings.sightings.state_fresh_s,
        )
        self._terrified, self._calm, self._ready, self._drivable = Held(), Held(), Held(), Held()
        self._driver = False  # a driver acted at the last step
        self._road_back, self._pathless = Held(), Held()
        self._factor = 0.0
        self._decided_s: float | None = None
        self._last_motion: Motion | None = None

    def adopt(self, rules: FearRules) -> None:
        """Go on with other rules from the next step on; mode, timers and memory stay.

        Raises InputError when ``rules`` speak of an input that does not exist; the rules stay as they were then.
        """
        self._opinions = _opinions(rules)
        self._rules = rules

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
        limits = self._settings.sightings
        motion = motion_of(state, now_s=now_s, settings=limits)
        self._last_motion = motion or self._last_motion  # a lost vehicle is taken to go on as it went
        ahead = judge_lead(lead, motion, now_s=now_s, settings=limits)
        statistics_age_s = age_s(statistics.t_s if statistics else None, now_s=now_s, settings=limits)
        fresh_statistics = statistics if statistics_age_s <= limits.fresh_s else None
        frozen = is_frozen(fresh_statistics, self._last_motion, settings=limits)
        seen = [sight(name, e, now_s=now_s, settings=limits, frozen=frozen) for name, e in estimates.items()]
        state_age_s = age_s(state.t_s if state else None, now_s=now_s, settings=limits)
        fused = self._fusion.step(seen, self._last_motion, now_s=now_s)
        trail = self._follower.step(ahead, self._last_motion, now_s=now_s)
        asked = features(
            seen,
            fused,
            fresh_statistics,
            ahead,
            motion,
            state_age_s=state_age_s,
            expected=self._opinions,
        )
        felt = self._rules.evaluate(asked)
        fault = self._watchdog.step(
            {s.estimator: s.age_s for s in seen},
            statistics_s=statistics_age_s,
            lead_s=ahead.age_s if lead else None,
            state_s=state_age_s,
            driver_override=state is not None and state.driver_override,
        )
        driver = state is not None and state.driver_override
        situation = self._situation(felt, fault, seen, fused, trail, motion, now_s, driver=driver)
        stopped = self._mode.mode is Mode.STOP
        self._mode = next_state(self._mode, situation, final_causes=self._settings.modes.final_causes)
        path = trail if self._follows(fused, trail) else fused.path
        self._factor = self._speed_factor(felt.fear, motion, now_s, begins=stopped)
        self._decided_s, self._driver = now_s, driver
        return self._decision(seen, asked, felt, fused, path, ahead, now_s)

    def _situation(
        self,
        felt: FearResult,
        fault: Fault,
        seen: list[Sighting],
        fused: Fused,
        trail: fusion.Path | None,
        motion: Motion | None,
        now_s: float,
        *,
        driver: bool,
    ) -> Situation:
        modes, hysteresis = self._settings.modes, self._rules.file.hysteresis
        wanted = self._rules.mode(felt.fear)
        still_wanted = self._rules.mode(at_most(felt.fear + hysteresis.band, 1.0))
        standstill = motion is not None and abs(motion.speed_mps) < modes.standstill_mps
        surest = max([s.confidence or 0.0 for s in seen if s.lane], default=0.0)
        drivable = _drivable(seen, fused) and felt.fear <= modes.reengage_max_fear
        ready = drivable and standstill and not fault.cause
        drivable = drivable and fault.cause in ("", DRIVER)
        return Situation(
            fault=fault.cause,
            lost=fault.lost,
            blind=self._is_blind(fault, seen, pathless=fused.path is None and trail is None, now_s=now_s)
            and not driver,
            terrified=self._terrified.lasts(wanted is Mode.STOP, hysteresis.stop_after_s, now_s=now_s),
            afraid=wanted is not Mode.KEEP,
            calm=self._calm.lasts(still_wanted is Mode.KEEP, hysteresis.calm_after_s, now_s=now_s),
            cause=felt.cause,
            path=fused.path is not None,
            road_back=self._road_back.lasts(
                surest >= modes.road_back_confidence, modes.road_back_s, now_s=now_s
            ),
            lead=trail is not None,
            standstill=standstill,
            ready=self._ready.lasts(ready, modes.reengage_after_s, now_s=now_s),
            handed_over=self._drivable.lasts(
                drivable and (driver or self._driver), modes.reengage_after_s, now_s=now_s
            )
            and not driver,
        )

    def _is_blind(self, fault: Fault, seen: list[Sighting], *, pathless: bool, now_s: float) -> bool:
        """Whether the car moves, as far as is known, and has not been shown where to for too long."""
        modes, last = self._settings.modes, self._last_motion
        moving = last is not None and abs(last.speed_mps) >= modes.standstill_mps
        lasting = self._pathless.lasts(moving and pathless, modes.blind_s, now_s=now_s)
        frameless = fault.cause == "stale_data" and min(s.age_s for s in seen) > modes.emergency_stop_age_s
        return lasting or (moving and frameless)

    def _follows(self, fused: Fused, trail: fusion.Path | None) -> bool:
        return trail is not None and (self._mode.mode is Mode.FOLLOW or fused.path is None)

    def _speed_factor(self, fear: float, motion: Motion | None, now_s: float, *, begins: bool) -> float:
        """Falls with fear at once and rises slowly, but fast to the speed that the car still has; 0 in STOP.

        Where the drive begins it begins at the speed that the car has: that of the driver, or standstill.
        """
        if self._mode.mode is Mode.STOP:
            return 0.0
        hysteresis = self._rules.file.hysteresis
        dt_s = 0.0 if self._decided_s is None else at_least(now_s - self._decided_s, 0.0)
        driven = 0.0 if motion is None else motion.speed_mps / self._settings.cruise_speed_mps
        caught_up = driven if begins else at_most(self._factor + hysteresis.catch_up_per_s * dt_s, driven)
        risen = at_least(self._factor + hysteresis.recovery_per_s * dt_s, caught_up)
        return at_most(risen, self._rules.speed_factor(fear))

    def _decision(
        self,
        seen: list[Sighting],
        asked: Features,
        felt: FearResult,
        fused: Fused,
        path: fusion.Path | None,
        lead: Lead,
        now_s: float,
    ) -> Decision:
        cap_mps = at_most(self._follower.speed_cap_mps(lead), self._settings.cruise_speed_mps * self._factor)
        lane = path.lane if path else None
        lookahead_m = path.lookahead_m if path else self._settings.fusion.min_lookahead_m
        return Decision(
            t_s=max([s.t_s for s in seen if math.isfinite(s.t_s)], default=None),
            decided_s=now_s,
            mode=self._mode.mode,
            stop=self._mode.stop,
            fear=felt.fear,
            level=felt.level,
            cause=self._mode.cause or felt.cause,
            rules=felt.texts,
            rule_strengths=felt.strengths,
            inputs=self._rules.names,
            input_values=tuple(map(asked.get, self._rules.names)),
            path_t_s=path.t_s if path else None,
            lateral_offset_m=lane.offset_m if lane else None,
            heading_error_rad=lane.heading_rad if lane else None,
            curvature_1pm=lane.curvature_1pm + lane.curvature_rate_1pm2 * lookahead_m if lane else None,
            curvature_rate_1pm2=lane.curvature_rate_1pm2 if lane else None,
            lookahead_m=lookahead_m,
            path_source=path.source if path else "none",
            sources=fused.sources,
            trust=fused.trust,
            disagreement_mps2=fused.disagreement_mps2,
            speed_factor=self._factor,
            speed_cap_mps=cap_mps if self._mode.stop is Stop.NONE else 0.0,
        )


def _opinions(rules: FearRules) -> list[str]:
    """Inputs of the rules that are confidences of single estimators. Raises InputError for unknown inputs."""
    others = [name for name in rules.names if name not in FEATURES]
    for name in others:
        if not name.endswith(ESTIMATOR_SUFFIX):
            close = difflib.get_close_matches(name, FEATURES, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(sorted(FEATURES))}"
            raise InputError(f"the fear rules speak of {name!r}, which nothing measures; {hint}")
    return others


def _drivable(seen: list[Sighting], fused: Fused) -> bool:
    """Every expected estimator has answered of late, if only that it sees no lane, and one sees one."""
    return bool(seen) and None not in [s.confidence for s in seen] and bool(fused.sources)


def build(
    *,
    rules: Path = CONFIG_DIR / "fear.yaml",
    settings: Path = CONFIG_DIR / "supervisor.yaml",
    vehicle: Path = CONFIG_DIR / "vehicle.yaml",
    cruise_speed_mps: float | None = None,
) -> Supervisor:
    """A supervisor from its files; ``cruise_speed_mps`` instead of that of the settings. Raises InputError."""
    loaded = load(settings, SupervisorSettings)
    if cruise_speed_mps is not None:
        loaded = loaded.model_copy(update={"cruise_speed_mps": cruise_speed_mps})
    return Supervisor(load_verified(rules), loaded, load(vehicle, Vehicle))
