"""Assertions over time, as sentences: ``fear >= high within 0.5 s of glare``.

A sentence holds a claim about single moments, and a scope in time (grammar: ``docs/conditions.md``). It is judged
on the trace of a run by its **robustness** in signal temporal logic (Donzé and Maler, FORMATS 2010):

- the margin of a comparison is its distance from equality, in the unit of its signal;
- *always* is the least margin over the samples that are judged, *eventually* the greatest;
- the least over all time intervals (one per event).

Robustness ≥ 0 passes. Samples hold until the next one; samples with an absent signal are not judged. Without
any sample to judge the condition fails: robustness -inf.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from sim_harness.judging.conditions.claims import Claim
from sim_harness.judging.conditions.scopes import NothingToJudge, Scope
from sim_harness.judging.conditions.signals import close_to
from sim_harness.judging.trace import Trace

_UNKNOWN = {"event": "nothing called {name!r} happens here", "estimator": "no estimator {name!r} runs here"}


@dataclass(frozen=True, slots=True)
class Word:
    """A name in a sentence that must be known in its scenario, and its column, from 1."""

    kind: str  # event (a fault, disturbance, manoeuvre or section), estimator, or the label that has the word
    text: str
    column: int


@dataclass(frozen=True, slots=True)
class ConditionResult:
    """The result of a condition on a run."""

    robustness: float  # in the unit of the signal; ≥ 0 passes
    elapsed_s: float | None  # time of the deciding sample, from the start of the run
    values: dict[str, float]  # the signals at this sample
    note: str  # the reason when nothing was judged, else ""


@dataclass(frozen=True, slots=True)
class Condition:
    """A parsed sentence."""

    text: str
    claim: Claim
    scope: Scope
    eventually: bool
    words: tuple[Word, ...]  # that must be known in the scenario

    def check(self, known: Mapping[str, Collection[str]]) -> None:
        """Raise ValueError for a word that is not among ``known``, the names of its kind (:class:`Word`)."""
        for word in self.words:
            names = known.get(word.kind)
            if names is not None and word.text not in names:
                message = _UNKNOWN.get(word.kind, "no {kind} {name!r}").format(kind=word.kind, name=word.text)
                hint = close_to(word.text, sorted(names))
                raise ValueError(f"{self.text!r}, column {word.column}: {message}{hint}")

    def robustness(self, trace: Trace) -> float:
        """The margin by which ``trace`` satisfies the condition; < 0: it fails."""
        return self.judge(trace).robustness

    def explain(self, trace: Trace) -> str:
        """One line: passed or failed, margin, time, and the signals at that time."""
        verdict = self.judge(trace)
        status = "passed" if verdict.robustness >= 0 else "failed"
        if verdict.elapsed_s is None:
            return f"{self.text}: {status}: {verdict.note}"
        units = {signal.unit for signal in self.claim.signals}
        unit = units.pop() if len(units) == 1 else ""
        by = f" by {abs(verdict.robustness):.4g} {unit}".rstrip() if math.isfinite(verdict.robustness) else ""
        values = "".join(f", {name} = {value:.4g}" for name, value in verdict.values.items())
        return f"{self.text}: {status}{by} at {verdict.elapsed_s:.2f} s{values}"

    def judge(self, trace: Trace) -> ConditionResult:
        """The robustness of ``trace`` and the sample that decided it."""
        try:
            margin, stretches = self.claim.margin(trace), self.scope.stretches(trace)
        except NothingToJudge as reason:
            return ConditionResult(-np.inf, None, {}, str(reason))
        except KeyError as missing:
            return ConditionResult(-np.inf, None, {}, f"the run has no {missing.args[0]}")
        known = ~np.isnan(margin)
        judged = [np.flatnonzero(stretch & known) for stretch in stretches]
        if not self.eventually:  # an interval without samples satisfies *always*
            judged = [samples for samples in judged if len(samples)]
        if not judged:
            if self.scope.may_be_empty and not any(stretch.any() for stretch in stretches):
                return ConditionResult(np.inf, None, {}, "its event or `whenever` condition did not occur")
            return ConditionResult(-np.inf, None, {}, "there was no sample to judge")
        if any(len(samples) == 0 for samples in judged):
            return ConditionResult(-np.inf, None, {}, "its signals were absent throughout")
        pick = np.argmax if self.eventually else np.argmin
        deciding = [int(samples[pick(margin[samples])]) for samples in judged]
        worst = min(deciding, key=lambda sample: float(margin[sample]))
        values = {str(signal): float(signal.values(trace)[worst]) for signal in self.claim.signals}
        elapsed_s = float(trace["t_s"][worst] - trace["t_s"][0])
        return ConditionResult(float(margin[worst]), elapsed_s, values, "")
