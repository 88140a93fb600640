"""Modes: the table of all transitions, and the latched stop."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from trepid.causes import Cause
from trepid.config import Settings
from trepid.messages import Mode, Stop
from trepid.types import NonNegative, Positive, PositiveShare

STARTING = Cause.STARTING
"""Cause of the stop in which every supervisor starts, also after a restart while the car moves."""


class ModeSettings(Settings):
    """Section ``modes`` of ``config/supervisor.yaml``."""

    moved_fields: ClassVar = {"standstill_mps": "standstill_mps of vehicle.yaml"}

    comfort_stop_age_s: Positive  # no frame for this long: comfort stop
    emergency_stop_age_s: Positive  # ... emergency stop
    blind_s: Positive  # moving without any path for this long: emergency stop
    near_s: NonNegative  # a vehicle ahead is too near for the comfort stop, for this long: emergency stop
    brake_hard_s: NonNegative  # speed tracking cannot stop in time, for this long: the brake of an emergency
    guess_s: Positive  # fear requires a stop, and no confidence is above guess_confidence: likewise
    guess_confidence: PositiveShare  # also the least confidence to steer before the first drive
    reengage_after_s: NonNegative | None  # at standstill, healthy for this long: drive again; null: never
    reengage_max_fear: Annotated[float, Field(ge=0, lt=1)]
    road_back_s: NonNegative  # FOLLOW ends when the road has been seen this long ...
    road_back_confidence: PositiveShare  # ... with this confidence
    final_causes: tuple[str, ...]  # a stop for one of these is final
    # cause -> greatest time with a fear of medium or more before a comfort stop
    stop_after_s: dict[str, Positive]
    emergency_after_s: dict[str, Positive]  # ... of a moving car before an emergency stop

    @property
    def causes(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Every cause that the section names, with the path of its field in the file."""
        for field in ("stop_after_s", "emergency_after_s"):
            yield from ((("modes", field, cause), cause) for cause in getattr(self, field))
        yield from ((("modes", "final_causes", i), cause) for i, cause in enumerate(self.final_causes))


class Effect(Enum):
    """The effect of a doubt or an assurance after its delay."""

    STOP = auto()  # a comfort stop, also while a vehicle is followed
    STOP_ON_ROAD = auto()  # a comfort stop in KEEP and CAUTION
    EMERGENCY = auto()  # a final emergency stop
    HOLD_BACK = auto()  # the comfort brake without a change of the mode, for as long as the doubt lasts
    BRAKE_HARD = auto()  # ... the brake of an emergency, likewise
    BRAKE_HARDER = auto()  # a comfort stop becomes an emergency stop
    CALM = auto()  # CAUTION ends
    ROAD_BACK = auto()  # FOLLOW ends
    START = auto()  # a stop ends at standstill
    HAND_OVER = auto()  # the stop in which a supervisor starts ends while the car moves


def brake_of(effects: Collection[Effect], mode: "ModeState") -> Stop:
    """The stop that the car makes now: the stronger one of its mode and of the effects without a mode."""
    if Effect.BRAKE_HARD in effects or mode.stop is Stop.EMERGENCY:
        return Stop.EMERGENCY
    return Stop.COMFORT if Effect.HOLD_BACK in effects else mode.stop


class Situation(NamedTuple):
    """The conditions of the transitions."""

    fault: str  # the cause of an immediate stop: a lost process, stale data, the driver; "" for none
    lost: bool  # a process is lost
    cause: str  # of fear
    afraid: bool  # the level of fear requires CAUTION or more
    path: bool  # there is a path of the road
    lead: bool  # there is a vehicle to follow
    standstill: bool
    effects: frozenset[Effect]  # of the doubts and assurances after their delays
    part: str = ""  # concerned by the fault: the lost estimators


class ModeState(NamedTuple):
    """The mode and the latched stop."""

    mode: Mode
    stop: Stop
    cause: str  # of the stop; "" without a stop
    final: bool  # this stop ends the run
    part: str = ""  # concerned by the cause: the lost estimators, the measurements in doubt

    @classmethod
    def initial(cls) -> "ModeState":
        """A comfort stop until standstill, before the first inputs."""
        return cls(Mode.STOP, Stop.COMFORT, STARTING, final=False)


