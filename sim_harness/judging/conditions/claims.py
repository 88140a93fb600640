"""Claims about single moments: comparisons, words, and their combinations.

``margin(trace)`` is the robustness of the claim at each sample in signal temporal logic (Donzé and Maler, Robust
satisfaction of temporal logic over real-valued signals, FORMATS 2010): the distance of the signals from making the
claim false (> 0) or true (< 0), in their own unit; for a claim about words it is infinite. A margin
of ≥ 0 is true and < 0 is false, exactly, for strict comparisons too. NaN: a signal is absent.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from sim_harness.judging.conditions.signals import Signal, activity
from sim_harness.judging.trace import Trace
from trepid.types import Column

JUST_FALSE = -np.nextafter(0.0, 1.0)  # a strict comparison of equals


class Claim(Protocol):
    """A statement that is true or false at every sample."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The signals that are compared."""
        ...

    def margin(self, trace: Trace) -> Column:
        """Robustness at each sample; raises KeyError for a signal that the run lacks."""
        ...


@dataclass(frozen=True, slots=True)
class Sum:
    """Signals with their signs, and a number, all in one unit."""

    terms: tuple[tuple[float, Signal], ...]
    constant: float

    def values(self, trace: Trace) -> Column:
        """The sum at each sample."""
        total = np.full(len(trace), self.constant)
        for sign, signal in self.terms:
            total += sign * signal.values(trace)
        return total

    def __neg__(self) -> "Sum":
        return Sum(tuple((-sign, signal) for sign, signal in self.terms), -self.constant)

    def __add__(self, other: "Sum") -> "Sum":
        return Sum(self.terms + other.terms, self.constant + other.constant)


@dataclass(frozen=True, slots=True)
class AtLeastZero:
    """``sum`` ≥ 0."""

    sum: Sum

    @property
    def signals(self) -> tuple[Signal, ...]:
        return tuple(signal for _, signal in self.sum.terms)

    def margin(self, trace: Trace) -> Column:
        return self.sum.values(trace)


@dataclass(frozen=True, slots=True)
class Is:
    """A label has the word ``word``; absent before the first decision."""

    signals: ClassVar = ()
    label: str
    word: str

    def margin(self, trace: Trace) -> Column:
        words, codes = trace.words[self.label], trace[self.label]
        same = codes == words.index(self.word) if self.word in words else np.zeros(len(trace), bool)
        return np.where(codes < 0, np.nan, np.where(same, np.inf, -np.inf))


@dataclass(frozen=True, slots=True)
class SignalPresent:
    """A signal is present."""

    signal: Signal

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.signal,)

    def margin(self, trace: Trace) -> Column:
        return np.where(np.isfinite(self.signal.values(trace)), np.inf, -np.inf)


@dataclass(frozen=True, slots=True)
class Active:
    """A fault, disturbance, manoeuvre or section of the road is active."""

    signals: ClassVar = ()
    name: str

    def margin(self, trace: Trace) -> Column:
        return np.where(activity(trace, self.name) > 0, np.inf, -np.inf)


@dataclass(frozen=True, slots=True)
class Not:
    """The claim that is true where ``claim`` is false; absent at the same samples."""

    claim: Claim

    @property
    def signals(self) -> tuple[Signal, ...]:
        return self.claim.signals

    def margin(self, trace: Trace) -> Column:
        margin = self.claim.margin(trace)
        return np.select([margin == 0.0, margin == JUST_FALSE], [JUST_FALSE, 0.0], -margin)


def negate(claim: Claim) -> Claim:
    """The claim that is true where ``claim`` is false."""
    return claim.claim if isinstance(claim, Not) else Not(claim)


@dataclass(frozen=True, slots=True)
class Both:
    """Two claims hold: the lesser margin. A false one decides, even when the other is absent."""

    first: Claim
    second: Claim

    @property
    def signals(self) -> tuple[Signal, ...]:
        return self.first.signals + self.second.signals

    def margin(self, trace: Trace) -> Column:
        first, second = self.first.margin(trace), self.second.margin(trace)
        least = np.fmin(first, second)
        return np.where(least < 0, least, np.minimum(first, second))
