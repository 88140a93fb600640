"""Fear from named numbers: a closed-form fuzzy inference that is monotone by construction.

Sets are those of scikit-fuzzy (``trimf``, ``trapmf``), degrees are joined by min (and) and max (or) as in Mamdani's
method. What differs from Mamdani is what a rule's ``x is S`` means and how levels are joined, because a centroid is
neither monotone nor able to reach 0 and 1:

* In a rule that frightens, ``x is S`` reads "x is S or worse": the edge of S toward the calm side, then 1 (the
  upper closure of S in the order of risk). In a rule for very_low it reads "S or calmer".
* With t_k = the greatest strength among rules that call for level k or more (so t_1 >= t_2 >= ...) and a_k =
  where level k stands on 0..1,

      fear = sum_k (a_k - a_{k-1}) * t_k,

  the Choquet integral of the levels. It is continuous, exact at 0 and 1, and never falls when a risk rises.

A missing or non-finite value fires the riskiest sets of its input and makes fear 1 by itself; where no rule fires
at all fear is 1 too.

scikit-fuzzy defines the sets but is not imported while driving: it takes 0.4 s to load, and its functions take
whole arrays. ``trepid fear check`` and the tests hold the compiled sets against it.

Sugeno, Theory of fuzzy integrals (1974); Kouikoglou and Phillis, On the monotonicity of hierarchical sum-product
fuzzy systems (2009), for why Mamdani's method is not monotone.
"""

import itertools
import math
from bisect import bisect_right
from collections.abc import Mapping
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from supervisor.rules import LEVELS, Atom, Input, Rule, RuleFile, load_rules
from trepid.bounds import at_least, at_most
from trepid.messages import Mode

Values = Mapping[str, float | None]
CALM = "none"  # the cause when there is nothing to fear
SILENT = "no rule speaks here"
SILENT_CAUSE = "no_rule"


class Fired(NamedTuple):
    """A rule that fired."""

    text: str
    strength: float  # 0..1, weight included


class FearResult(NamedTuple):
    """How afraid, of what, and why."""

    fear: float  # 0..1
    level: str
    cause: str
    texts: tuple[str, ...]  # of the rules that fired, strongest first ...
    strengths: tuple[float, ...]  # ... and how strongly

    @property
    def rules(self) -> tuple[Fired, ...]:
        """The rules that fired, strongest first."""
        return tuple(map(Fired, self.texts, self.strengths))


class Ramp(NamedTuple):
    """Degree of an atom: 0 at ``zero``, 1 at ``zero + span``, straight between, flat beyond."""

    input: int  # index into the names
    zero: float
    span: float


Firing = tuple[float, int, Rule]
"""Strength, level of fear, and the rule."""


class Trapezoid(NamedTuple):
    """Points of a fuzzy set, as in scikit-fuzzy's ``trapmf``."""

    a: float
    b: float
    c: float
    d: float

    def membership(self, x: float) -> float:
        """Degree of ``x``, 0..1; equals ``skfuzzy.trapmf``."""
        if self.b <= x <= self.c:
            return 1.0
        if self.a < x < self.b:
            return (x - self.a) / (self.b - self.a)
        if self.c < x < self.d:
            return (self.d - x) / (self.d - self.c)
        return 0.0


class _Case(NamedTuple):
    """One way for a rule to fire: min over ramps. Filed under the first, so it is met only where that has risen."""

    rule: int
    weight: float
    others: tuple[int, ...]  # the ramps after the first


