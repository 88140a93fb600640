"""Fuzzy sets: trapezoids, with scikit-fuzzy's meaning of their points."""

from typing import NamedTuple

from supervisor.rules.rule_file import LEVELS, Input


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


def trapezoids(spec: Input) -> dict[str, Trapezoid]:
    """The five sets of an input by name."""
    return {level: Trapezoid(*spec.sets.trapezoid(level)) for level in LEVELS}


def level_sets(at: tuple[float, ...]) -> dict[str, Trapezoid]:
    """The five sets of an output: triangles on its places ``at``, down to 0 at the neighbours'."""
    last = len(at) - 1
    return {
        name: Trapezoid(at[max(k - 1, 0)], at[k], at[k], at[min(k + 1, last)])
        for k, name in enumerate(LEVELS)
    }
