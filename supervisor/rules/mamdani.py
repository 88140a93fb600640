"""Mamdani's method: min, max, clipped sets of the output, centroid; equal to scikit-fuzzy's control system.

For comparison only. Its centroid is neither monotone in the risks nor able to reach 0 and 1 (Kouikoglou and
Phillis, On the monotonicity of hierarchical sum-product fuzzy systems, 2009), so ``trepid fear check`` fails
for it.

scikit-fuzzy integrates over the points of a grid; here the integral is exact: between the places of two levels
only their two sets differ from 0, and the outline max(min(p, 1 - s), min(q, s)) is straight between its corners.
"""

import itertools

from supervisor.rules.monotone import Strengths
from supervisor.rules.rule_file import LEVELS, Input
from supervisor.rules.sentence import Rule
from supervisor.rules.shapes import FuzzySet


class Mamdani:
    """Rules about one output, compiled. Immutable."""

    def __init__(self, rules: tuple[Rule, ...], inputs: dict[str, Input], at: tuple[float, ...]) -> None:
        names = list(inputs)
        sets = {name: spec.shapes for name, spec in inputs.items()}
        self._at, self._harms = at, tuple(rule.harm for rule in rules)
        self._weights = tuple(rule.weight for rule in rules)
        self._cases: list[list[list[tuple[int, FuzzySet, bool]]]] = [
            [[(names.index(a.input), sets[a.input][a.set], a.negated) for a in case] for case in rule.cases]
            for rule in rules
        ]

    def strengths(self, x: list[float]) -> Strengths:
        """Weight times the max over a rule's cases of the min over their atoms."""
        found: Strengths = {}
        for index, (weight, cases) in enumerate(zip(self._weights, self._cases, strict=True)):
            strength = weight * max(min(_degree(x[i], shape, no) for i, shape, no in case) for case in cases)
            if strength > 0:
                found[index] = strength
        return found

    def value(self, strengths: Strengths) -> float:
        """Centroid of the sets of the levels, each clipped at its rules' greatest strength."""
        truth = [0.0] * len(LEVELS)
        for rule, strength in strengths.items():
            truth[self._harms[rule]] = max(strength, truth[self._harms[rule]])
        return centroid(self._at, truth)


def _degree(x: float, shape: FuzzySet, negated: bool) -> float:
    degree = shape.membership(x)
    return 1 - degree if negated else degree


def centroid(at: tuple[float, ...], truth: list[float]) -> float:
    """∫ y μ(y) dy / ∫ μ(y) dy with μ(y) = max_k min(t_k, triangle_k(y)). One t_k must be above 0."""
    area, moment = 0.0, 0.0
    for (a, b), (p, q) in zip(itertools.pairwise(at), itertools.pairwise(truth), strict=True):
        corners = sorted({0.0, p, q, 1 - p, 1 - q, 0.5, 1.0})
        heights = [max(min(p, 1 - s), min(q, s)) for s in corners]
        places = [a + (b - a) * s for s in corners]
        for (y0, y1), (h0, h1) in zip(itertools.pairwise(places), itertools.pairwise(heights), strict=True):
            area += (y1 - y0) * (h0 + h1) / 2
            moment += (y1 - y0) * (h0 * (2 * y0 + y1) + h1 * (y0 + 2 * y1)) / 6
    return moment / area
