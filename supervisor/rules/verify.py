"""Checks of a rule file before it is used for driving.

=================  ===========================================================================================
coverage           a rule for fear fires at every point: decided exactly by :mod:`supervisor.rules.proofs`
monotone           by construction of :mod:`supervisor.rules.monotone`, wherever a rule fires
reaches 0 and 1    at the calmest and at the worst point, which bound all others because fear is monotone
missing inputs     a missing input makes fear 1: by construction, and evaluated for each input
no idle rules      every input has a rule; every rule fires somewhere, none everywhere, none against another
=================  ===========================================================================================

Mamdani's method has none of the first three properties: it is evaluated at many points, and the first failures are
reported.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from supervisor.rules.inference import SILENT, FearRules
from supervisor.rules.monotone import ALWAYS, NEVER, Edge, cases, edge
from supervisor.rules.proofs import (
    Point,
    calmest,
    contradictions,
    lipschitz,
    repetitions,
    silent_point,
    worst,
)
from supervisor.rules.rule_file import Input
from supervisor.rules.sentence import Rule
from trepid import config
from trepid.config import InputError

_TRIED, _SEED = 120, 0  # points of the checks of Mamdani's method


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a check."""

    problems: tuple[str, ...]  # empty: the rules are fit to drive
    notes: tuple[str, ...]  # not errors
    slopes: dict[str, float]  # greatest change of fear per unit of every input; empty for Mamdani's method


def verify(rules: FearRules) -> Verdict:
    """Check ``rules`` for holes, monotony, reach, missing inputs and idle or void parts."""
    if rules.file.method == "mamdani":
        return Verdict((*_unused_names(rules), *_sampled_failures(rules)), (), {})
    problems = [*_unused_names(rules), *_idle(rules), *_reach(rules), *_lost(rules), *_silent(rules)]
    problems += [
        f"contradicts {_quote_rule(b)}, which counts instead: {a.text}" for a, b in contradictions(rules)
    ]
    notes = [*_idle_conditions(rules)]
    notes += [f"adds nothing to {_quote_rule(b)}: {a.text}" for a, b in repetitions(rules)]
    return Verdict(tuple(problems), tuple(notes), lipschitz(rules))


def load_verified(path: Path) -> FearRules:
    """The rules in the file at ``path``, fit to drive. Raises InputError with the first thing that is wrong."""
    return _verify(config.FileText(config.read_text(path), path))


@lru_cache(maxsize=16)
def _verify(file: config.FileText) -> FearRules:
    """Cached by content, because every run of a sweep loads the same rules."""
    path = file.path
    rules = FearRules.load(path)
    problems = verify(rules).problems
    if problems:
        more = f" (and {len(problems) - 1} more: see `trepid fear check`)" if len(problems) > 1 else ""
        raise InputError(f"{path}:{place(path, problems[0], rules)}: {problems[0]}{more}")
    return rules


def place(path: Path, problem: str, rules: FearRules) -> str:
    """line:column of the rule that ``problem`` names, else of the rules as a whole."""
    named = [i for i, rule in enumerate(rules.rules) if problem.endswith(rule.text)]
    line, column = config.position(config.read(path), ("rules", *named[:1]))
    return f"{line}:{column}"


def _quote_rule(rule: Rule) -> str:
    return f"'{rule.text}'"


def _silent(rules: FearRules) -> Iterator[str]:
    try:
        point = silent_point(rules)
    except OverflowError as error:
        yield f"coverage cannot be proven: {error}"
        return
    if point is not None:
        yield f"no rule fires at {_point_text(rules, point)}"


def _reach(rules: FearRules) -> Iterator[str]:
    for name, point, expected in (("calmest", calmest(rules), 0.0), ("worst", worst(rules), 1.0)):
        result = rules.evaluate(point)
        if result.fear != expected:
            yield f"with every input at its {name} fear is {result.fear:.3f}, expected exactly {expected:g}"


def _lost(rules: FearRules) -> Iterator[str]:
    calm = calmest(rules)
    for name in rules.names:
        if rules.evaluate({**calm, name: None}).fear != 1:
            yield f"fear is not 1 when {name} is missing"


