"""The doubts that stop the car and the assurances that let it drive: one row each, with its time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from supervisor.inputs.timers import HoldTimer, Patience, Stopwatch
from supervisor.inputs.watchdog import Fault
from supervisor.modes.modes import Effect, ModeSettings, Situation
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import Hysteresis
from supervisor.situation.world_state import WorldState
from trepid.bounds import at_most
from trepid.causes import Cause
from trepid.messages import Mode


class Conditions(NamedTuple):
    """The conditions of one step, without memory."""

    fault: Fault
    cause: str  # of fear
    part: str  # the measurements in doubt, where these are the cause; "" elsewhere
    wanted: Mode  # by the level of fear
    calmer: Mode  # by the level of fear plus the hysteresis band
    path: bool  # of the road
    trail: bool  # of a vehicle ahead, at least to stop on
    lead: bool  # a vehicle ahead can be followed
    near: bool  # the vehicle ahead is too near for a comfort stop
    too_fast: bool  # speed tracking cannot stop before the vehicle ahead, or within the sight
    late: bool  # a message or a new image is late
    standstill: bool
    moving: bool  # by the last valid state
    frameless: bool  # no frame for the time of an emergency stop
    guess: bool  # every estimator is more likely wrong than right
    road: bool  # an estimator measures the road with confidence
    drivable: bool  # no obstacle of :mod:`supervisor.modes.waits` keeps a standing car from driving
    driver: bool  # a driver acts now ...
    driven: bool  # ... or did so at the last step

    @property
    def afraid(self) -> bool:
        """Whether the level of fear requires CAUTION or more."""
        return self.wanted is not Mode.KEEP

    @property
    def doubt(self) -> str:
        """The cause that slows the car where no vehicle can be followed instead; "" for none."""
        return self.cause if self.afraid and not self.lead else ""


def moment(
    world: WorldState,
    rules: FearRules,
    modes: ModeSettings,
    *,
    standstill_mps: float,
    fear: float,
    cause: str,
    part: str,
    fault: Fault,
    late: bool,
    drivable: bool,
    driver: bool,
    driven: bool,
) -> Conditions:
    """The conditions of the doubts, from the world, fear and its cause, late inputs, and obstacles."""
    wanted = rules.mode(fear)
    motion, last = world.motion, world.last_motion
    frameless = fault.cause == Cause.STALE_DATA and min(world.ages_s.values()) > modes.emergency_stop_age_s
    return Conditions(
        fault=fault,
        cause=cause,
        part=part,
        wanted=wanted,
        calmer=rules.mode(at_most(fear + rules.file.hysteresis.band, 1.0)),
        path=world.fused.path is not None,
        trail=world.trail.path is not None,
        lead=world.trail.usable,
        near=world.near,
        too_fast=world.sight_too_short or world.closes_in,
        late=late,
        standstill=motion is not None and abs(motion.speed_mps) < standstill_mps,
        moving=last is not None and abs(last.speed_mps) >= standstill_mps,
        frameless=frameless,
        guess=is_guess(world, modes),
        road=world.surest >= modes.road_back_confidence,
        drivable=drivable,
        driver=driver,
        driven=driven,
    )


def is_guess(world: WorldState, modes: ModeSettings) -> bool:
    """Whether every estimator is more likely wrong than right."""
    return (world.features["lane_confidence"] or 0.0) < modes.guess_confidence


Condition = Callable[[Conditions], bool]
Time = Callable[[ModeSettings, Hysteresis], float | None]


def _never(_: Conditions) -> bool:
    return False


def _now(_: ModeSettings, __: Hysteresis) -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class Doubt:
    """One row: a condition, the time that it must last, its effect, and the condition that clears it."""

    name: str  # a cause, or the condition in words
    holds: Condition
    after_s: Time  # None: never
    effect: Effect
    cleared: str
    pauses: Condition = _never  # holds the time constant
    timer: type[HoldTimer] | type[Patience] = HoldTimer


def _is_unguided(m: Conditions) -> bool:
    """The highest level of fear, no trail to follow, and no estimator more likely right than wrong."""
    return m.moving and m.wanted is Mode.STOP and not m.lead and not m.driver and m.guess


def _ready(m: Conditions) -> bool:
    return m.drivable and m.standstill and not m.fault.cause


def _is_handed_over(m: Conditions) -> bool:
    return m.drivable and m.fault.cause in ("", Cause.DRIVER_OVERRIDE) and (m.driver or m.driven)


DOUBTS = (
    Doubt(
        "fear is at its highest level",
        lambda m: m.wanted is Mode.STOP,
        lambda _, h: h.stop_after_s,
        Effect.STOP,
        "by the first step of less fear",
    ),
    Doubt(
        "neither path nor trail on the move",
        lambda m: m.moving and not m.path and not m.trail,
        lambda s, _: s.blind_s,
        Effect.EMERGENCY,
        "by a path",
    ),
    Doubt(
        "fear is at its highest level on the move and no estimator is rather right than wrong",
        _is_unguided,
        lambda s, _: s.guess_s,
        Effect.EMERGENCY,
        "by confidence, less fear, a vehicle to follow",
    ),
    Doubt(
        "no frame for `emergency_stop_age_s` on the move",
        lambda m: m.moving and m.frameless,
        _now,
        Effect.EMERGENCY,
        "by a frame",
    ),
    Doubt(
        "a message or a new image is late on the move",
        lambda m: m.moving and m.late,
        _now,
        Effect.HOLD_BACK,
        "by three messages in time, by a new image",
    ),
    Doubt(
        "too fast to stop by speed tracking before a vehicle, or within the sight",
        lambda m: m.moving and m.too_fast,
        lambda s, _: s.brake_hard_s,
        Effect.BRAKE_HARD,
        "by speed, distance, sight",
    ),
    Doubt(
        "a vehicle or a road user too near for a comfort stop",
        lambda m: m.near and not m.driver,
        lambda s, _: s.near_s,
        Effect.BRAKE_HARDER,
        "by distance",
    ),
    Doubt("calm", lambda m: m.calmer is Mode.KEEP, lambda _, h: h.calm_after_s, Effect.CALM, "by fear"),
    Doubt(
        "the road is measured with confidence",
        lambda m: m.road,
        lambda s, _: s.road_back_s,
        Effect.ROAD_BACK,
        "by low confidence",
    ),
    Doubt(
        "healthy at standstill",
        _ready,
        lambda s, _: s.reengage_after_s,
        Effect.START,
        "by fear, a doubt, a fault, motion",
    ),
    Doubt(
        "healthy under a driver",
        _is_handed_over,
        lambda s, _: s.reengage_after_s,
        Effect.HAND_OVER,
        "by fear, a doubt, a fault",
    ),
)
"""The rows that every supervisor has; :func:`doubts_of` adds those of the causes in the settings."""
DRIVERS = frozenset({Effect.EMERGENCY, Effect.HAND_OVER, Effect.HOLD_BACK, Effect.BRAKE_HARD})
"""Effects that do not come while a driver acts."""


def doubts_of(modes: ModeSettings) -> tuple[Doubt, ...]:
    """DOUBTS, and a row for every cause under ``stop_after_s`` and ``emergency_after_s``.

    The time is held while another cause of the same section is active, because these doubts concern the same road.
    The time before an emergency stop does not run while a driver drives: the driver is responsible for the road.
    """
    return (
        *DOUBTS,
        *(_of_cause(cause, modes.stop_after_s, Effect.STOP_ON_ROAD) for cause in modes.stop_after_s),
        *(
            _of_cause(cause, modes.emergency_after_s, Effect.EMERGENCY, on_the_move=True)
            for cause in modes.emergency_after_s
        ),
    )


def _of_cause(cause: str, limits_s: dict[str, float], effect: Effect, *, on_the_move: bool = False) -> Doubt:
    """The row of a ``cause`` that may slow the car for ``limits_s[cause]`` before its ``effect``."""

    def counts(m: Conditions) -> bool:
        return not on_the_move or (m.moving and not m.driver)

    return Doubt(
        cause,
        lambda m: m.doubt == cause and counts(m),
        lambda _, __: limits_s[cause],
        effect,
        "as slowly as it came, by another cause",
        pauses=lambda m: m.doubt in limits_s and counts(m),
        timer=Patience,
    )


class Doubts:
    """The table with a timer for every row."""

    def __init__(self, modes: ModeSettings) -> None:
        self._modes = modes
        self._timers = [(doubt, doubt.timer()) for doubt in doubts_of(modes)]
        self._healthy = Stopwatch()
        self.healthy_s = 0.0
        """For how long the car has been healthy at standstill, or on the move under a driver, at the last step."""

    def step(self, m: Conditions, hysteresis: Hysteresis, *, now_s: float) -> Situation:
        """The situation at ``now_s``: the moment, and the effects of the rows that have lasted for their time."""
        healthy = _ready(m) if m.standstill else _is_handed_over(m)
        self.healthy_s = self._healthy.step(healthy, now_s=now_s)
        effects = frozenset(
            [
                doubt.effect
                for doubt, timer in self._timers
                if timer.lasts(
                    doubt.holds(m), doubt.after_s(self._modes, hysteresis), now_s=now_s, pause=doubt.pauses(m)
                )
            ]
        )
        return Situation(
            fault=m.fault.cause,
            lost=m.fault.lost,
            cause=m.cause,
            afraid=m.afraid,
            path=m.path,
            lead=m.lead,
            standstill=m.standstill,
            effects=effects - DRIVERS if m.driver else effects,
            part=m.fault.part if m.fault.cause else m.part,
        )
