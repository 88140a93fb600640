"""What keeps a car from driving, and what would end that: the words of every display.

The obstacles of a start decide with the same table from which their words come, so that a display never names
another reason than the one that holds the car.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import NamedTuple

from supervisor.inputs.validation import ValidationSettings
from supervisor.modes.analyser import field_names
from supervisor.modes.doubts import Conditions
from supervisor.modes.modes import STARTING, ModeSettings, ModeState
from supervisor.path.giving_way import Way
from supervisor.rules.inference import FearRules
from supervisor.situation.features import DOUBT
from supervisor.situation.world_state import WorldState
from trepid.bounds import at_least
from trepid.causes import RESTART, Cause, in_words, unseen
from trepid.messages import Losses, Mode, Stop
from trepid.processes.lateness import RECOVERED


class Bounds(NamedTuple):
    """The settings that the words name."""

    modes: ModeSettings
    validation: ValidationSettings
    standstill_mps: float  # of the car, in the world of these settings
    scale: float  # of the world of the car relative to that of these settings


class StartSituation(NamedTuple):
    """The situation of one step, as far as a start depends on it."""

    world: WorldState
    rules: FearRules
    bounds: Bounds
    state: ModeState  # so far
    fear: float
    cause: str  # of fear
    losses: Losses | None = None  # the newest report of the launcher


@dataclass(frozen=True, slots=True)
class Obstacle:
    """One row: a condition that keeps a standing car from driving, and the end of it in words."""

    name: str
    holds: Callable[[StartSituation], bool]
    waits_for: Callable[[StartSituation], str]


def since(age_s: float) -> str:
    """The age of the newest message of a sender, as text: inf is that of a sender without any."""
    return f"none for {age_s:.1f} s" if math.isfinite(age_s) else "none so far"


def _awaited_processes(v: StartSituation) -> Collection[str]:
    """Processes that have not reported yet in a drive that is to begin."""
    return v.losses.awaited if v.losses is not None else ()


def _invalid(v: StartSituation) -> list[str]:
    """Estimators without a valid message lately."""
    return [e.estimator for e in v.world.estimates if e.confidence is None]


def _estimates(v: StartSituation) -> str:
    invalid, ages_s = _invalid(v), v.world.ages_s
    if not ages_s:
        return "an estimator (the drive has none)"
    if invalid == list(ages_s) and not v.world.statistics_age_s < min(ages_s.values()):
        return f"frames of the camera ({since(min(ages_s.values()))})"
    named = ", ".join(
        f"{e.estimator} ({'not valid' if e.broken else since(e.age_s)})"
        for e in v.world.estimates
        if e.estimator in invalid
    )
    return f"the estimate of {named}"


def _confidences(v: StartSituation) -> str:
    seen = ", ".join(f"{e.estimator} {e.confidence or 0.0:.2f}" for e in v.world.estimates)
    return f"a lane with a confidence of at least {v.bounds.validation.min_confidence:g} (now {seen})"


def _calm(v: StartSituation) -> str:
    times = "" if v.bounds.modes.reengage_after_s is None else f"{v.bounds.modes.reengage_after_s:.1f} s of "
    return f"{times}fear of at most {v.bounds.modes.reengage_max_fear:g} (now {v.fear:.2f}: {_cause(v)})"


def _cause(v: StartSituation) -> str:
    """The cause of fear, with the measurements that are doubted."""
    return in_words(v.cause, field_names(v.world.doubted) if v.cause == Cause.DOUBTED_STATE else "")


def _doubtful(v: StartSituation) -> bool:
    """A cause that would stop the car is active, or was that of the present stop."""
    doubted = not {v.cause, v.state.cause}.isdisjoint(v.bounds.modes.stop_after_s)
    return doubted and v.rules.mode(v.fear) is not Mode.KEEP


def _less_doubt(v: StartSituation) -> str:
    return f"a level of fear with the mode KEEP (now {v.fear:.2f}: {_cause(v)})"


def _state(v: StartSituation) -> str:
    """The age of the state; a fresh one that counts as missing has an impossible or no value."""
    doubt = v.world.features[DOUBT]
    if doubt is not None and doubt > 0.0:
        doubted = field_names(v.world.doubted)
        return f"{doubted} doubted" if doubted else "a measurement is missing"
    age_s = v.world.state_age_s
    return "not valid" if age_s <= v.bounds.validation.state_fresh_s else since(age_s)


OBSTACLES = (
    Obstacle(
        "a process that the launcher still awaits",
        lambda v: bool(_awaited_processes(v)),
        lambda v: f"the start of {', '.join(_awaited_processes(v))}",
    ),
    Obstacle(
        "an estimator without a valid message",
        lambda v: not v.world.estimates or bool(_invalid(v)),
        _estimates,
    ),
    Obstacle(
        "no valid state of the vehicle",
        lambda v: v.world.motion is None,
        lambda v: f"the state of the vehicle ({_state(v)})",
    ),
    Obstacle("no usable lane", lambda v: not v.world.fused.sources, _confidences),
    Obstacle("fear above `reengage_max_fear`", lambda v: v.fear > v.bounds.modes.reengage_max_fear, _calm),
    Obstacle("a cause that stops the car", _doubtful, _less_doubt),
)
"""The first row that holds gives the words. Without one, a standing car drives after ``reengage_after_s``."""


def obstacle(view: StartSituation) -> Obstacle | None:
    """The first of OBSTACLES that holds."""
    return next((row for row in OBSTACLES if row.holds(view)), None)


class Halt(NamedTuple):
    """The mode after one step, and what holds the car in it."""

    state: ModeState
    now: Conditions
    healthy_s: float  # for how long a standing or driven car has had neither obstacle nor fault
    brake: Stop  # the stop that the car makes now
    braked_for: str  # cause of a brake without a change of mode; "" without it
    late: Collection[str]  # senders of late messages
    cap_mps: float
    lead_cap_mps: float  # by the gap to the vehicle ahead


READY = "starting: ready; drives when the driver lets go"
"""What a moving car says in the stop in which a supervisor starts, when a driver may hand it over."""


def waits_for(view: StartSituation, halt: Halt) -> str:
    """What the car waits for, and what would end it; "" while it may drive."""
    if halt.state.mode is Mode.STOP:
        return _stop(view, halt)
    if halt.braked_for:
        return _brake(halt)
    return "" if halt.cap_mps >= view.bounds.standstill_mps else _bound_words(view, halt)


def _bound_words(view: StartSituation, halt: Halt) -> str:
    """The words about what keeps the speed at standstill."""
    way, sight, standstill_mps = view.world.way, view.world.sight, view.bounds.standstill_mps
    if way.hard or way.cap_mps < standstill_mps:
        return _for_a_road_user(way, halt.now, view.bounds.scale)
    if halt.lead_cap_mps < standstill_mps:
        return _behind_a_vehicle(view.world.ahead.distance_m, halt.now, view.bounds.scale)
    if sight.cap_mps < standstill_mps:
        return f"stops within its sight: {in_words(sight.cause)}; waits for a longer sight"
    if view.world.proposal_mps < standstill_mps:
        return "the driving network proposes to stand; waits for it to propose a speed"
    return f"brakes for fear {view.fear:.2f}: {_cause(view)}; waits for less fear"


def _brake(halt: Halt) -> str:
    """The words about a brake without a change of mode."""
    if halt.brake is Stop.EMERGENCY:
        return f"brakes hard: {in_words(halt.braked_for)}; waits for a speed from which it can stop in time"
    end = f"{RECOVERED} messages in time of {', '.join(sorted(halt.late))}" if halt.late else "a new image"
    return f"brakes: {in_words(halt.braked_for)}; waits for {end}"


def _for_a_road_user(way: Way, now: Conditions, scale: float) -> str:
    """The words about the one that limits the speed most."""
    brakes = "brakes hard" if way.hard else "waits" if now.standstill else "brakes"
    article = "an" if way.kind[:1] in "aeiou" else "a"
    where = "" if way.ahead_m is None else f", {way.ahead_m * scale:.0f} m ahead"
    return f"{brakes} for {article} {way.kind}{where}; drives on when the way is free"


def _behind_a_vehicle(gap_m: float | None, now: Conditions, scale: float) -> str:
    seen = "" if gap_m is None else f", {gap_m * scale:.1f} m"
    stops = "stopped" if now.standstill else "stops"
    return f"{stops} behind a vehicle{seen}; waits for it to drive on"


ENDS = {
    Cause.DRIVER_OVERRIDE.value: "the driver to let go",
    Cause.STOP_BUTTON.value: "a person to press Drive on",
    Cause.LOST_PROCESS.value: "the process that is lost",
    Cause.IMAGE_STATISTICS_LOST.value: "the image statistics",
    Cause.LEAD_LOST.value: "the detector of vehicles",
    Cause.ROAD_USERS_LOST.value: "the detector of people",
}
"""Cause of a fault -> what ends it, where no obstacle says it better."""


def _stop(view: StartSituation, halt: Halt) -> str:
    """The words about a stop."""
    state, standing, fault = halt.state, halt.now.standstill, halt.now.fault.cause
    stop = "emergency stop" if state.stop is Stop.EMERGENCY else "stopped" if standing else "stopping"
    starting, unseen_s = state.cause == STARTING and not state.final, view.world.fused.unseen_s
    head = (
        "starting:"
        if starting
        else f"{stop}: {unseen(state.cause, unseen_s) or in_words(state.cause, state.part)};"
    )
    if state.final:
        return f"{head} {RESTART}"
    if not standing and view.world.motion is not None:
        if starting and halt.now.driver:
            return _hand_over(view, halt, head)
        event = "standstill, or for a driver who hands over" if starting else "standstill"
        return f"{head} waits for {event}"
    return f"{head} {_start(view, halt, fault, view.bounds.modes.reengage_after_s)}"


def _hand_over(view: StartSituation, halt: Halt, head: str) -> str:
    """What a moving car waits for before its driver may hand it over."""
    row, after_s = obstacle(view), view.bounds.modes.reengage_after_s
    if row is not None or after_s is None:
        return f"{head} waits for {row.waits_for(view) if row else 'standstill'}"
    left_s = after_s - halt.healthy_s
    return f"{head} takes over after {left_s:.1f} s more without a fault" if left_s > 0.0 else READY


def _start(view: StartSituation, halt: Halt, fault: str, after_s: float | None) -> str:
    """What a standing car waits for before it drives, ``after_s`` without obstacle and fault; None: never."""
    if after_s is None:
        return f"{RESTART}, as reengage_after_s is null"
    row = None if fault in ENDS else obstacle(view)
    if row is not None:
        return f"waits for {row.waits_for(view)}"
    if fault:
        return f"waits for {ENDS.get(fault, f'the end of {fault}')}"
    return f"drives after {at_least(after_s - halt.healthy_s, 0.0):.1f} s more without a fault"