def _unused_names(rules: FearRules) -> Iterator[str]:
    named = frozenset().union(*(rule.inputs for rule in rules.rules))
    yield from (f"no rule contains {name}" for name in rules.names if name not in named)
    silent = [name for name, voice in rules.trust_voices.items() if not voice.rules]
    yield from (f"no rule sets the trust in {name}" for name in silent)


def _idle(rules: FearRules) -> Iterator[str]:
    """Rules that never fire, and rules that always fire, also at the calmest point."""
    calm = calmest(rules)
    for rule in rules.rules:
        compiled = cases(rule, rules.inputs)
        if not compiled:
            yield f"never fires: {rule.text}"
        elif [] in compiled or (rule.harm and _holds(rule, rules, calm)):
            yield f"always fires: {rule.text}"


def _idle_conditions(rules: FearRules) -> Iterator[str]:
    """Conditions that change nothing: one on the same input implies them, or they always hold."""
    for rule in rules.rules:
        for case in rule.cases:
            edges = [edge(atom, rules.inputs[atom.input], rule.harm) for atom in case]
            for atom, ends in zip(case, edges, strict=True):
                implied = any(
                    other.input == atom.input
                    and (other.set, other.negated) != (atom.set, atom.negated)
                    and _implies(found, ends)
                    for other, found in zip(case, edges, strict=True)
                )
                if implied or ends == ALWAYS:
                    said = f"{atom.input} is {'not ' * atom.negated}{atom.set}"
                    yield f"the condition '{said}' changes nothing: {rule.text}"


def _implies(edge_: Edge, other: Edge) -> bool:
    """Whether the degree of a straight ``edge_`` is at no point above that of ``other``."""
    (foot, shoulder, knots), (foot_of, shoulder_of, knots_of) = edge_, other
    if knots or knots_of or NEVER in (edge_, other) or ALWAYS in (edge_, other):
        return False
    rises = foot < shoulder
    return (
        foot >= foot_of and shoulder >= shoulder_of if rises else foot <= foot_of and shoulder <= shoulder_of
    )


def _holds(rule: Rule, rules: FearRules, point: Point) -> bool:
    x = [point[name] for name in rules.names]
    ramps = cases(rule, rules.inputs)
    return any(all((x[ramp.input] - ramp.zero) / ramp.span > 0 for ramp in case) for case in ramps)


def _sampled_failures(rules: FearRules) -> Iterator[str]:
    """Failures of Mamdani's method: reach, first point without a rule, first fall of fear, on samples."""
    yield from _reach(rules)
    points = list(_points(rules))
    yield from itertools.islice(_holes(rules, points), 1)
    yield from itertools.islice(_falls(rules, points), 1)


def _points(rules: FearRules) -> Iterator[Point]:
    rng = np.random.default_rng(_SEED)
    for _ in range(_TRIED):
        yield {name: float(rng.choice(knots(spec))) for name, spec in rules.inputs.items()}


def knots(spec: Input) -> list[float]:
    """Every corner of the sets of an input and the middles between, from calm to risk."""
    corners = sorted({x for shape in spec.shapes.values() for x, _ in shape.corners()})
    middles = [(a + b) / 2 for a, b in itertools.pairwise(corners)]
    return sorted([*corners, *middles], reverse=spec.risk == "falling")


def _holes(rules: FearRules, points: list[Point]) -> Iterator[str]:
    for point in points:
        if SILENT in rules.evaluate(point).texts:
            yield f"no rule fires at {_point_text(rules, point)}"


def _falls(rules: FearRules, points: list[Point]) -> Iterator[str]:
    for point, (name, spec) in itertools.product(points, rules.inputs.items()):
        before = -math.inf
        for x in knots(spec):
            fear = rules.evaluate({**point, name: x}).fear
            if fear < before:
                where = _point_text(rules, point)
                yield f"fear falls from {before:.3f} to {fear:.3f} as {name} worsens to {x:g} at {where}"
            before = fear


def _point_text(rules: FearRules, point: Point) -> str:
    """The inputs of a point that are not calm, as text."""
    apart = [f"{name}={x:g}" for name, x in point.items() if x != rules.inputs[name].calmest]
    if not apart:
        return "the calmest point"
    return " ".join(apart) + ("" if len(apart) == len(point) else ", the rest calm")
