"""The rule language: a sentence in, its meaning as a table row out.

A rule is a sentence::

    if EXPRESSION then OUTPUT is LEVEL [with weight W] [because CAUSE]

EXPRESSION joins ``input is [not] set`` by ``and``, ``or``, ``not`` and parentheses. OUTPUT is ``fear``, or
``trust_NAME`` for an estimator that the file names under ``estimators``.
"""

import itertools
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedInput, UnexpectedToken

from supervisor.rules.rule_file import FEAR, FORMER_PATH_JITTER, LEVELS, PATH_JITTER, RuleFile
from trepid import config
from trepid.causes import unknown_cause
from trepid.config import InputError
from trepid.files.grammar import lalr
from trepid.loudness import warn
from trepid.spelling import did_you_mean

MAX_CASES, MAX_DEPTH = 256, 32
"""Limits of one rule, far above any legible one: a mistyped rule must not fill the memory."""

GRAMMAR = r"""
start: _IF expression _THEN OUTPUT _IS LEVEL [_WITH _WEIGHT NUMBER] [_BECAUSE CAUSE]
?expression: conjunction (_OR conjunction)*   -> disjunction
?conjunction: term (_AND term)*
?term: NOT term                               -> negation
     | LPAR expression _RPAR                  -> group
     | INPUT _IS [NOT] SET                    -> atom

_IF.2: /if\b/
_THEN.2: /then\b/
_IS.2: /is\b/
_WITH.2: /with\b/
_WEIGHT.2: /weight\b/
_BECAUSE.2: /because\b/
_OR.2: /or\b/
_AND.2: /and\b/
NOT.2: /not\b/
LPAR: "("
_RPAR: ")"
NUMBER: /[0-9.]+/
INPUT: /[A-Za-z_]\w*/
SET: /[A-Za-z_]\w*/
OUTPUT: /[A-Za-z_]\w*/
LEVEL: /[A-Za-z_]\w*/
CAUSE: /[A-Za-z_]\w*/
%ignore /\s+/
"""
_WORD = re.compile(r"[A-Za-z_]\w*|[0-9.]+|\S|$")


class Atom(NamedTuple):
    """``input is [not] set``."""

    input: str
    set: str
    negated: bool


Cases = tuple[tuple[Atom, ...], ...]
"""An expression as a disjunction of conjunctions."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A parsed sentence."""

    text: str
    cases: Cases
    level: int  # index into LEVELS
    weight: float
    cause: str
    output: str = FEAR

    @property
    def harm(self) -> int:
        """Severity of the consequence, 0 to 4: the level of fear, or the levels of trust below very_high."""
        return self.level if self.output == FEAR else len(LEVELS) - 1 - self.level

    @property
    def inputs(self) -> frozenset[str]:
        """Names of the inputs in the expression."""
        return frozenset(atom.input for case in self.cases for atom in case)


