"""The time at which a condition is judged: events of a run, and time intervals around them."""

from dataclasses import dataclass

import numpy as np

from sim_harness.judging.conditions.claims import Claim
from sim_harness.judging.conditions.signals import COUNTERS
from sim_harness.judging.trace import Trace
from trepid.types import Mask

SAME_INSTANT_S = 1e-9


@dataclass(frozen=True, slots=True)
class Begins:
    """The instants at which ``claim`` becomes true; at the first sample if it is true from there on."""

    claim: Claim
    text: str
    after_start: bool = False  # True: a claim that holds at the first sample does not begin there

    def instants_s(self, trace: Trace) -> list[float]:
        true = self.claim.margin(trace) >= 0
        return trace["t_s"][true & ~np.append(self.after_start, true[:-1])].tolist()


@dataclass(frozen=True, slots=True)
class CountedEvents:
    """The instants at which a departure, an intervention or a collision is counted."""

    text: str  # the counted thing

    def instants_s(self, trace: Trace) -> list[float]:
        return trace["t_s"][np.diff(trace[COUNTERS[self.text]], prepend=0.0) > 0].tolist()


@dataclass(frozen=True, slots=True)
class ElapsedInstant:
    """One instant, counted from the start of the run."""

    time_s: float

    @property
    def text(self) -> str:
        """As in the sentence."""
        return f"t = {self.time_s:g} s"

    def instants_s(self, trace: Trace) -> list[float]:
        return [float(trace["t_s"][0]) + self.time_s]


@dataclass(frozen=True, slots=True)
class Ending:
    """The last sample."""

    text: str = "the end"

    def instants_s(self, trace: Trace) -> list[float]:
        return [float(trace["t_s"][-1])]


Instant = Begins | CountedEvents | ElapsedInstant | Ending


@dataclass(frozen=True, slots=True)
class Around:
    """An interval of ``before_s`` and ``after_s`` around every occurrence of an event."""

    event: Instant
    before_s: float
    after_s: float
    must_happen: bool

    def spans(self, trace: Trace, low_s: float, high_s: float) -> list[tuple[float, float]]:
        """From and to [s] for every occurrence within [low, high]. Raises NothingToJudge."""
        instants_s = self.event.instants_s(trace)
        inside = [at for at in instants_s if low_s - SAME_INSTANT_S <= at <= high_s + SAME_INSTANT_S]
        if not inside and self.must_happen:
            raise NothingToJudge(f"{self.event.text} did not occur")
        return [(max(at - self.before_s, low_s), min(at + self.after_s, high_s)) for at in inside]


@dataclass(frozen=True, slots=True)
class Scope:
    """The limits in time of a claim; an absent one does not limit."""

    around: Around | None = None
    start: Instant | None = None  # the first of its instants
    end: Instant | None = None
    while_claim: Claim | None = None
    while_must_hold: bool = True  # at some time, else NothingToJudge

    @property
    def may_be_empty(self) -> bool:
        """True when the sentence allows that nothing is judged: `any`, `whenever`."""
        lacks_event = self.around is not None and not self.around.must_happen
        return lacks_event or (self.while_claim is not None and not self.while_must_hold)

    def stretches(self, trace: Trace) -> list[Mask]:
        """The samples of every interval that is judged by itself. Raises NothingToJudge."""
        t_s = trace["t_s"]
        low_s = _first(self.start, trace) if self.start else float(t_s[0])
        high_s = _first(self.end, trace) if self.end else float(t_s[-1])
        spans = self.around.spans(trace, low_s, high_s) if self.around else [(low_s, high_s)]
        there = self.while_claim.margin(trace) >= 0 if self.while_claim else np.full(len(trace), True)
        if self.while_claim and self.while_must_hold and not there.any():
            raise NothingToJudge("its `while` never held")
        return [_within(trace, *span) & there for span in spans]


class NothingToJudge(Exception):
    """The event or the `while` claim of a condition did not occur in the run."""


def _first(instant: Instant, trace: Trace) -> float:
    instants_s = instant.instants_s(trace)
    if not instants_s:
        raise NothingToJudge(f"{instant.text} did not occur")
    return instants_s[0]


def _within(trace: Trace, low_s: float, high_s: float) -> Mask:
    """Samples in [low, high]; for a single instant, the sample that holds there."""
    t_s = trace["t_s"]
    inside: Mask = (t_s >= low_s - SAME_INSTANT_S) & (t_s <= high_s + SAME_INSTANT_S)
    if low_s == high_s and t_s[0] <= low_s <= t_s[-1]:
        inside[:] = False
        inside[np.searchsorted(t_s, low_s + SAME_INSTANT_S, side="right") - 1] = True
    return inside
