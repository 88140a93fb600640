"""Proofs about rules of the method ``monotone``: exact, for any number of inputs, without a grid.

**Coverage**: whether a rule for fear fires at every point. A rule for more than very_low keeps firing as risks rise
(its degrees are ramps toward risk), and a rule for very_low keeps firing as they fall. A point is silent when no
rule fires:

1. Each case of a calm rule must fail: one of its inputs lies at or beyond the foot of its ramp.
2. Choose such an input for each calm case. Of all points that fit the choice, one lies below all others: the chosen
   inputs at the farthest of their feet, all others calm. It is a vertex of the sets.
3. The other rules fail at a point only if they fail at every point below it. So if any point that fits the choice
   is silent, that vertex is.

Hence a rule fires everywhere if and only if one fires at the vertices of all choices. Vertices above another one
need no evaluation (3), which keeps them few.

**Conflicts**: rule A has no effect if a rule B about the same output is at least as strong at every point and has
at least the same consequence. That is so if every case of A is a special case of one of B: each ramp of B's case
has a ramp of A's on the same input that rises no earlier.

**Slopes**: a Lipschitz bound for every input. With fear = sum_k (a_k - a_{k-1}) t_k, and t_k a max of mins of
weighted ramps, no t_k changes faster with an input than the steepest ramp, times weight, that a rule for level k or
more has on the piece of the range that contains the input; so

    |dfear/dx_i| <= max over pieces of sum_k (a_k - a_{k-1}) * max over ramps w / |span|.
"""

import itertools
from collections.abc import Iterator

from supervisor.rules.inference import FearRules
from supervisor.rules.monotone import Ramp, cases
from supervisor.rules.sentence import Rule

Point = dict[str, float]

MAX_VERTICES = 1000  # takes a second; usual files have a handful


def calmest(rules: FearRules) -> Point:
    """Every input at the end of its range with the least risk."""
    return {name: spec.calmest for name, spec in rules.inputs.items()}


def worst(rules: FearRules) -> Point:
    """Every input at the end of its range with the greatest risk."""
    return {name: spec.worst for name, spec in rules.inputs.items()}


def silent_point(rules: FearRules) -> Point | None:
    """A point of least risk at which no rule for fear fires; None: there is none.

    Raises OverflowError above MAX_VERTICES vertices.
    """
    names = rules.names
    for vertex in _vertices(rules):
        point = dict(zip(names, vertex, strict=True))
        if not rules.fear_voice.method.strengths(list(vertex)):
            return point
    return None


def _vertices(rules: FearRules) -> Iterator[tuple[float, ...]]:
    """The points of least risk at which no rule for very_low fires."""
    calm = [case for rule in rules.fear_voice.rules if rule.harm == 0 for case in cases(rule, rules.inputs)]
    signs = [1.0 if spec.risk == "rising" else -1.0 for spec in rules.inputs.values()]
    vertices = {tuple(calmest(rules).values())}
    for case in calm:  # a case that always fires has no ramps and leaves no vertex
        vertices = _lowest({_push_vertex(vertex, ramp, signs) for vertex in vertices for ramp in case}, signs)
        if len(vertices) > MAX_VERTICES:
            raise OverflowError(f"more than {MAX_VERTICES} ways for the rules for very_low to fail")
    yield from sorted(vertices)


def _push_vertex(vertex: tuple[float, ...], ramp: Ramp, signs: list[float]) -> tuple[float, ...]:
    """The lowest point above ``vertex`` at which ``ramp`` is 0."""
    i = ramp.input
    x = ramp.zero if signs[i] * ramp.zero > signs[i] * vertex[i] else vertex[i]
    return (*vertex[:i], x, *vertex[i + 1 :])


def _lowest(vertices: set[tuple[float, ...]], signs: list[float]) -> set[tuple[float, ...]]:
    """``vertices`` without those that lie above another one: at or beyond it in every risk."""
    risks = {tuple(s * x for s, x in zip(signs, v, strict=True)): v for v in vertices}
    kept: list[tuple[float, ...]] = []
    for risk in sorted(risks, key=sum):  # a vertex below another one has the smaller sum
        if not any(all(a <= b for a, b in zip(low, risk, strict=True)) for low in kept):
            kept.append(risk)
    return {risks[risk] for risk in kept}


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
        if of_a and outdone and all(any(_special(case, other) for other in of_b) for case in of_a):
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


def lipschitz(rules: FearRules) -> dict[str, float]:
    """Greatest change of fear per unit of every input."""
    ramps: list[list[tuple[int, float, Ramp]]] = [[] for _ in rules.names]  # harm, weight, ramp
    for rule in rules.fear_voice.rules:
        for case in cases(rule, rules.inputs) if rule.harm else ():
            for ramp in case:
                ramps[ramp.input].append((rule.harm, rule.weight, ramp))
    places = [action.at for action in rules.file.fear.all]
    steps = [b - a for a, b in itertools.pairwise(places)]
    return {name: _steepest(own, steps) for name, own in zip(rules.names, ramps, strict=True)}


def _steepest(ramps: list[tuple[int, float, Ramp]], steps: list[float]) -> float:
    corners = sorted({x for _, _, ramp in ramps for piece in ramp.pieces() for x in piece[:2]})
    middles = [(a + b) / 2 for a, b in itertools.pairwise(corners)]
    return max((_slope(ramps, steps, x) for x in middles), default=0.0)


def _slope(ramps: list[tuple[int, float, Ramp]], steps: list[float], x: float) -> float:
    here = [
        (harm, weight * slope)
        for harm, weight, ramp in ramps
        for low, high, slope in ramp.pieces()
        if min(low, high) < x < max(low, high)
    ]
    return sum(
        step * max((slope for harm, slope in here if harm >= level), default=0.0)
        for level, step in enumerate(steps, start=1)
    )
