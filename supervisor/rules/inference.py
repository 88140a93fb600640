"""Fear and trust from named numbers: a closed-form fuzzy inference, compiled once and then a pure function.

Two methods turn the rules that fire into a number: `supervisor.rules.monotone`, the default, in which fear never
falls as a risk rises, and :class:`Mamdani`. In both, sets are those of scikit-fuzzy (``trimf``,
``trapmf``), and degrees are joined by min (and) and max (or). Each output, fear and the trust in every estimator,
has its own rules.

A missing, non-finite or impossible value counts as the worst end of its input's range and makes fear 1 by itself;
where no rule for fear fires, fear is 1 too. Trust is 1 where no rule lowers it.

scikit-fuzzy defines the sets, but only a file that uses its curved functions imports it, at load: the import takes
0.4 s. The tests compare the compiled sets, and Mamdani's method, with it.
"""

import itertools
import math
from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from supervisor.rules.monotone import Monotone, Strengths
from supervisor.rules.rule_file import FEAR, LEVELS, TRUST_PREFIX, Input, RuleFile, level_sets
from supervisor.rules.sentence import Rule, load_rules
from supervisor.rules.shapes import FuzzySet
from trepid.bounds import at_most
from trepid.causes import Cause
from trepid.messages import Mode


class Mamdani:
    """Mamdani's method: min, max, clipped sets of the output, centroid; equal to scikit-fuzzy's control system.

    Rules about one output, compiled. Immutable. For comparison only: the centroid is neither monotone in the risks
    nor able to reach 0 and 1 (Kouikoglou and Phillis, On the monotonicity of hierarchical sum-product fuzzy
    systems, 2009), so ``trepid fear check`` fails for it.

    scikit-fuzzy integrates over the points of a grid; here the integral is exact: between the places of two levels
    only their two sets differ from 0, and the outline max(min(p, 1 - s), min(q, s)) is straight between corners.
    """

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


Values = Mapping[str, float | None]
CALM = Cause.NONE
SILENT = "no rule speaks here"
SILENT_CAUSE = Cause.NO_RULE
DISTRUST_AT = (0.0, 0.25, 0.5, 0.75, 1.0)
"""1 - trust at the five levels, from trust very_high down: evenly spread, as the words are."""


class FearResult(NamedTuple):
    """Fear, its level, its cause and the rules that fired."""

    fear: float  # 0..1
    level: str
    cause: str
    texts: tuple[str, ...]  # of the rules that fired, strongest first ...
    strengths: tuple[float, ...]  # ... and how strongly


class Trust(NamedTuple):
    """Trust in one estimator, its cause and the rules that fired."""

    trust: float  # 0..1
    cause: str
    texts: tuple[str, ...]  # of the rules that fired, strongest first ...
    strengths: tuple[float, ...]  # ... and how strongly


Firing = tuple[float, int, int]
"""Strength, harm, and minus the index of a rule, so that tuples rank as rules do."""


class Voice:
    """The rules about one output, compiled. Immutable."""

    def __init__(
        self, file: RuleFile, rules: tuple[Rule, ...], at: tuple[float, ...], names: list[str]
    ) -> None:
        inputs = {name: file.inputs[name] for name in names}
        self.rules, self.inputs, self._at = rules, inputs, at
        self._texts = tuple(rule.text for rule in rules)
        self._harms = tuple(rule.harm for rule in rules)
        self._ends = [(name, *spec.range, spec.beyond == "end", spec.worst) for name, spec in inputs.items()]
        self.method = (Monotone if file.method == "monotone" else Mamdani)(rules, inputs, at)

    def complete(self, values: Values) -> tuple[list[float], list[str]]:
        """Every input within its range, and the names of those that have no possible value."""
        x, missing = [], []
        for name, low, high, ends, worst in self._ends:
            value = values.get(name)
            if value is not None and low <= value <= high:
                x.append(value)
            elif value is not None and ends and math.isfinite(value):
                x.append(low if value < low else high)
            else:
                missing.append(name)
                x.append(worst)
        return x, missing

    def rank_rules(self, strengths: Strengths) -> list[Firing]:
        """The rules that fire by strength and harm; of equals, the first in the file comes first."""
        harms = self._harms
        return sorted([(strength, harms[i], -i) for i, strength in strengths.items()], reverse=True)

    def report_rules(
        self, ranked: list[Firing], notes: list[str]
    ) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """The notes and the texts of the rules, and the strength of each."""
        texts, strengths = [self._texts[-i] for _, _, i in ranked], [fired[0] for fired in ranked]
        return (*notes, *texts), (*[1.0] * len(notes), *strengths)

    def decisive(self, ranked: list[Firing]) -> tuple[Rule, float]:
        """The rule that adds most to the output, of equals the first in the file; and how much."""
        most, first = 0.0, 1 - len(self.rules)
        for strength, harm, i in ranked:
            if strength < most:
                break  # none of the rest can add more
            part = strength * self._at[harm]
            if part > most or (part == most and i > first):
                most, first = part, i
        return self.rules[-first], most


