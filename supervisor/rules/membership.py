"""The fuzzy sets of inputs and outputs by name."""

from supervisor.rules.rule_file import LEVELS, Input
from supervisor.rules.shapes import FuzzySet


def fuzzy_sets(spec: Input) -> dict[str, FuzzySet]:
    """The five sets of an input by name, compiled."""
    return {level: spec.shape(level) for level in LEVELS}


def level_sets(at: tuple[float, ...]) -> dict[str, FuzzySet]:
    """The five sets of an output: triangles at the positions ``at``, 0 at the positions of their neighbours."""
    last = len(at) - 1
    return {
        name: FuzzySet(at[max(k - 1, 0)], at[k], at[k], at[min(k + 1, last)]) for k, name in enumerate(LEVELS)
    }