@dataclass(frozen=True, slots=True)
class Transition:
    """One row: from any of ``sources`` to ``target`` when ``when`` holds."""

    sources: frozenset[Mode]
    when: Callable[[Situation], bool]
    target: Mode
    because: str


DRIVING = frozenset({Mode.KEEP, Mode.CAUTION, Mode.FOLLOW})
ON_ROAD = frozenset({Mode.KEEP, Mode.CAUTION})

TRANSITIONS = (
    Transition(
        DRIVING, lambda s: bool(s.fault), Mode.STOP, "a process is lost, data is stale, or the driver acts"
    ),
    Transition(DRIVING, lambda s: Effect.STOP in s.effects, Mode.STOP, "the level of fear requires it"),
    Transition(
        ON_ROAD,
        lambda s: Effect.STOP_ON_ROAD in s.effects,
        Mode.STOP,
        "one cause has been active for too long",
    ),
    Transition(DRIVING, lambda s: not s.path and not s.lead, Mode.STOP, "neither road nor lead"),
    Transition(ON_ROAD, lambda s: not s.path, Mode.FOLLOW, "the road is lost, a lead is there"),
    Transition(
        frozenset({Mode.FOLLOW}), lambda s: Effect.ROAD_BACK in s.effects, Mode.CAUTION, "the road is back"
    ),
    Transition(frozenset({Mode.KEEP}), lambda s: s.afraid, Mode.CAUTION, "the level of fear requires it"),
    Transition(
        frozenset({Mode.CAUTION}), lambda s: Effect.CALM in s.effects, Mode.KEEP, "calm for long enough"
    ),
    Transition(
        frozenset({Mode.STOP}),
        lambda s: s.standstill and Effect.START in s.effects,
        Mode.CAUTION,
        "healthy at standstill",
    ),
)
"""The first matching row decides. A final stop has no way out."""
HAND_OVER = Transition(
    frozenset({Mode.STOP}),
    lambda s: Effect.HAND_OVER in s.effects and s.path,
    Mode.CAUTION,
    "a driver has handed over",
)
"""Applies only to the stop in which a supervisor starts; other stops end at standstill."""
_ROWS = {mode: tuple(row for row in TRANSITIONS if mode in row.sources) for mode in Mode}


def next_state(state: ModeState, now: Situation, *, final_causes: Collection[str]) -> ModeState:
    """The mode after this situation. A stop can only become harder; it ends at standstill or never."""
    if state.mode is Mode.STOP:
        state = _tighten_stop(state, now)
    if state.final:
        return state
    for row in _ROWS[state.mode]:
        if row.when(now):
            return _enter_mode(row.target, now, final_causes)
    if state.cause == STARTING and HAND_OVER.when(now):
        return _enter_mode(HAND_OVER.target, now, final_causes)
    return state


def _enter_mode(mode: Mode, now: Situation, final_causes: Collection[str]) -> ModeState:
    if mode is not Mode.STOP:
        return ModeState(mode, Stop.NONE, "", final=False)
    doubted = not now.effects.isdisjoint({Effect.STOP, Effect.STOP_ON_ROAD})
    cause = now.fault or (now.cause if doubted else Cause.NO_ROAD)
    stop = ModeState(Mode.STOP, Stop.COMFORT, cause, final=cause in final_causes, part=now.part)
    return _tighten_stop(stop, now)


def _tighten_stop(state: ModeState, now: Situation) -> ModeState:
    """The stop after new effects: BRAKE_HARDER makes it an emergency stop, EMERGENCY a final emergency stop, a lost
    process makes it final, except before the first drive, while the processes start.
    """
    if Effect.EMERGENCY in now.effects and not (state.final and state.stop is Stop.EMERGENCY):
        return ModeState(Mode.STOP, Stop.EMERGENCY, now.fault or now.cause, final=True, part=now.part)
    return state._replace(
        stop=Stop.EMERGENCY if Effect.BRAKE_HARDER in now.effects else state.stop,
        final=state.final or (now.lost and state.cause != STARTING),
    )
