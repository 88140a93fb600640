"""The default method: rules read as "S or worse", joined by a Choquet integral; monotone by construction.

* In a rule for more than very_low, ``x is S`` reads "x is S or worse": the edge of S toward the calm side, then 1
  (the upper closure of S in the order of risk). In a rule for fear very_low it reads "S or calmer".
* With t_k = the greatest strength among rules for level k or more (so t_1 >= t_2 >= ...) and a_k = the position
  of level k on 0..1,

      fear = sum_k (a_k - a_{k-1}) * t_k,

  the Choquet integral of the levels (Sugeno, Theory of fuzzy integrals, 1974).

Fear never falls as a risk rises, bit for bit: a degree is ``(x - zero) / span`` cut to 0..1 and mapped by the knots
of a curved edge; min, max and the product with a weight follow; then a sum of products with factors that are not
negative, always in the same order. Each of these never falls when an operand rises, and rounding to the nearest
number keeps order, so neither does the computed result.
"""

import itertools
import math
from typing import NamedTuple

from supervisor.rules.rule_file import LEVELS, Input
from supervisor.rules.sentence import Atom, Rule
from supervisor.rules.shapes import Knots, curve_degree, mirror_knots
from trepid.bounds import at_least, at_most

Strengths = dict[int, float]
"""Index of every rule that fires -> its strength, above 0 and at most 1."""


class Ramp(NamedTuple):
    """Degree of an atom: 0 at ``zero``, through ``knots``, if any, 1 at ``zero + span``, flat beyond."""

    input: int  # index into the names
    zero: float
    span: float
    knots: Knots = ()

    def degree(self, x: float) -> float:
        """The degree at ``x``."""
        s = (x - self.zero) / self.span
        return 0.0 if s <= 0 else 1.0 if s >= 1 else curve_degree(s, self.knots)

    def pieces(self) -> list[tuple[float, float, float]]:
        """(from x, to x, slope |d degree / dx|) of every straight piece, from the foot up."""
        corners = [(0.0, 0.0), *self.knots, (1.0, 1.0)]
        return [
            (self.zero + s0 * self.span, self.zero + s1 * self.span, (d1 - d0) / (s1 - s0) / abs(self.span))
            for (s0, d0), (s1, d1) in itertools.pairwise(corners)
        ]


class _Case(NamedTuple):
    """One way for a rule to fire: min over ramps. Filed under the first, so it is met only where that has risen."""

    rule: int
    weight: float
    others: tuple[int, ...]  # the ramps after the first


class _Slope(NamedTuple):
    """The ramps over one input that rise the same way, from the first to rise on."""

    input: int
    rises: bool
    zero: float  # of the first: where the input is not beyond it, none has risen
    ramps: tuple[tuple[int, float, float], ...]  # index, zero, span


