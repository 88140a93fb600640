"""Claims about single moments: comparisons, words, and their combinations.

``margin(trace)`` is the robustness of the claim at each sample in signal temporal logic (Donzé and Maler, Robust
satisfaction of temporal logic over real-valued signals, FORMATS 2010): the distance of the signals from making the
claim false (> 0) or true (< 0), in their own unit; for a claim about words it is infinite. A margin
of ≥ 0 is true and < 0 is false, exactly, for strict comparisons too. NaN: a signal is absent.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim_harness.judging.conditions.signals import Signal, activity
from sim_harness.judging.trace import Trace
from trepid.types import Column

JUST_FALSE = -np.nextafter(0.0, 1.0)  # a strict comparison of equals


class Claim(Protocol):
    """A statement that is true or false at every sample."""

    def margin(self, trace: Trace) -> Column:
        """Robustness at each sample; raises KeyError for a signal that the run lacks."""
        ...

    def negated(self) -> "Claim":
        """The claim that is true where this one is false; absent at the same samples."""
        ...

    def signals(self) -> Iterator[Signal]:
        """The signals that are compared."""
        ...


@dataclass(frozen=True, slots=True)
class Sum:
    """Signals with their signs, and a number, all in one unit."""

    signals: tuple[tuple[float, Signal], ...]
    constant: float

    def values(self, trace: Trace) -> Column:
        """The sum at each sample."""
        total = np.full(len(trace), self.constant)
        for sign, signal in self.signals:
            total += sign * signal.values(trace)
        return total

    def __neg__(self) -> "Sum":
        return Sum(tuple((-sign, signal) for sign, signal in self.signals), -self.constant)

    def __add__(self, other: "Sum") -> "Sum":
        return Sum(self.signals + other.signals, self.constant + other.constant)


@dataclass(frozen=True, slots=True)
class Above:
    """``difference`` ≥ 0, or > 0 when strict."""

    difference: Sum
    strict: bool

    def margin(self, trace: Trace) -> Column:
        margin = self.difference.values(trace)
        return np.where(margin == 0.0, JUST_FALSE, margin) if self.strict else margin

    def negated(self) -> Claim:
        return Above(-self.difference, not self.strict)

    def signals(self) -> Iterator[Signal]:
        yield from (signal for _, signal in self.difference.signals)


@dataclass(frozen=True, slots=True)
class Is:
    """A label has the word ``word``; absent before the first decision."""

    label: str
    word: str
    wanted: bool = True

    def margin(self, trace: Trace) -> Column:
        words, codes = trace.words[self.label], trace[self.label]
        same = codes == words.index(self.word) if self.word in words else np.zeros(len(trace), bool)
        return np.where(codes < 0, np.nan, _infinite(same == self.wanted))

    def negated(self) -> Claim:
        return Is(self.label, self.word, not self.wanted)

    def signals(self) -> Iterator[Signal]:
        yield from ()


@dataclass(frozen=True, slots=True)
class Known:
    """A signal is present."""

    signal: Signal
    wanted: bool = True

    def margin(self, trace: Trace) -> Column:
        return _infinite(np.isfinite(self.signal.values(trace)) == self.wanted)

    def negated(self) -> Claim:
        return Known(self.signal, not self.wanted)

    def signals(self) -> Iterator[Signal]:
        yield self.signal


@dataclass(frozen=True, slots=True)
class Active:
    """A fault, disturbance, manoeuvre or section of the road is active."""

    name: str
    wanted: bool = True

    def margin(self, trace: Trace) -> Column:
        return _infinite((activity(trace, self.name) > 0) == self.wanted)

    def negated(self) -> Claim:
        return Active(self.name, not self.wanted)

    def signals(self) -> Iterator[Signal]:
        yield from ()


@dataclass(frozen=True, slots=True)
class Both:
    """Two claims hold: the lesser margin. A false one decides, even when the other is absent."""

    first: Claim
    second: Claim

    def margin(self, trace: Trace) -> Column:
        first, second = self.first.margin(trace), self.second.margin(trace)
        least = np.fmin(first, second)
        return np.where(least < 0, least, np.minimum(first, second))

    def negated(self) -> Claim:
        return Either(self.first.negated(), self.second.negated())

    def signals(self) -> Iterator[Signal]:
        yield from (*self.first.signals(), *self.second.signals())


@dataclass(frozen=True, slots=True)
class Either:
    """One of two claims holds: the greater margin. A true one decides, even when the other is absent."""

    first: Claim
    second: Claim

    def margin(self, trace: Trace) -> Column:
        first, second = self.first.margin(trace), self.second.margin(trace)
        most = np.fmax(first, second)
        return np.where(most >= 0, most, np.maximum(first, second))

    def negated(self) -> Claim:
        return Both(self.first.negated(), self.second.negated())

    def signals(self) -> Iterator[Signal]:
        yield from (*self.first.signals(), *self.second.signals())


def _infinite(true: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Column:
    """+inf where true, -inf where false."""
    return np.where(true, np.inf, -np.inf)
