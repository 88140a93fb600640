"""What a car does and why, as one short sentence: the same on the page, in the terminal and in an explanation."""

from collections.abc import Iterable

from trepid.causes import OWN_STOPS, RESTART, Cause, in_words, unseen
from trepid.messages import Command, Decision, Diagnostic, Limit, Mode, Stop
from vehicle.driver.stop_button import STOPPED

MISSING = "missing "  # beginning of the notes of the rules about inputs without a value
CLEAR = 0.95  # of the speed cap: a lower target speed of the controller is its own limit
RECENT_S = 0.1  # between the frames of a decision and of a command that still tells the bend
NO_DECISION = "no decision of the supervisor"
STOPS = "the controller stops the car: a decision, a measurement or the path is late or missing"
DRIVER = "the driver has the car"


def reason(decision: Decision | None, *, command: Command | None = None, driver: bool = False) -> str:
    """The sentence about ``decision``; what the car waits for comes before what limits its speed.

    ``command``: the newest one, whose target speed a bend limits below the cap of the decision; None: not known.
    ``driver``: a driver has the car.
    """
    if driver or decision is None:
        return DRIVER if driver else NO_DECISION
    return decision.waits_for or _stop(decision) or _own_limit(decision, command) or _limit_words(decision)


def task(decision: Decision | None, *, stops: str = "", driver: bool = False) -> str:
    """What a person at the car has to do, as one short sentence; ``stops``: :func:`own_stop`."""
    if driver:
        return "the car is yours"
    if stops.startswith(STOPPED):
        return "press Drive on when the way is free"
    if stops or decision is None:
        return "be ready to take over"
    if RESTART in decision.waits_for:
        return "it stays here: end the drive, mend the cause, start it again"
    if decision.waits_for or decision.stop is not Stop.NONE:
        return "keep clear: it drives on by itself"
    return "be ready to take over" if decision.mode is Mode.CAUTION else "nothing to do but watch"


def own_stop(beats: Iterable[Diagnostic]) -> str:
    """What a vehicle process says in its heartbeat while it stops the car, whatever the decision; "": it does not.

    The stop button has been pressed, or the limiter misses commands or the speed.
    """
    return next((beat.message for beat in beats if beat.message.startswith((STOPPED, *OWN_STOPS))), "")


def fired_rules(decision: Decision) -> list[tuple[str, float]]:
    """The rules that fired and their strengths, strongest first; all missing inputs are one row, with the cause."""
    rows = list(zip(decision.rules, decision.rule_strengths, strict=False))
    missing = [text.removeprefix(MISSING).partition(":")[0] for text, _ in rows if text.startswith(MISSING)]
    if len(missing) < 2:
        return rows
    kept = [(text, strength) for text, strength in rows if not text.startswith(MISSING)]
    return [(f"{MISSING}inputs ({_why(decision)}): {', '.join(missing)}", 1.0), *kept]


def _stop(decision: Decision) -> str:
    """A stop of an older recording, which does not say what the car waits for."""
    return "" if decision.stop is Stop.NONE else f"{decision.stop} stop: {_why(decision)}"


def speed_limit_mps(decision: Decision, command: Command | None) -> float:
    """The highest speed that the supervisor and the controller of ``command`` allow [m/s]."""
    own_mps = _own_target_mps(decision, command)
    return decision.speed_cap_mps if own_mps is None else min(own_mps, decision.speed_cap_mps)


def _own_limit(decision: Decision, command: Command | None) -> str:
    """What makes the controller drive clearly below the speed cap; "" where it does not, or is not known."""
    target_mps = _own_target_mps(decision, command)
    if target_mps is None or target_mps >= CLEAR * decision.speed_cap_mps:
        return ""
    return f"at most {target_mps:.1f} m/s: bend" if target_mps > 0.0 else STOPS


def _own_target_mps(decision: Decision, command: Command | None) -> float | None:
    """The speed that the controller drives at; None where it is not known.

    A command may be that of the decision before, which may have been a stop.
    """
    if command is None or command.t_s is None or decision.t_s is None:
        return None
    behind_s, target_mps = decision.t_s - command.t_s, command.speed_mps
    return None if behind_s > RECENT_S or (target_mps <= 0.0 < behind_s) else target_mps


def _limit_words(decision: Decision) -> str:
    """The speed cap and what sets it; the vehicle that the car follows."""
    most = f"at most {decision.speed_cap_mps:.1f} m/s"
    if decision.mode is Mode.FOLLOW:
        return f"{_following(decision)}: {_why(decision)}"
    calm = decision.cause == Cause.NONE
    match decision.limited_by:
        case Limit.LEAD:
            said = _following(decision)
        case Limit.ROAD_USER:
            where = "" if decision.road_user_m is None else f" {decision.road_user_m:.0f} m ahead"
            said = f"{most}: {decision.road_user}{where}"
        case Limit.SIGHT:
            seen = "" if decision.sight_m is None else f" of {decision.sight_m:.0f} m"
            by = f" ({in_words(decision.sight_cause)})" if decision.sight_cause else ""
            said = f"{most}: sight{seen}{by}"
        case Limit.NETWORK:
            said = f"{most}: speed of the driving network"
        case Limit.CRUISE:
            said = f"{most}: cruise speed"
        case Limit.PROCESS:
            said = f"{most}: {in_words(Cause.LOST_PROCESS)}"
        case Limit.RECOVERY if calm:
            said = f"{most}, rising"
        case _:
            said = most if calm else f"{most}: {_why(decision)}"
    return said


def _following(decision: Decision) -> str:
    where = "" if decision.lead_m is None else f", {decision.lead_m:.0f} m"
    return f"following the vehicle ahead{where}"


def _why(decision: Decision) -> str:
    """The cause in words; for how long no lane has been seen, where that is the cause."""
    return unseen(decision.cause, decision.lane_unseen_s) or in_words(decision.cause, decision.part)
