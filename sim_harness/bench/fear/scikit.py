"""A rule file as a control system of scikit-fuzzy: the peer of the engine, and the oracle of its method mamdani."""

import functools
import operator
from typing import Any

import numpy as np
from skfuzzy import control

from supervisor.rules.inference import FearRules
from supervisor.rules.membership import fuzzy_sets, level_sets
from supervisor.rules.rule_file import FEAR
from supervisor.rules.sentence import Rule
from supervisor.rules.shapes import FuzzySet


def simulation(rules: FearRules, *, places: int = 101) -> Any:
    """A ControlSystemSimulation of the rules for fear; ``places`` points in the universe of every variable.

    The corners of the sets are added to each universe, because scikit-fuzzy interpolates between its points. What
    it computes is "x is S" and not "S or worse", as in the method mamdani.
    """
    inputs = {}
    for name, spec in rules.inputs.items():
        shapes = fuzzy_sets(spec)
        inputs[name] = _variable(control.Antecedent, name, spec.range, shapes, places)
    at = tuple(action.at for action in rules.file.fear.all)
    fear = _variable(control.Consequent, FEAR, (0.0, 1.0), level_sets(at), places)
    stated = [_rule(rule, inputs, fear) for rule in rules.fear_voice.rules]
    return control.ControlSystemSimulation(control.ControlSystem(stated))


def fear_of(simulated: Any, point: dict[str, float]) -> float | None:
    """Fear at ``point`` [0..1] by scikit-fuzzy; None where no rule speaks, for which it leaves the output out."""
    simulated.inputs(point)
    simulated.compute()
    fear = simulated.output.get(FEAR)
    return None if fear is None else float(fear)


def _variable(
    kind: Any, name: str, ends: tuple[float, float], shapes: dict[str, FuzzySet], places: int
) -> Any:
    corners = [x for shape in shapes.values() for x, _ in shape.corners()]
    variable = kind(np.union1d(np.linspace(*ends, places), corners), name)
    for level, shape in shapes.items():
        variable[level] = np.array([shape.membership(x) for x in variable.universe])
    return variable


def _rule(rule: Rule, inputs: dict[str, Any], fear: Any) -> Any:
    cases = []
    for case in rule.cases:
        terms = [inputs[atom.input][atom.set] for atom in case]
        signed = [~term if atom.negated else term for term, atom in zip(terms, case, strict=True)]
        cases.append(functools.reduce(operator.and_, signed))
    then = list(fear.terms.values())[rule.level]
    return control.Rule(functools.reduce(operator.or_, cases), then % rule.weight)
