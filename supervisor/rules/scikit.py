"""A rule file as a control system of scikit-fuzzy, and the comparison of both: an independent oracle.

scikit-fuzzy computes "x is S" and not "S or worse", Mamdani's inference and the centroid on a grid. A rule file by
the method mamdani must therefore agree with it up to the grid; the method monotone must rank situations alike.
The control system gets the compiled sets, and the compiled sets are compared with scikit-fuzzy's functions by
themselves: Mamdani's centroid does not depend on the strength of a lone rule, so that a tail of degree 0.0001 would
count as much as a degree of 1.

Traps of scikit-fuzzy 0.5 that this module avoids: an output without a rule that fires is left out of the result
(read as None here); NaN becomes a calm 0.5 (only finite points are compared); the inputs stand on the shared
antecedents, so one simulation serves one thread; one compute takes 15 ms for 25 rules and more for larger files.
"""

import functools
import operator
from typing import Any, NamedTuple

import numpy as np
from skfuzzy import control

from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import Point, calmest
from supervisor.rules.rule_file import FEAR, Input, level_sets
from supervisor.rules.sentence import Rule
from supervisor.rules.shapes import FuzzySet, evaluate
from trepid.types import Column

PLACES = 501  # of a universe: the grid of scikit-fuzzy's centroid
MAX_RISKS = 4  # of the inputs at a sampled point are not calm


class Agreement(NamedTuple):
    """Difference between a rule file and scikit-fuzzy over sampled points."""

    points: int  # compared: those at which a rule of scikit-fuzzy fires
    greatest_difference: float  # of fear by the method of the file
    kendall_tau: float | None  # rank agreement, -1..1; None where all values are equal
    greatest_difference_mamdani: float  # of fear by the same sets and rules with the method mamdani
    greatest_difference_of_degrees: float  # of a compiled set to the function that it replaces


def compare(rules: FearRules, *, points: int, seed: int = 0) -> Agreement:
    """Fear of ``rules`` and of scikit-fuzzy at ``points`` sampled points."""
    from scipy.stats import kendalltau

    peer = simulation(rules, places=PLACES)
    mamdani = FearRules(rules.file.model_copy(update={"method": "mamdani"}), rules.rules)
    found = []
    for point in sample(rules, points, seed):
        fear = fear_of(peer, point)
        if fear is not None:
            found.append((fear, rules.evaluate(point).fear, mamdani.evaluate(point).fear))
    theirs, ours, same_method = np.array(found, dtype=np.float64).reshape(-1, 3).T
    tau = float(kendalltau(theirs, ours).statistic)
    return Agreement(
        len(found),
        float(np.abs(theirs - ours).max(initial=0.0)),
        None if np.isnan(tau) else tau,
        float(np.abs(theirs - same_method).max(initial=0.0)),
        max(_degree_difference(spec) for spec in rules.inputs.values()),
    )


def sample(rules: FearRules, count: int, seed: int) -> list[Point]:
    """The calmest point, and points at which one to four inputs lie anywhere between the corners of their sets."""
    rng = np.random.default_rng(seed)
    found = [calmest(rules)]
    while len(found) < count:
        chosen = rng.choice(
            rules.names, size=rng.integers(1, min(MAX_RISKS, len(rules.names)) + 1), replace=False
        )
        moved = {str(name): _between_corners(rules.inputs[str(name)], rng) for name in chosen}
        found.append({**calmest(rules), **moved})
    return found


def _between_corners(spec: Input, rng: np.random.Generator) -> float:
    corners = {x for shape in spec.shapes.values() for x in shape[:4] if spec.range[0] <= x <= spec.range[1]}
    k = int(rng.integers(len(corners) - 1))
    low, high = sorted(corners)[k : k + 2]
    return float(rng.uniform(low, high))


def simulation(rules: FearRules, *, places: int = 101) -> Any:
    """A ControlSystemSimulation of the rules for fear; ``places`` points in the universe of every variable.

    The corners of the sets are added to each universe, because scikit-fuzzy interpolates between its points.
    """
    inputs = {
        name: _variable(control.Antecedent, name, spec.range, spec.shapes, places)
        for name, spec in rules.inputs.items()
    }
    levels = level_sets(tuple(action.at for action in rules.file.fear.all))
    fear = _variable(control.Consequent, FEAR, (0.0, 1.0), levels, places)
    stated = [_rule(rule, inputs, fear) for rule in rules.fear_voice.rules]
    return control.ControlSystemSimulation(control.ControlSystem(stated))


def fear_of(simulated: Any, point: Point) -> float | None:
    """Fear at ``point`` [0..1] by scikit-fuzzy; None where no rule fires, for which it leaves the output out.

    An input that only ``trust_`` rules use is no antecedent of the control system, which raises for its value.
    """
    used = {antecedent.label for antecedent in simulated.ctrl.antecedents}
    simulated.inputs({name: x for name, x in point.items() if name in used})
    simulated.compute()
    fear = simulated.output.get(FEAR)
    return None if fear is None else float(fear)


def stated_degrees(spec: Input, level: str, x: Column) -> Column:
    """Degrees of a set at ``x``, shape (n,), by scikit-fuzzy's own function, not by the compiled lines."""
    stated = getattr(spec.sets, level)
    if isinstance(stated, tuple):
        return evaluate("trapmf", spec.shapes[level][:4], x)
    if stated.function == "polyline":
        return _degrees(spec.shapes[level], x)
    return evaluate(stated.function, stated.parameters, x)


def _degree_difference(spec: Input) -> float:
    x = np.linspace(*spec.range, 1001)
    compiled = {level: _degrees(shape, x) for level, shape in spec.shapes.items()}
    return max(float(np.abs(stated_degrees(spec, level, x) - y).max()) for level, y in compiled.items())


def _degrees(shape: FuzzySet, x: Column) -> Column:
    return np.array([shape.membership(value) for value in x.tolist()])


def _variable(
    kind: Any, name: str, ends: tuple[float, float], shapes: dict[str, FuzzySet], places: int
) -> Any:
    corners = [x for shape in shapes.values() for x, _ in shape.corners() if ends[0] <= x <= ends[1]]
    universe = np.union1d(np.linspace(*ends, places), corners)
    variable = kind(universe, name)
    for level, shape in shapes.items():
        variable[level] = _degrees(shape, universe)
    return variable


def _rule(rule: Rule, inputs: dict[str, Any], fear: Any) -> Any:
    cases = []
    for case in rule.cases:
        terms = [inputs[atom.input][atom.set] for atom in case]
        signed = [~term if atom.negated else term for term, atom in zip(terms, case, strict=True)]
        cases.append(functools.reduce(operator.and_, signed))
    then = list(fear.terms.values())[rule.level]
    return control.Rule(functools.reduce(operator.or_, cases), then % rule.weight)
