"""Coverage: whether a rule for fear fires at every point. Exact, for any number of inputs, without a grid.

Only for the method ``monotone``, where a rule for more than very_low keeps firing as risks rise (its degrees are
ramps toward risk), and a rule for very_low keeps firing as they fall. A point is silent when no rule fires:

1. Each case of a calm rule must fail: one of its inputs lies at or beyond the foot of its ramp.
2. Choose such an input for each calm case. Of all points that fit the choice, one lies below all others: the chosen
   inputs at the farthest of their feet, all others calm. It is a vertex of the sets.
3. The other rules fail at a point only if they fail at every point below it. So if any point that fits the choice
   is silent, that vertex is.

Hence a rule fires everywhere if and only if one fires at the vertices of all choices. Vertices above another one
need no evaluation (3), which keeps them few.
"""

from collections.abc import Iterator

from supervisor.rules.inference import FearRules
from supervisor.rules.monotone import Ramp, cases

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
        vertices = _lowest({_pushed(vertex, ramp, signs) for vertex in vertices for ramp in case}, signs)
        if len(vertices) > MAX_VERTICES:
            raise OverflowError(f"more than {MAX_VERTICES} ways for the rules for very_low to fail")
    yield from sorted(vertices)


def _pushed(vertex: tuple[float, ...], ramp: Ramp, signs: list[float]) -> tuple[float, ...]:
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
