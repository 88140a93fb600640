"""The rule file: inputs with five named sets each, rules as sentences, and what to do at each level of fear.

A rule is a sentence::

    if EXPRESSION then fear is LEVEL [with weight W] [because CAUSE]

EXPRESSION joins ``input is [not] set`` by ``and``, ``or``, ``not`` and parentheses. Sets are given by the points of
scikit-fuzzy's ``trimf`` (three) or ``trapmf`` (four).
"""

import difflib
import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from trepid import config
from trepid.config import InputError, Settings
from trepid.messages import Mode

LEVELS = ("very_low", "low", "medium", "high", "very_high")
"""The five intensities, of every input and of fear itself (inventory F02)."""

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Points = tuple[float, ...]
Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0)]
KEYWORDS = frozenset({"if", "then", "and", "or", "not", "is", "with", "weight", "because", "fear"})


class Sets(Settings):
    """The five fuzzy sets of an input as the points of trimf (3) or trapmf (4), in order of the input's value."""

    very_low: Points
    low: Points
    medium: Points
    high: Points
    very_high: Points

    @field_validator("*")
    @classmethod
    def _is_a_shape(cls, points: Points) -> Points:
        if len(points) not in (3, 4):
            raise ValueError(f"expected 3 points (triangle) or 4 (trapezoid), got {len(points)}")
        if list(points) != sorted(points):
            raise ValueError(f"the points must not fall, got {list(points)}")
        return points

    def trapezoid(self, level: str) -> tuple[float, float, float, float]:
        """Feet and shoulders a <= b <= c <= d of a set; a triangle has b = c."""
        points = getattr(self, level)
        return points if len(points) == 4 else (points[0], points[1], points[1], points[2])


class Input(Settings):
    """One thing that is feared."""

    meaning: str
    unit: str
    range: tuple[float, float]  # values beyond it count as its ends
    risk: Literal["rising", "falling"]  # which way it gets worse
    missing: Name = "missing_data"  # the cause when there is no value
    sets: Sets

    @property
    def worst(self) -> float:
        """The end of the range that is feared most."""
        return self.range[1] if self.risk == "rising" else self.range[0]

    @property
    def calmest(self) -> float:
        """The end of the range that is feared least."""
        return self.range[0] if self.risk == "rising" else self.range[1]

    @property
    def riskiest_set(self) -> str:
        """Name of the set at the worst end."""
        return LEVELS[-1] if self.risk == "rising" else LEVELS[0]

    @model_validator(mode="after")
    def _sets_cover_the_range_in_order(self) -> "Input":
        low, high = self.range
        if not low < high:
            raise ValueError(f"range must rise, got {list(self.range)}")
        shapes = [self.sets.trapezoid(level) for level in LEVELS]
        if shapes[0][:2] != (low, low):
            raise ValueError(f"very_low must start as a shoulder at {low}: [{low}, {low}, ...]")
        if shapes[-1][2:] != (high, high):
            raise ValueError(f"very_high must end as a shoulder at {high}: [..., {high}, {high}]")
        for (name, left), (next_name, right) in itertools.pairwise(zip(LEVELS, shapes, strict=True)):
            _check_neighbours(name, left, next_name, right)
        return self


def _check_neighbours(name: str, left: Points, next_name: str, right: Points) -> None:
    if right[0] >= left[3]:
        raise ValueError(f"{name} and {next_name} leave a gap: they must overlap")
    if right[1] <= left[1] or right[2] <= left[2] or right[0] < left[0] or right[3] < left[3]:
        raise ValueError(f"{name} and {next_name} are not in order")
    if left[2] == left[3] or right[0] == right[1]:
        raise ValueError(f"between {name} and {next_name} an edge is vertical: fear would jump")


class Action(Settings):
    """What one level of fear means: where it stands on 0..1, how fast to drive, in which mode."""

    at: Share
    speed_factor: Share
    mode: Literal[Mode.KEEP, Mode.CAUTION, Mode.STOP]


