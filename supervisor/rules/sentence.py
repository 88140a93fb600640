"""The language of the rules: a sentence in, its meaning as a table row out.

A rule is a sentence::

    if EXPRESSION then OUTPUT is LEVEL [with weight W] [because CAUSE]

EXPRESSION joins ``input is [not] set`` by ``and``, ``or``, ``not`` and parentheses. OUTPUT is ``fear``, or
``trust_NAME`` for an estimator that the file names under ``estimators``.
"""

import difflib
import itertools
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from supervisor.rules.rule_file import FEAR, LEVELS, RuleFile
from trepid import config
from trepid.causes import unknown_cause
from trepid.config import InputError


class Atom(NamedTuple):
    """``input is [not] set``."""

    input: str
    set: str
    negated: bool


Cases = tuple[tuple[Atom, ...], ...]
"""An expression as a disjunction of conjunctions."""
MOST_CASES, DEEPEST = (
    256,
    32,
)  # far beyond what a person would read; keeps a mistyped rule from filling the memory


@dataclass(frozen=True, slots=True)
class Rule:
    """One sentence, understood."""

    text: str
    cases: Cases
    level: int  # index into LEVELS
    weight: float
    cause: str
    output: str = FEAR

    @property
    def harm(self) -> int:
        """How bad it is that the rule holds, 0 to 4: the level of fear, or how far trust is below very_high."""
        return self.level if self.output == FEAR else len(LEVELS) - 1 - self.level

    @property
    def inputs(self) -> frozenset[str]:
        """The inputs that the rule speaks of."""
        return frozenset(atom.input for case in self.cases for atom in case)


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
        rule = parse_rule(sentence, file.inputs, outputs=file.outputs)
        problem = unknown_cause(rule.cause, file.known_causes)
        if problem:
            raise SentenceError(problem, sentence.rindex(rule.cause))
        return rule
    except SentenceError as error:
        line, column = config.position(config.read(path), ("rules", index))
        shown = path.read_text(encoding="utf-8").splitlines()[line - 1][column - 1 :]
        if sentence in shown:  # on one line, plain or quoted
            column += shown.index(sentence) + error.offset
        raise InputError(f"{path}:{line}:{column}: {error}") from error


def parse_rule(sentence: str, inputs: Iterable[str], *, outputs: tuple[str, ...] = (FEAR,)) -> Rule:
    """The rule that ``sentence`` states about ``inputs``. Raises SentenceError."""
    words = [Word(m.group(), m.start()) for m in re.finditer(r"[A-Za-z_]\w*|[0-9.]+|\S", sentence)]
    return _Parser(sentence, words, tuple(inputs), outputs).rule()


class _Parser:
    """Recursive descent over the words of one sentence; ``not`` is pushed down to the atoms (De Morgan)."""

    def __init__(
        self, sentence: str, words: list[Word], inputs: tuple[str, ...], outputs: tuple[str, ...]
    ) -> None:
        self.sentence, self.words, self.inputs, self.outputs = sentence, words, inputs, outputs
        self.end = Word("", len(sentence))
        self.depth = 0

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
        self.take("then")
        output = self.take(*self.outputs, what="output")
        self.take("is")
        level = self.level(output)
        weight = self.weight() if self.skip("with", "weight") else 1.0
        cause = self.cause() if self.skip("because") else cases[0][0].input
        self.take("")
        return Rule(self.sentence, cases, level, weight, cause, output)

    def level(self, output: str) -> int:
        offset = self.next.offset
        level = LEVELS.index(self.take(*LEVELS, what="level"))
        if output != FEAR and level == len(LEVELS) - 1:
            told = f"{output} is very_high wherever no rule lowers it; expected {', '.join(LEVELS[:-1])}"
            raise SentenceError(told, offset)
        return level

    def any_of(self, *, negated: bool) -> Cases:
        parts = [self.all_of(negated=negated)]
        while self.skip("or"):
            parts.append(self.all_of(negated=negated))
        return self.conjunction(parts) if negated else _disjunction(parts)

    def all_of(self, *, negated: bool) -> Cases:
        parts = [self.term(negated=negated)]
        while self.skip("and"):
            parts.append(self.term(negated=negated))
        return _disjunction(parts) if negated else self.conjunction(parts)

    def conjunction(self, parts: list[Cases]) -> Cases:
        if math.prod(len(part) for part in parts) > MOST_CASES:
            told = f"the rule has more than {MOST_CASES} cases; split it into several"
            raise SentenceError(told, self.next.offset)
        return tuple(tuple(itertools.chain(*choice)) for choice in itertools.product(*parts))

    def term(self, *, negated: bool) -> Cases:
        if self.next.text in ("not", "("):
            return self.inner(negated=negated)
        name = self.take(*self.inputs, what="input")
        self.take("is")
        if self.skip("not"):
            negated = not negated
        return ((Atom(name, self.take(*LEVELS, what="set"), negated),),)

    def inner(self, *, negated: bool) -> Cases:
        self.depth += 1
        if self.depth > DEEPEST:
            raise SentenceError(f"nested deeper than {DEEPEST}; split the rule", self.next.offset)
        if self.skip("not"):
            cases = self.term(negated=not negated)
        else:
            self.take("(")
            cases = self.any_of(negated=negated)
            self.take(")")
        self.depth -= 1
        return cases

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