class FearRules:
    """The compiled rule file. Immutable: evaluating changes nothing, so it can be shared freely."""

    def __init__(self, file: RuleFile, rules: tuple[Rule, ...]) -> None:
        self.file = file
        self.inputs: dict[str, Input] = dict(file.inputs)
        self.names = tuple(file.inputs)
        self.rules = rules
        self._level_of = tuple(rule.level for rule in rules)
        self._ends = [(name, *spec.range, spec.worst) for name, spec in file.inputs.items()]
        self._sets = {name: _trapezoids(spec) for name, spec in file.inputs.items()}
        self._at = tuple(action.at for action in file.fear.all)
        self._factors = tuple(action.speed_factor for action in file.fear.all)
        self._modes = tuple(action.mode for action in file.fear.all)
        self._levels = {
            name: Trapezoid(*([self._at[max(k - 1, 0)]] + [self._at[k]] * 2 + [self._at[min(k + 1, 4)]]))
            for k, name in enumerate(LEVELS)
        }
        self._borders = [(low + high) / 2 for low, high in itertools.pairwise(self._at)]
        self._ramps: list[Ramp] = []
        self._cases: list[list[_Case]] = []  # of each ramp
        self._always: list[int] = []  # rules that hold everywhere
        for index, rule in enumerate(rules):
            self._compile(index, rule)

    @classmethod
    def load(cls, path: Path) -> "FearRules":
        """The rules in the file at ``path``. Raises InputError with file:line:column."""
        return cls(*load_rules(path))

    def evaluate(self, values: Values) -> FearResult:
        """Fear of ``values`` (unit as in the file). Where one is missing, None, NaN or inf, fear is 1."""
        x, missing = self._complete(values)
        degrees = zip(self._strengths(x), self._level_of, self.rules, strict=True)
        firing = [(strength, level, rule) for strength, level, rule in degrees if strength]
        truth = [0.0] * len(LEVELS)
        for strength, level, _ in firing:
            truth[level] = at_least(strength, truth[level])
        fear = 1.0 if missing or not firing else self._choquet(truth)
        texts, strengths = _strongest_first(firing, [(m, self.inputs[m].riskiest_set) for m in missing])
        return FearResult(
            fear=fear,
            level=self.level(fear),
            cause=self._cause(firing, missing, fear),
            texts=texts,
            strengths=strengths,
        )

    def memberships(self, values: Values) -> dict[str, dict[str, float]]:
        """Degrees of every input, and of fear itself, in their five sets (``skfuzzy.trimf``, ``trapmf``)."""
        x, _ = self._complete(values)
        degrees = {
            name: {level: shape.membership(value) for level, shape in self._sets[name].items()}
            for name, value in zip(self.names, x, strict=True)
        }
        fear = self.evaluate(values).fear
        degrees["fear"] = {level: shape.membership(fear) for level, shape in self._levels.items()}
        return degrees

    def level(self, fear: float) -> str:
        """The level that stands nearest to ``fear``; of two, the more fearful."""
        return LEVELS[self.level_index(fear)]

    def level_index(self, fear: float) -> int:
        """Index of that level in LEVELS."""
        return bisect_right(self._borders, fear)

    def mode(self, fear: float) -> Mode:
        """The mode of the level of ``fear``."""
        return self._modes[self.level_index(fear)]

    def speed_factor(self, fear: float) -> float:
        """Share of the cruise speed at ``fear``: interpolated between the levels, so it never rises with fear."""
        at, factors = self._at, self._factors
        k = 1
        while fear > at[k] and k < len(at) - 1:
            k += 1
        part = at_most((fear - at[k - 1]) / (at[k] - at[k - 1]), 1.0)
        return factors[k - 1] + part * (factors[k] - factors[k - 1])

    def _complete(self, values: Values) -> tuple[list[float], list[str]]:
        """Every input within its range, and the names of those that are missing."""
        x, missing = [], []
        for name, low, high, worst in self._ends:
            value = values.get(name)
            if value is not None and low <= value <= high:
                x.append(value)
            elif value is None or not math.isfinite(value):
                missing.append(name)
                x.append(worst)
            else:
                x.append(low if value < low else high)
        return x, missing

    def _strengths(self, x: list[float]) -> list[float]:
        """Strength of every rule: its weight times the max over its cases of the min over their ramps."""
        degrees = [
            (x[i] - zero) / span for i, zero, span in self._ramps
        ]  # clipped to 0..1 where they are used
        strengths = [0.0] * len(self.rules)
        for rule in self._always:
            strengths[rule] = self.rules[rule].weight
        for degree, cases in zip(degrees, self._cases, strict=True):
            if degree > 0.0:
                full = degree if degree < 1.0 else 1.0
                for rule, weight, others in cases:
                    weakest = full
                    for other in others:
                        weakest = at_most(degrees[other], weakest)
                    strength = weight * weakest
                    strengths[rule] = strength if strength > strengths[rule] else strengths[rule]
        return strengths

    def _choquet(self, truth: list[float]) -> float:
        """sum_k a_k (t_k - t_{k+1}) with t_k the greatest of ``truth`` from level k up: exactly 1 when t_4 is."""
        fear, above = 0.0, 0.0
        for at, strength in zip(reversed(self._at), reversed(truth), strict=True):
            if strength > above:
                fear += at * (strength - above)
                above = strength
        return at_most(1.0, fear)

    def _cause(self, firing: list[Firing], missing: list[str], fear: float) -> str:
        """The cause of the rule that adds most to fear; that of the missing input, if the rule rests on one."""
        if self.level_index(fear) == 0:
            return CALM
        if not firing:
            return self.inputs[missing[0]].missing if missing else SILENT_CAUSE
        strength, _, rule = max(firing, key=lambda fired: fired[0] * self._at[fired[1]])
        absent = [name for name in missing if any(a.input == name for case in rule.cases for a in case)]
        if not absent and strength * self._at[rule.level] < 1:
            absent = missing  # no rule alone accounts for a fear of 1
        return self.inputs[absent[0]].missing if absent else rule.cause

    def _compile(self, index: int, rule: Rule) -> None:
        """Enter rule ``index`` into the tables."""
        for case in rule.cases:
            edges = [(self.names.index(a.input), *_edge(a, self.inputs[a.input], rule.level)) for a in case]
            if any(edge[1:] == NEVER for edge in edges):
                continue
            ramps = [self._ramp(Ramp(i, zero, one - zero)) for i, zero, one in edges if (zero, one) != ALWAYS]
            if ramps:
                self._cases[ramps[0]].append(_Case(index, rule.weight, tuple(ramps[1:])))
            else:
                self._always.append(index)

    def _ramp(self, ramp: Ramp) -> int:
        """Index of ``ramp`` in the table; rules share ramps."""
        if ramp not in self._ramps:
            self._ramps.append(ramp)
            self._cases.append([])
        return self._ramps.index(ramp)