class Actions(Settings):
    """The five levels of fear."""

    very_low: Action
    low: Action
    medium: Action
    high: Action
    very_high: Action

    @property
    def all(self) -> tuple[Action, ...]:
        """In rising order of fear."""
        return tuple(getattr(self, level) for level in LEVELS)

    @model_validator(mode="after")
    def _more_fear_is_never_faster(self) -> "Actions":
        order = (Mode.KEEP, Mode.CAUTION, Mode.STOP)
        if self.very_low.at != 0 or self.very_high.at != 1:
            raise ValueError("very_low must stand at 0 and very_high at 1")
        for (name, less), (next_name, more) in itertools.pairwise(zip(LEVELS, self.all, strict=True)):
            if more.at <= less.at:
                raise ValueError(f"{next_name} must stand above {name}")
            if more.speed_factor > less.speed_factor:
                raise ValueError(f"speed_factor of {next_name} is above that of {name}: fear must slow down")
            if order.index(more.mode) < order.index(less.mode):
                raise ValueError(f"the mode of {next_name} is milder than that of {name}")
        return self


class Hysteresis(Settings):
    """How reluctantly fear is forgotten. Getting more afraid takes effect at once."""

    band: Annotated[float, Field(ge=0, lt=0.2)]  # fear must fall this far below a level's border to leave it
    calm_after_s: Seconds  # ... and stay there this long
    stop_after_s: Seconds  # a level whose mode is STOP must last this long: one bad frame only slows down
    recovery_per_s: Annotated[float, Field(gt=0)]  # greatest rise of the speed factor [1/s] ...
    catch_up_per_s: Annotated[
        float, Field(gt=0)
    ]  # ... and while it is below the speed that the car still has


class RuleFile(Settings):
    """The contents of ``config/fear.yaml``."""

    inputs: Annotated[dict[Name, Input], Field(min_length=1)]
    rules: Annotated[tuple[str, ...], Field(min_length=1)]
    fear: Actions
    hysteresis: Hysteresis

    @field_validator("inputs")
    @classmethod
    def _names_are_no_keywords(cls, inputs: dict[str, Input]) -> dict[str, Input]:
        for name in inputs:
            if name in KEYWORDS:
                raise ValueError(f"{name!r} is a word of the rule language; choose another name")
        return inputs


class Atom(NamedTuple):
    """``input is [not] set``."""

    input: str
    set: str
    negated: bool


Cases = tuple[tuple[Atom, ...], ...]
"""An expression as a disjunction of conjunctions."""


@dataclass(frozen=True, slots=True)
class Rule:
    """One sentence, understood."""

    text: str
    cases: Cases
    level: int  # index into LEVELS
    weight: float
    cause: str


