"""What a rule file must keep at every point, tried on many: it speaks, is monotone, and reaches 0 and 1.

Monotony holds by construction wherever a rule fires (see :mod:`supervisor.inference`); a hole in the rules is
where it breaks, and holes are what the points look for: the corners of the sets of every pair of inputs with the
rest calm, and random points of a fixed seed.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from skfuzzy.membership import trapmf, trimf

from supervisor.inference import SILENT, FearRules
from supervisor.membership import Trapezoid
from supervisor.rules import LEVELS, Input

Point = dict[str, float]

_TOLERANCE = 1e-12  # of the sum of five products


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a check found."""

    points: int  # tried
    problems: tuple[str, ...]  # empty: the rules may drive


def verify(rules: FearRules, *, random_points: int = 120, seed: int = 0) -> Verdict:
    """Check ``rules`` for holes, monotony, reach, missing inputs and idle parts."""
    scattered = list(_random_points(rules, random_points, seed))
    points = [*_pair_points(rules), *scattered]
    problems = [
        *_idle_parts(rules),
        *_wrong_sets(rules),
        *_reach(rules),
        *itertools.islice(_holes(rules, points), 1),
        *itertools.islice(_rises_and_falls(rules, scattered), 1),
    ]
    return Verdict(len(points), tuple(problems))


def calmest(rules: FearRules) -> Point:
    """Every input at its least feared end."""
    return {name: spec.calmest for name, spec in rules.inputs.items()}


def worst(rules: FearRules) -> Point:
    """Every input at its most feared end."""
    return {name: spec.worst for name, spec in rules.inputs.items()}


def knots(spec: Input) -> list[float]:
    """Every corner of the sets of an input and the middles between, from calm to risk."""
    corners = sorted({x for level in LEVELS for x in spec.sets.trapezoid(level)})
    middles = [(a + b) / 2 for a, b in itertools.pairwise(corners)]
    return sorted([*corners, *middles], reverse=spec.risk == "falling")


def _pair_points(rules: FearRules) -> Iterator[Point]:
    calm = calmest(rules)
    for one, other in itertools.combinations(rules.names, 2):
        for x, y in itertools.product(knots(rules.inputs[one])[::2], knots(rules.inputs[other])[::2]):
            yield {**calm, one: x, other: y}


def _random_points(rules: FearRules, count: int, seed: int) -> Iterator[Point]:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield {name: float(rng.choice(knots(spec))) for name, spec in rules.inputs.items()}


def _holes(rules: FearRules, points: list[Point]) -> Iterator[str]:
    for point in points:
        if any(fired.text == SILENT for fired in rules.evaluate(point).rules):
            yield f"no rule speaks at {_told(rules, point)}"


def _rises_and_falls(rules: FearRules, points: list[Point]) -> Iterator[str]:
    """Along every input through ``points``: fear must not fall towards risk, nor when the input is lost."""
    for point, (name, spec) in itertools.product(points, rules.inputs.items()):
        before = -math.inf
        for x in (*knots(spec)[::2], None):
            fear = rules.evaluate({**point, name: x}).fear
            if fear < before - _TOLERANCE:
                to = "missing" if x is None else f"{x:g}"
                place = _told(rules, point)
                yield f"fear falls from {before:.3f} to {fear:.3f} as {name} worsens to {to} at {place}"
            before = fear


def _reach(rules: FearRules) -> Iterator[str]:
    for name, point, expected in (("calmest", calmest(rules), 0.0), ("worst", worst(rules), 1.0)):
        fear = rules.evaluate(point).fear
        if fear != expected:
            yield f"with every input at its {name} fear is {fear:.3f}, expected exactly {expected:g}"


def _idle_parts(rules: FearRules) -> Iterator[str]:
    spoken = {atom.input for rule in rules.rules for case in rule.cases for atom in case}
    yield from (f"no rule speaks of {name}" for name in rules.names if name not in spoken)
    extremes = [rules.evaluate(point) for point in (calmest(rules), worst(rules))]
    fired = {fired.text for extreme in extremes for fired in extreme.rules}
    yield from (f"never fires: {rule.text}" for rule in rules.rules if rule.text not in fired)
    calm = {fired.text for fired in extremes[0].rules}
    yield from (f"always fires: {rule.text}" for rule in rules.rules if rule.level and rule.text in calm)


def _wrong_sets(rules: FearRules) -> Iterator[str]:
    """Compiled sets against scikit-fuzzy, whose definitions the points of the file follow."""
    for name, spec in rules.inputs.items():
        x = np.linspace(*spec.range, 501)
        for level in LEVELS:
            points = getattr(spec.sets, level)
            expected = trapmf(x, points) if len(points) == 4 else trimf(x, points)
            shape = Trapezoid(*spec.sets.trapezoid(level))
            if not np.allclose([shape.membership(float(v)) for v in x], expected, atol=1e-9):
                yield f"{name} {level} differs from scikit-fuzzy"


def _told(rules: FearRules, point: Point) -> str:
    """The point as the inputs that are not calm."""
    apart = [f"{name}={x:g}" for name, x in point.items() if x != rules.inputs[name].calmest]
    if not apart:
        return "the calmest point"
    return " ".join(apart) + ("" if len(apart) == len(point) else ", the rest calm")
