"""The grammar of conditions (lark, LALR(1)) and the errors of a sentence that does not follow it.

``docs/conditions.md`` has the same grammar as a table.
"""

import re
from collections.abc import Iterable
from functools import cache

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedInput, UnexpectedToken

from sim_harness.judging.conditions.signals import COUNTERS, UNITS, find_signal
from sim_harness.judging.trace import LABELS
from supervisor.rules.rule_file import LEVELS
from trepid.files.grammar import lalr

MAX_LENGTH = 1000  # characters; the claims of a longer sentence could exceed the recursion limit
COMPARISON = "a comparison (>=, <=, >, <, ==, !=, is)"
SCOPES = (
    "within",
    "for",
    "while",
    "whenever",
    "during",
    "from",
    "after",
    "before",
    "until",
    "between",
    "at",
)
_JOINTS = ("and", "or", "not", "is", "of", "on", "to", "any")
_QUANTIFIERS = ("always", "never", "eventually")
_RESERVED = (*SCOPES, *_JOINTS, *_QUANTIFIERS)


def _one_of(words: Iterable[str]) -> str:
    """A regular expression for one of ``words``, the longest first."""
    longest_first = sorted(words, key=lambda word: (-len(word), word))
    return "(?:" + "|".join(re.escape(word).replace("/", r"\/") for word in longest_first) + ")"


GRAMMAR = rf"""
start: [QUANTIFIER] claim scope*

?claim: conjunction | claim _OR conjunction -> disjunction
?conjunction: single | conjunction _AND single
?single: active | phrase
?phrase: NOT single -> negation
    | "(" claim ")"
    | LABEL (IS | EQUALITY) [NOT] (WORD | QUOTED) -> label
    | sum (OPERATOR sum)+ -> comparison
    | sum IS [NOT] (STATE | sum) -> equality
active: NAME | QUOTED

sum: [SIGN] term (SIGN term)*
?term: NUMBER [UNIT] -> number
    | NAME -> signal
    | "|" NAME "|" -> magnitude
    | LEVEL -> level

scope: (WITHIN | FOR) seconds (OF | AFTER | BEFORE) [ANY] event -> around
    | (WHILE | WHENEVER) claim -> condition
    | DURING (NAME | QUOTED) -> during
    | (FROM | AFTER) instant [_ON] -> since
    | (BEFORE | UNTIL) instant -> up_to
    | (FROM instant (_TO | UNTIL) | BETWEEN instant _AND) instant -> interval
    | AT instant -> moment
?instant: _T _EQUALS seconds -> elapsed
    | seconds -> elapsed
    | _THE _END -> ending
    | event
seconds: NUMBER [UNIT]
event: COUNTER -> counted
    | (active | event_claim) [EDGE] -> becomes
// `between A and B`: a claim in the place of A takes the `and`, the name of an event does not.
?event_claim: event_conjunction | event_claim _OR conjunction -> disjunction
?event_conjunction: phrase | event_conjunction _AND single -> conjunction

QUANTIFIER.2: /{_one_of(_QUANTIFIERS)}\b/
"""
GRAMMAR += "".join(f"{word.upper()}.2: /{word}\\b/\n" for word in (*SCOPES, "is", "not", "of", "any"))
GRAMMAR += "".join(
    f"_{word.upper()}.2: /{word}\\b/\n" for word in ("and", "or", "to", "on", "t", "the", "end")
)
GRAMMAR += rf"""
EDGE.2: /(?:begins|ends)\b/
STATE.2: /(?:known|unknown)\b/
COUNTER.2: /{_one_of(COUNTERS)}\b/
LABEL.2: /{_one_of(LABELS)}\b(?!\.)/
LEVEL.2: /{_one_of(LEVELS)}\b(?!\.)/
NAME: /(?!{_one_of(_RESERVED)}\b)[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*/
WORD: /[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*/
QUOTED: /'[^']+'/
NUMBER: /\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+/
UNIT: /{_one_of(UNITS)}(?![\w\/^])/
SIGN: /[-+−]/
OPERATOR: />=|<=|==|!=|[<>=≥≤≠]/
EQUALITY: /==?|!=|≠/
_EQUALS: /==?/
%ignore /\s+/
"""
_FOUND = re.compile(r"\s*('[^']+'|[A-Za-z_][\w.]*|[\d.]+|[><=!]=|[-+−<>=≥≤≠|()]|$)")
_UNIT_LIKE = re.compile(r"\s*([^\W\d_][\w/^]*|[°%]\S*)")


