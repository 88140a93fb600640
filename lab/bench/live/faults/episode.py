"""One fault, from its injection to its end, judged from stamped events (:func:`judge_episode`)."""

import math
from bisect import bisect_left, bisect_right
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from lab.bench.live.faults.catalogue import OUTPUTS, PERIODS_S, STARVED, Act, Fault, Onset
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

STANDING_MPS = load(CONFIG_DIR / "vehicle.yaml", Vehicle).standstill_mps
CALM_S = 1.0  # before the injection: the hardest brake in it is the reference
NOISE_MPS2 = 0.05  # a harder brake than the reference by this is not the noise of the speed control
BRAKING_MPS2 = 0.4  # ... and by this the car is braked towards a stop, or to another speed
Row = dict[str, Any]


class Place(NamedTuple):
    """The true motion of the car."""

    t_s: float
    speed_mps: float
    departures: int  # so far


@dataclass(slots=True)
class Events:
    """What the processes published, on the clock of the drive, each list in order of time."""

    published_s: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """Times of publication by topic key."""
    marks_s: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """Times of falsified messages by topic key, and of frames."""
    applied: list[tuple[float, float]] = field(default_factory=list)
    """Time and acceleration [m/s²] of the commands that act on the car."""
    places: list[Place] = field(default_factory=list)


def observable_s(fault: Fault, events: Events, *, injected_s: float) -> float | None:
    """When the fault becomes observable, see :class:`Onset` [s]; None: it never did.

    For a process that is frozen at ``injected_s`` its last message is known. Starvation shows at the first gap of
    two periods in the output of any process. A process that harms its own messages marks when each was due.
    """
    if fault.onset is Onset.INJECTION:
        return injected_s
    marks_s = events.marks_s[fault.key]
    marks_s = marks_s[bisect_left(marks_s, injected_s) :]
    if fault.act is Act.FREEZE:
        before_s = events.published_s[fault.key]
        last = bisect_right(before_s, injected_s) - 1
        return max(injected_s, before_s[last] + 2 * fault.period_s) if last >= 0 else None
    if fault.act is Act.STARVE:
        keys = [OUTPUTS[name].key for name in STARVED]
        gaps_s = (_first_gap_s(events.published_s[key], PERIODS_S[key], from_s=injected_s) for key in keys)
        return min((gap_s for gap_s in gaps_s if gap_s is not None), default=None)
    number = 1 if fault.onset is Onset.SECOND else 0
    if len(marks_s) <= number:
        return None
    return marks_s[number] + (fault.period_s if fault.onset is Onset.LATE else 0.0)


def _first_gap_s(times_s: list[float], period_s: float, *, from_s: float) -> float | None:
    """Two periods after the first message from ``from_s`` on that no other follows until then [s]."""
    first = max(bisect_right(times_s, from_s) - 1, 0)
    for here_s, next_s in zip(times_s[first:], [*times_s[first + 1 :], math.inf], strict=False):
        if next_s - here_s > 2 * period_s:
            return here_s + 2 * period_s
    return None


def braking_time_s(applied: list[tuple[float, float]], *, injected_s: float) -> float | None:
    """When the first command of the brake acted on the car after ``injected_s`` [s]; None: it was not braked.

    The brake is harder by BRAKING_MPS2 than any in the CALM_S before. It begins with the first command of the ramp
    to it that is harder by NOISE_MPS2.
    """
    calm = [accel for t_s, accel in applied if injected_s - CALM_S <= t_s <= injected_s]
    if not calm:
        return None
    reference_mps2 = min(0.0, *calm)
    began_s: float | None = None
    for t_s, accel_mps2 in applied:
        if t_s <= injected_s:
            continue
        if accel_mps2 >= reference_mps2 - NOISE_MPS2:
            began_s = None
            continue
        began_s = t_s if began_s is None else began_s
        if accel_mps2 <= reference_mps2 - BRAKING_MPS2:
            return began_s
    return None


def judge_episode(fault: Fault, events: Events, *, injected_s: float) -> Row:
    """The figures of one episode; times in ms, None where there is none."""
    after = [place for place in events.places if place.t_s >= injected_s]
    before = [place.departures for place in events.places if place.t_s < injected_s]
    seen_s = observable_s(fault, events, injected_s=injected_s)
    began_s = braking_time_s(events.applied, injected_s=injected_s)
    stood_s = next((place.t_s for place in after if place.speed_mps < STANDING_MPS), None)
    reaction_ms = None if began_s is None or seen_s is None else 1e3 * (began_s - seen_s)
    return {
        "fault": fault.name,
        "observable_ms": None if seen_s is None else round(1e3 * (seen_s - injected_s), 1),
        "reaction_ms": None if reaction_ms is None else round(reaction_ms, 1),
        "braked_ms": None if began_s is None else round(1e3 * (began_s - injected_s), 1),
        "stood_s": None if stood_s is None else round(stood_s - injected_s, 2),
        "speed_mps": round(after[0].speed_mps, 2) if after else None,
        "slowest_mps": round(min(place.speed_mps for place in after), 2) if after else None,
        "departures": after[-1].departures - (before[-1] if before else 0) if after else 0,
    }