NEVER = (math.inf, math.inf)
ALWAYS = (-math.inf, -math.inf)


def _edge(atom: Atom, spec: Input, level: int) -> tuple[float, float]:
    """The edge (zero, one) of the closure of the atom's set: toward risk, or toward calm in a rule for very_low.

    Of a set a <= b <= c <= d, "S or more" rises from a to b, "S or less" falls from c to d, and ``not`` takes the
    complement of the other one, so that every atom of a rule moves the same way with risk.
    """
    a, b, c, d = spec.sets.trapezoid(atom.set)
    frightens = level > 0
    upward = (spec.risk == "rising") == frightens
    if atom.negated:
        zero, one = (c, d) if upward else (b, a)
        return (zero, one) if zero != one else NEVER
    zero, one = (a, b) if upward else (d, c)
    return (zero, one) if zero != one else ALWAYS


def _strongest_first(
    firing: list[Firing], missing: list[tuple[str, str]]
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """The missing inputs, then the rules by strength and level; a note where no rule fired."""
    notes = [f"missing {name}: taken as {worst}" for name, worst in missing]
    if not firing:
        notes.append(SILENT)
    ranked = sorted(
        firing, key=itemgetter(0, 1), reverse=True
    )  # of equals, the first in the file comes first
    return (*notes, *[rule.text for _, _, rule in ranked]), (
        *[1.0] * len(notes),
        *[fired[0] for fired in ranked],
    )


def _trapezoids(spec: Input) -> dict[str, Trapezoid]:
    return {level: Trapezoid(*spec.sets.trapezoid(level)) for level in LEVELS}