class SentenceError(ValueError):
    """A rule that cannot be understood; ``offset`` is where in the sentence, from 0."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.offset = offset


class Word(NamedTuple):
    """A token of a sentence and where it starts."""

    text: str
    offset: int


def load_rules(path: Path) -> tuple[RuleFile, tuple[Rule, ...]]:
    """The rule file at ``path`` and its sentences, understood.

    Raises InputError with file:line:column of the first thing that is wrong, and what was expected there.
    """
    file = config.load(path, RuleFile)
    return file, tuple(_rule_at(i, file, path) for i in range(len(file.rules)))


def _rule_at(index: int, file: RuleFile, path: Path) -> Rule:
    sentence = file.rules[index]
    try:
        return parse_rule(sentence, file.inputs)
    except SentenceError as error:
        line, column = config.position(config.read(path), ("rules", index))
        shown = path.read_text(encoding="utf-8").splitlines()[line - 1][column - 1 :]
        if sentence in shown:  # on one line, plain or quoted
            column += shown.index(sentence) + error.offset
        raise InputError(f"{path}:{line}:{column}: {error}") from error


def parse_rule(sentence: str, inputs: Mapping[str, Input] | Iterable[str]) -> Rule:
    """The rule that ``sentence`` states about ``inputs``. Raises SentenceError."""
    words = [Word(m.group(), m.start()) for m in re.finditer(r"[A-Za-z_]\w*|[0-9.]+|\S", sentence)]
    return _Parser(sentence, words, tuple(inputs)).rule()


class _Parser:
    """Recursive descent over the words of one sentence; ``not`` is pushed down to the atoms (De Morgan)."""

    def __init__(self, sentence: str, words: list[Word], inputs: tuple[str, ...]) -> None:
        self.sentence, self.words, self.inputs = sentence, words, inputs
        self.end = Word("", len(sentence))

    @property
    def next(self) -> Word:
        return self.words[0] if self.words else self.end

    def take(self, *expected: str, what: str = "") -> str:
        """The next word, which must be one of ``expected``."""
        word = self.next
        if word.text not in expected:
            raise SentenceError(_expectation(word.text, expected, what), word.offset)
        self.words = self.words[1:]
        return word.text

    def skip(self, *phrase: str) -> bool:
        """Whether ``phrase`` stood next; it is passed over then."""
        found = [w.text for w in self.words[: len(phrase)]] == list(phrase)
        if found:
            self.words = self.words[len(phrase) :]
        return found

    def rule(self) -> Rule:
        self.take("if")
        cases = self.any_of(negated=False)
        for word in ("then", "fear", "is"):
            self.take(word)
        level = LEVELS.index(self.take(*LEVELS, what="level"))
        weight = self.weight() if self.skip("with", "weight") else 1.0
        cause = self.cause() if self.skip("because") else cases[0][0].input
        self.take("")
        return Rule(self.sentence, cases, level, weight, cause)

    def any_of(self, *, negated: bool) -> Cases:
        parts = [self.all_of(negated=negated)]
        while self.skip("or"):
            parts.append(self.all_of(negated=negated))
        return _conjunction(parts) if negated else _disjunction(parts)

    def all_of(self, *, negated: bool) -> Cases:
        parts = [self.term(negated=negated)]
        while self.skip("and"):
            parts.append(self.term(negated=negated))
        return _disjunction(parts) if negated else _conjunction(parts)

    def term(self, *, negated: bool) -> Cases:
        if self.skip("not"):
            return self.term(negated=not negated)
        if self.skip("("):
            inner = self.any_of(negated=negated)
            self.take(")")
            return inner
        name = self.take(*self.inputs, what="input")
        self.take("is")
        if self.skip("not"):
            negated = not negated
        return ((Atom(name, self.take(*LEVELS, what="set"), negated),),)

    def weight(self) -> float:
        word = self.next
        try:
            value = float(word.text)
        except ValueError:
            value = -1.0
        if not 0 < value <= 1:
            raise SentenceError(f"expected a weight above 0 and at most 1, got {word.text!r}", word.offset)
        self.words = self.words[1:]
        return value

    def cause(self) -> str:
        word = self.next
        if not re.fullmatch(r"[a-z][a-z0-9_]*", word.text):
            raise SentenceError(f"expected a cause such as 'dark', got {word.text!r}", word.offset)
        self.words = self.words[1:]
        return word.text


def _conjunction(parts: list[Cases]) -> Cases:
    return tuple(tuple(itertools.chain(*choice)) for choice in itertools.product(*parts))


def _disjunction(parts: list[Cases]) -> Cases:
    return tuple(itertools.chain(*parts))


def _expectation(got: str, expected: tuple[str, ...], what: str) -> str:
    """What was expected instead of ``got``, with a did-you-mean."""
    if expected == ("",):
        return f"expected the end of the rule, 'with weight' or 'because', got {got!r}"
    if not got:
        return f"the rule ends too early: expected {what or repr(expected[0])}"
    close = difflib.get_close_matches(got, expected, n=1)
    if not what and not close:
        return f"expected {expected[0]!r}, got {got!r}"
    hint = f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(expected)}"
    return f"unknown {what or 'word'} {got!r}; {hint}"