class FearRules:
    """The compiled rule file. Immutable: evaluating changes nothing, so it can be shared freely."""

    def __init__(self, file: RuleFile, rules: tuple[Rule, ...]) -> None:
        self.file = file
        self.inputs: dict[str, Input] = dict(file.inputs)
        self.names = tuple(file.inputs)
        self.rules = rules
        self._at = tuple(action.at for action in file.fear.all)
        self._factors = tuple(action.speed_factor for action in file.fear.all)
        self._modes = tuple(action.mode for action in file.fear.all)
        self._borders = [(low + high) / 2 for low, high in itertools.pairwise(self._at)]
        self.fear_voice = Voice(file, _about(FEAR, rules), self._at, list(self.names))
        self.trust_voices = {name: _trust_voice(name, file, rules) for name in file.estimators}

    @property
    def causes(self) -> frozenset[str]:
        """Every cause that fear can have by these rules."""
        missing = {spec.missing for spec in self.inputs.values()}
        return frozenset(rule.cause for rule in self.fear_voice.rules) | missing

    @classmethod
    def load(cls, path: Path) -> "FearRules":
        """The rules in the file at ``path``, not yet verified. Raises InputError with file:line:column."""
        return cls(*load_rules(path))

    def evaluate(self, values: Values) -> FearResult:
        """Fear of ``values`` (unit as in the file). Where one is missing, None, NaN, inf, impossible, fear is 1."""
        voice = self.fear_voice
        x, missing = voice.complete(values)
        strengths = voice.method.strengths(x)
        ranked = voice.rank_rules(strengths)
        fear = 1.0 if missing or not ranked else voice.method.value(strengths)
        notes = [self._note(name, values) for name in missing] if missing else []
        texts, degrees = voice.report_rules(ranked, notes if ranked else [*notes, SILENT])
        return FearResult(fear, self.level(fear), self._cause(ranked, missing, fear), texts, degrees)

    def trust(self, values: Values) -> dict[str, Trust]:
        """Trust in every estimator of the file. Only the inputs of the trust rules are evaluated.

        A missing or impossible value counts as the worst, so more risk and less knowledge are never more trust.
        """
        return {name: self._trust(voice, values) for name, voice in self.trust_voices.items()}

    def memberships(self, values: Values) -> dict[str, dict[str, float]]:
        """Degrees of every input, and of fear itself, in their five sets (``skfuzzy.trimf``, ``trapmf``)."""
        x, _ = self.fear_voice.complete(values)
        degrees = {
            name: {level: shape.membership(value) for level, shape in spec.shapes.items()}
            for (name, spec), value in zip(self.inputs.items(), x, strict=True)
        }
        fear = self.evaluate(values).fear
        degrees[FEAR] = {level: shape.membership(fear) for level, shape in level_sets(self._at).items()}
        return degrees

    def level(self, fear: float) -> str:
        """The level nearest to ``fear``; of two, the higher one."""
        return LEVELS[self.level_index(fear)]

    def level_index(self, fear: float) -> int:
        """Index of that level in LEVELS."""
        return bisect_right(self._borders, fear)

    def mode(self, fear: float) -> Mode:
        """The mode of the level of ``fear``."""
        return self._modes[self.level_index(fear)]

    def speed_factor(self, fear: float) -> float:
        """Share of the cruise speed at ``fear``: interpolated between the levels, so it never rises with fear."""
        at, factors = self._at, self._factors
        k = 1
        while fear > at[k] and k < len(at) - 1:
            k += 1
        part = at_most((fear - at[k - 1]) / (at[k] - at[k - 1]), 1.0)
        return factors[k - 1] + part * (factors[k] - factors[k - 1])

    def _cause(self, ranked: list[Firing], missing: list[str], fear: float) -> str:
        """The cause of the rule that adds most to fear; that of the missing input, if the rule rests on one."""
        if self.level_index(fear) == 0:
            return CALM
        if not ranked:
            return self.inputs[missing[0]].missing if missing else SILENT_CAUSE
        rule, part = self.fear_voice.decisive(ranked)
        absent = [name for name in missing if name in rule.inputs] if missing else missing
        if not absent and part < 1:
            absent = missing  # no rule alone accounts for a fear of 1
        return self.inputs[absent[0]].missing if absent else rule.cause

    def _note(self, name: str, values: Values) -> str:
        """The note about an input without a possible value."""
        spec, value = self.inputs[name], values.get(name)
        if value is None or not math.isfinite(value):
            return f"missing {name}: taken as {spec.riskiest_set}"
        low, high = spec.range
        return f"impossible {name} {value:g}, not in {low:g}..{high:g}: taken as {spec.riskiest_set}"

    def _trust(self, voice: Voice, values: Values) -> Trust:
        x, missing = voice.complete(values)
        strengths = voice.method.strengths(x)
        ranked = voice.rank_rules(strengths)
        if not ranked:
            return TRUSTED
        texts, degrees = voice.report_rules(ranked, [self._note(name, values) for name in missing])
        rule, _ = voice.decisive(ranked)
        absent = [name for name in missing if name in rule.inputs]
        cause = self.inputs[absent[0]].missing if absent else rule.cause
        return Trust(1.0 - voice.method.value(strengths), cause, texts, degrees)


TRUSTED = Trust(1.0, CALM, (), ())


def _about(output: str, rules: tuple[Rule, ...]) -> tuple[Rule, ...]:
    return tuple(rule for rule in rules if rule.output == output)


def _trust_voice(estimator: str, file: RuleFile, rules: tuple[Rule, ...]) -> Voice:
    own = _about(TRUST_PREFIX + estimator, rules)
    spoken = frozenset().union(*(rule.inputs for rule in own))
    return Voice(file, own, DISTRUST_AT, [name for name in file.inputs if name in spoken])