class Monotone:
    """Rules about one output, compiled. Immutable."""

    def __init__(self, rules: tuple[Rule, ...], inputs: dict[str, Input], at: tuple[float, ...]) -> None:
        self._steps = tuple(b - a for a, b in itertools.pairwise(at))[::-1]
        self._harms = tuple(rule.harm for rule in rules)
        self._always: Strengths = {}  # rules that hold everywhere
        self._cases: list[list[_Case]] = []  # of each ramp
        ramps: list[Ramp] = []
        for index, rule in enumerate(rules):
            for case in cases(rule, inputs):
                numbers = [self._number(ramps, ramp) for ramp in case]
                if numbers:
                    self._cases[numbers[0]].append(_Case(index, rule.weight, tuple(numbers[1:])))
                else:
                    self._always[index] = rule.weight
        self._slopes = _slopes(ramps)
        self._curved = [(number, ramp.knots) for number, ramp in enumerate(ramps) if ramp.knots]
        self._flat = [0.0] * len(ramps)

    def _number(self, ramps: list[Ramp], ramp: Ramp) -> int:
        """Index of ``ramp``; rules share ramps."""
        if ramp not in ramps:
            ramps.append(ramp)
            self._cases.append([])
        return ramps.index(ramp)

    def strengths(self, x: list[float]) -> Strengths:
        """Weight times the max over a rule's cases of the min over their ramps."""
        degrees, risen = self._flat.copy(), []
        for i, rises, first, ramps in self._slopes:
            value = x[i]
            if (value > first) == rises:
                for number, zero, span in ramps:
                    degree = (value - zero) / span
                    if degree <= 0.0:
                        break
                    degrees[number] = degree if degree < 1.0 else 1.0
                    risen.append(number)
        for number, knots in self._curved:
            if 0.0 < degrees[number] < 1.0:
                degrees[number] = curve_degree(degrees[number], knots)
        strengths = self._always.copy()
        for number in risen:
            for rule, weight, others in self._cases[number]:
                weakest = degrees[number]
                for other in others:
                    degree = degrees[other]
                    weakest = (
                        degree if degree < weakest else weakest
                    )  # a call would cost more than all else here
                strength = weight * weakest
                if strength > strengths.get(rule, 0.0):
                    strengths[rule] = strength
        return strengths

    def value(self, strengths: Strengths) -> float:
        """sum_k (a_k - a_{k-1}) t_k with t_k the greatest strength from level k up: exactly 1 when t_4 is."""
        truth = [0.0] * len(LEVELS)
        for rule, strength in strengths.items():
            harm = self._harms[rule]
            truth[harm] = strength if strength > truth[harm] else truth[harm]
        if truth[-1] == 1.0:
            return 1.0
        value, above = 0.0, 0.0
        for step, strength in zip(self._steps, reversed(truth), strict=False):  # level 0 adds nothing
            above = at_least(strength, above)
            value += step * above
        return at_most(1.0, value)


def cases(rule: Rule, inputs: dict[str, Input]) -> list[list[Ramp]]:
    """The cases of ``rule`` as ramps over ``inputs``; without those that never hold, or ramps that always do."""
    names = list(inputs)
    compiled = []
    for case in rule.cases:
        edges = [(names.index(atom.input), edge(atom, inputs[atom.input], rule.harm)) for atom in case]
        if NEVER not in [ends for _, ends in edges]:
            rising = [(i, *ends) for i, ends in edges if ends != ALWAYS]
            compiled.append([Ramp(i, zero, one - zero, knots) for i, zero, one, knots in rising])
    return compiled


Edge = tuple[float, float, Knots]
"""Foot, shoulder and knots."""
NEVER: Edge = (math.inf, math.inf, ())
ALWAYS: Edge = (-math.inf, -math.inf, ())


def edge(atom: Atom, spec: Input, harm: int) -> Edge:
    """The edge of the closure of the atom's set: toward risk, or toward calm in a rule for very_low.

    Of a set a <= b <= c <= d, "S or more" rises from a to b, "S or less" falls from c to d, and ``not`` takes the
    complement of the other one, so that every atom of a rule moves the same way with risk.
    """
    a, b, c, d, rise, fall = spec.shapes[atom.set]
    upward = (spec.risk == "rising") == (harm > 0)
    if atom.negated:
        found = (c, d, mirror_knots(fall)) if upward else (b, a, mirror_knots(rise))
        return found if found[0] != found[1] else NEVER
    found = (a, b, rise) if upward else (d, c, fall)
    return found if found[0] != found[1] else ALWAYS


def _slopes(ramps: list[Ramp]) -> tuple[_Slope, ...]:
    def way(number: int) -> tuple[int, bool]:
        return ramps[number].input, ramps[number].span > 0

    slopes = []
    for (i, rises), group in itertools.groupby(sorted(range(len(ramps)), key=way), key=way):
        ordered = sorted(group, key=lambda n: ramps[n].zero, reverse=not rises)
        slopes.append(
            _Slope(
                i, rises, ramps[ordered[0]].zero, tuple((n, ramps[n].zero, ramps[n].span) for n in ordered)
            )
        )
    return tuple(slopes)