class SentenceError(ValueError):
    """A sentence that is not a rule; ``offset`` is the index of the wrong word in the sentence."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.offset = offset


def load_rules(path: Path) -> tuple[RuleFile, tuple[Rule, ...]]:
    """The rule file at ``path`` and its parsed sentences.

    Inputs with a former name are reported on stderr. Raises InputError with file:line:column of the first error and
    the expected text.
    """
    file = config.load(path, RuleFile)
    for name in file.inputs:
        if name.endswith(FORMER_PATH_JITTER):
            _warn_of_former_name(name, path)
    return file, tuple(_rule_at(i, file, path) for i in range(len(file.rules)))


@lru_cache(maxsize=64)  # one warning a file
def _warn_of_former_name(name: str, path: Path) -> None:
    line, column = config.position(config.read(path), ("inputs", name))
    new = name.removesuffix(FORMER_PATH_JITTER) + PATH_JITTER
    warn(f"trepid: {path}:{line}:{column}: warning: the input {name!r} is now called {new!r}")


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
        shown = config.read_text(path).splitlines()[line - 1][column - 1 :]
        if sentence in shown:  # on one line, plain or quoted
            column += shown.index(sentence) + error.offset
        raise InputError(f"{path}:{line}:{column}: {error}") from error


def parse_rule(sentence: str, inputs: Iterable[str], *, outputs: tuple[str, ...] = (FEAR,)) -> Rule:
    """The rule that ``sentence`` states about ``inputs``. Raises SentenceError."""
    known = {"INPUT": tuple(inputs), "SET": LEVELS, "OUTPUT": outputs, "LEVEL": LEVELS}
    parser = _grammar().parse_interactive(sentence)
    try:
        for token in parser.iter_parse():  # names are checked on the way: the first error is reported
            _check_token(token, known)
        tree = parser.feed_eof()
    except UnexpectedInput as error:
        at_end = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        offset = len(sentence) if at_end else int(error.pos_in_stream or 0)
        word = _WORD.match(sentence, offset)
        message = _expectation(word.group() if word else "", parser.accepts(), known)
        raise SentenceError(message, offset) from error
    expression, output, level, weight, cause = tree.children
    if output != FEAR and level == LEVELS[-1]:
        message = f"{output} is {level} where no rule lowers it; expected {', '.join(LEVELS[:-1])}"
        raise SentenceError(message, level.start_pos)
    cases = _cases(expression, negated=False, depth=0)
    return Rule(
        sentence,
        cases,
        LEVELS.index(level),
        float(weight or 1.0),
        str(cause or cases[0][0].input),
        str(output),
    )


@cache
def _grammar() -> Lark:
    """The parser, made at the first use."""
    return lalr(GRAMMAR)


def _check_token(token: Token, known: dict[str, tuple[str, ...]]) -> None:
    """Raise SentenceError for an unknown name, a weight outside 0..1 or a malformed cause."""
    names = known.get(token.type)
    wrong = (
        (names is not None and token not in names)
        or (token.type == "NUMBER" and not _is_weight(token))
        or (token.type == "CAUSE" and not re.fullmatch(r"[a-z][a-z0-9_]*", token))
    )
    if wrong:
        raise SentenceError(_expectation(str(token), {token.type}, known), token.start_pos or 0)


def _is_weight(text: str) -> bool:
    try:
        return 0 < float(text) <= 1
    except ValueError:
        return False


def _cases(tree: Tree[Token], *, negated: bool, depth: int) -> Cases:
    """``tree`` as a disjunction of conjunctions; ``not`` is pushed down to the atoms (De Morgan)."""
    children: list[Any] = tree.children
    if tree.data == "atom":
        name, no, level = children
        return ((Atom(str(name), str(level), negated != (no is not None)),),)
    if tree.data in ("negation", "group"):
        if depth == MAX_DEPTH:
            raise SentenceError(f"nested deeper than {MAX_DEPTH}; split the rule", children[0].start_pos)
        return _cases(children[1], negated=negated != (tree.data == "negation"), depth=depth + 1)
    parts = [_cases(child, negated=negated, depth=depth) for child in children]
    if (tree.data == "disjunction") != negated:
        return tuple(itertools.chain(*parts))
    if math.prod(len(part) for part in parts) > MAX_CASES:
        first: Any = next(tree.scan_values(lambda value: isinstance(value, Token)))
        raise SentenceError(
            f"the rule has more than {MAX_CASES} cases; split it into several", first.start_pos
        )
    return tuple(tuple(itertools.chain(*choice)) for choice in itertools.product(*parts))


def _expectation(got: str, accepted: Iterable[str], known: dict[str, tuple[str, ...]]) -> str:
    """Error text: the expected words in place of ``got``, with the nearest known name."""
    terminals = set(accepted)
    if "$END" in terminals:
        return f"expected the end of the rule, 'with weight' or 'because', got {got!r}"
    names = next((terminal for terminal in known if terminal in terminals), None)
    what = next((t.lower() for t in ("INPUT", "SET", "OUTPUT", "LEVEL", "CAUSE") if t in terminals), "")
    if "NUMBER" in terminals and got:
        return f"expected a weight above 0 and at most 1, got {got!r}"
    if "CAUSE" in terminals and got:
        return f"expected a cause such as 'dark', got {got!r}"
    expected = known[names] if names else (_keyword(terminals),)
    if not got:
        return f"the rule ends too early: expected {what or repr(expected[0])}"
    output = names == "INPUT" and got in known["OUTPUT"]
    about = f"it is an output of the rules; a condition is about inputs, such as {expected[0]!r}"
    hint = about if output else did_you_mean(got, expected, otherwise=None if what else "")
    if not hint:
        return f"expected {expected[0]!r}, got {got!r}"
    return f"unknown {what or 'word'} {got!r}; {hint}"


def _keyword(terminals: set[str]) -> str:
    """The word that continues the rule, from the terminals that the parser accepts."""
    if "_RPAR" in terminals:
        return ")"
    if "_THEN" in terminals:
        return "then"
    return {"NUMBER": "weight"}.get(min(terminals), min(terminals).removeprefix("_").lower())
