"""Does a rule for fear hold at every point? Decided exactly, for any number of inputs, without a grid.

Only for the method ``monotone``, where a rule that frightens keeps holding as risks rise (its degrees are ramps
toward risk), and a rule for very_low keeps holding as they fall. A point is silent when no case of any rule holds:

1. Each case of a calm rule must fail: one of its inputs lies at or beyond the foot of its ramp.
2. Choose such an input for each calm case. Of all points that fit the choice, one lies below all others: the inputs
   that were chosen at the farthest of their feet, all others calm. It is a vertex of the sets.
3. Frightening rules fail at a point only if they fail at every point below it. So if any point that fits the choice
   is silent, that vertex is.

Hence the rules speak everywhere if and only if they speak at the vertices of all choices. Of vertices, those above
another need not be asked (3), which keeps them few.
"""

from collections.abc import Iterator

from supervisor.rules.inference import FearRules
from supervisor.rules.monotone import Ramp, cases

Point = dict[str, float]

MOST_VERTICES = 1000  # a second of work; files that people write have a handful


def calmest(rules: FearRules) -> Point:
    """Every input at its least feared end."""
    return {name: spec.calmest for name, spec in rules.inputs.items()}


def worst(rules: FearRules) -> Point:
    """Every input at its most feared end."""
    return {name: spec.worst for name, spec in rules.inputs.items()}


def silent_point(rules: FearRules) -> Point | None:
    """A point at which no rule for fear holds, with as few risks as can be; None: there is none.

    Raises OverflowError when there are too many vertices to ask.
    """
    names = rules.names
    for vertex in _vertices(rules):
        point = dict(zip(names, vertex, strict=True))
        if not rules.fear_voice.method.strengths(list(vertex)):
            return point
    return None


def _vertices(rules: FearRules) -> Iterator[tuple[float, ...]]:
    """Where all calm rules have just fallen silent, with the least risk."""
    calm = [case for rule in rules.fear_voice.rules if rule.harm == 0 for case in cases(rule, rules.inputs)]
    signs = [1.0 if spec.risk == "rising" else -1.0 for spec in rules.inputs.values()]
    vertices = {tuple(calmest(rules).values())}
    for case in calm:  # a case that always holds has no ramps and leaves no vertex
        vertices = _lowest({_pushed(vertex, ramp, signs) for vertex in vertices for ramp in case}, signs)
        if len(vertices) > MOST_VERTICES:
            raise OverflowError(f"more than {MOST_VERTICES} ways for the rules for very_low to fail")
    yield from sorted(vertices)


def _pushed(vertex: tuple[float, ...], ramp: Ramp, signs: list[float]) -> tuple[float, ...]:
    """The lowest point above ``vertex`` at which ``ramp`` is 0."""
    i = ramp.input
    x = ramp.zero if signs[i] * ramp.zero > signs[i] * vertex[i] else vertex[i]
    return (*vertex[:i], x, *vertex[i + 1 :])


def _lowest(vertices: set[tuple[float, ...]], signs: list[float]) -> set[tuple[float, ...]]:
    """Without those that lie above another: at or beyond it in every risk."""
    risks = {tuple(s * x for s, x in zip(signs, v, strict=True)): v for v in vertices}
    kept: list[tuple[float, ...]] = []
    for risk in sorted(risks, key=sum):  # what lies below another has the smaller sum
        if not any(all(a <= b for a, b in zip(low, risk, strict=True)) for low in kept):
            kept.append(risk)
    return {risks[risk] for risk in kept}