class SentenceError(ValueError):
    """A sentence that is not a condition: the sentence, the column from 1, and the expected words."""

    def __init__(self, text: str, offset: int, message: str) -> None:
        super().__init__(f"{text!r}, column {offset + 1}: {message}")


def parse_tree(text: str) -> Tree[Token]:
    """The syntax tree of ``text``. Raises SentenceError."""
    if len(text) > MAX_LENGTH:
        raise SentenceError(text[:40], 0, f"the sentence has more than {MAX_LENGTH} characters; split it")
    parser = _parser().parse_interactive(text)
    tokens: list[Token] = []
    try:
        for token in parser.iter_parse():
            tokens.append(token)
        tree: Tree[Token] = parser.feed_eof()
    except UnexpectedInput as error:
        at_end = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        offset = len(text) if at_end else int(error.pos_in_stream or 0)
        raise _syntax_error(text, offset, tokens, parser.accepts()) from None
    return tree


def error_after(text: str, offset: int, expected: str) -> SentenceError:
    """The error at the first word from ``offset`` on, where ``expected`` was expected."""
    found = _FOUND.match(text, offset)
    if found is None:
        at = len(text) - len(text[offset:].lstrip())
        return SentenceError(text, at, f"{text[at]!r} means nothing here")
    word = repr(found[1]) if found[1] else "the end"
    return SentenceError(text, found.start(1), f"expected {expected}, found {word}")


@cache
def _parser() -> Lark:
    """The parser, made at the first use."""
    return lalr(GRAMMAR, positions=True)


def _syntax_error(text: str, offset: int, tokens: list[Token], accepted: set[str]) -> SentenceError:
    """The error at ``offset``, after ``tokens``, where the parser accepts the terminals ``accepted``."""
    unit = _UNIT_LIKE.match(text, offset)
    if tokens and tokens[-1].type == "NUMBER" and unit and unit[1] not in _RESERVED:
        return SentenceError(text, unit.start(1), f"no unit {unit[1]!r}; there are {', '.join(UNITS)}")
    return error_after(text, offset, _expectation(tokens, accepted))


def _expectation(tokens: list[Token], accepted: set[str]) -> str:
    """The words that the parser accepts after ``tokens``, as text."""
    types = [token.type for token in tokens]
    signal_alone = (
        types[-1:] == ["NAME"]
        and find_signal(tokens[-1]) is not None
        and (not types[:-1] or types[-2] not in ("OPERATOR", "SIGN", "IS"))
    )
    label = next((str(token) for token in reversed(tokens) if token.type == "LABEL"), "")
    expected = {
        "VBAR": "'|'",
        "$END": "'and', 'or', the end, or one of " + ", ".join(SCOPES),
        "RPAR": "')'",
        "WORD": f"a word for {label!r}",
        "_AND": "'and'",
        "OPERATOR": COMPARISON,
        "IS": f"'is' after {label!r}",
        "OF": "'of', 'after' or 'before'",
        "_END": "'end'",
        "_EQUALS": "'='",
    }
    if {"NAME", "NUMBER"} <= accepted:
        return "a signal or a number"
    if signal_alone and "VBAR" not in accepted:
        return COMPARISON
    if accepted == {"NUMBER"}:
        return "a time in s"
    if accepted == {"NAME"}:
        return "a signal"
    if accepted == {"NAME", "QUOTED"}:
        return "the name of a fault, disturbance, manoeuvre or section"
    return next(text for terminal, text in expected.items() if terminal in accepted)
