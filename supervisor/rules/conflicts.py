"""Rules without effect because of another rule: contradictions and repetitions. For the method ``monotone``.

Rule A has no effect if a rule B about the same output is at least as strong at every point and has at least the
same consequence. That is so if every case of A is a special case of one of B: each ramp of B's case has a ramp of
A's on the same input that rises no earlier.
"""

import itertools
from collections.abc import Iterator

from supervisor.rules.inference import FearRules
from supervisor.rules.monotone import Ramp, cases
from supervisor.rules.sentence import Rule


def contradictions(rules: FearRules) -> Iterator[tuple[Rule, Rule]]:
    """(A, B): A has a lesser consequence than B, which is at least as strong at every point, so A has no effect."""
    return ((a, b) for a, b in _void(rules) if a.harm < b.harm)


def repetitions(rules: FearRules) -> Iterator[tuple[Rule, Rule]]:
    """(A, B): B has the same consequence and cause as A and is at least as strong at every point."""
    return ((a, b) for a, b in _void(rules) if a.harm == b.harm and a.cause == b.cause)


def _void(rules: FearRules) -> Iterator[tuple[Rule, Rule]]:
    compiled = [(rule, cases(rule, rules.inputs)) for rule in rules.rules if rule.harm]
    for (a, of_a), (b, of_b) in itertools.permutations(compiled, 2):
        outdone = a.output == b.output and a.harm <= b.harm and a.weight <= b.weight
        if outdone and all(any(_special(case, other) for other in of_b) for case in of_a):
            yield a, b


def _special(case: list[Ramp], of: list[Ramp]) -> bool:
    """Whether the degree of ``case`` is at no point above that of ``of``."""
    return all(any(_no_earlier(ramp, other) for ramp in case) for other in of)


def _no_earlier(ramp: Ramp, other: Ramp) -> bool:
    if ramp.input != other.input:
        return False
    if ramp.knots or other.knots:
        corners = [x for each in (ramp, other) for piece in each.pieces() for x in piece[:2]]
        return all(ramp.degree(x) <= other.degree(x) for x in corners)
    sign = 1 if other.span > 0 else -1
    return sign * ramp.zero >= sign * other.zero and sign * sum(ramp[1:3]) >= sign * sum(other[1:3])
