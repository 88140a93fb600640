"""The grammar of Fuzzy Control Language (IEC 61131-7), in the subset that rule files need, and its errors."""

import re
from collections.abc import Iterable
from functools import cache
from typing import NoReturn

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from trepid.config import InputError
from trepid.files.grammar import lalr
from trepid.loudness import note
from trepid.spelling import did_you_mean

KEYWORDS = (
    *("FUNCTION_BLOCK", "END_FUNCTION_BLOCK", "VAR_INPUT", "VAR_OUTPUT", "END_VAR", "REAL"),
    *("FUZZIFY", "END_FUZZIFY", "DEFUZZIFY", "END_DEFUZZIFY", "TERM", "RANGE", "DEFAULT"),
    *("RULEBLOCK", "END_RULEBLOCK", "RULE", "WITH", "OPTION", "END_OPTION"),
    *("AND", "OR", "ACT", "ACCU", "METHOD", "MIN", "MAX", "COG", "COGS"),
    *("MEANING", "UNIT", "RISK", "MISSING", "BEYOND", "SPEED_FACTOR", "MODE", "HYSTERESIS"),
    *("BECAUSE", "CAUSE", "WITHOUT"),
)
"""Words of FCL and of the OPTION block: the same in capitals and small letters."""
_SPELLINGS = {"REAL": "L?REAL"}  # a number of 8 bytes is one of 4 here
SIGNS = {
    "_ASSIGN": ":=",
    "_COLON": ":",
    "_SEMICOLON": ";",
    "_COMMA": ",",
    "_DOTS": "..",
    "LPAR": "(",
    "RPAR": ")",
}

GRAMMAR = r"""
start: _FUNCTION_BLOCK NAME (var_input | var_output | fuzzify | defuzzify | ruleblock | option)* _END_FUNCTION_BLOCK
var_input: _VAR_INPUT variables* _END_VAR
var_output: _VAR_OUTPUT variables* _END_VAR
variables: NAME (_COMMA NAME)* _COLON _REAL subrange? _SEMICOLON
subrange: LPAR NUMBER _DOTS NUMBER RPAR
fuzzify: _FUZZIFY NAME (term | range)* _END_FUZZIFY
defuzzify: _DEFUZZIFY NAME (term | range | default | _setting | _METHOD _COLON COGS _SEMICOLON)* _END_DEFUZZIFY
term: _TERM NAME _ASSIGN (singleton | corner* | piecewise) _SEMICOLON
singleton: NUMBER
corner: LPAR NUMBER _COMMA NUMBER RPAR
piecewise: NAME NUMBER*
range: RANGE _ASSIGN LPAR NUMBER _DOTS NUMBER RPAR _SEMICOLON
default: DEFAULT _ASSIGN (NUMBER | NAME) _SEMICOLON
_setting: (_AND | _ACT) _COLON _MIN _SEMICOLON
    | (_OR | _ACCU) _COLON _MAX _SEMICOLON
    | _METHOD _COLON _COG _SEMICOLON
ruleblock: _RULEBLOCK NAME (rule | _setting)* _END_RULEBLOCK
rule: _RULE _value _COLON (_value | LPAR | RPAR | WITH _value)* _SEMICOLON
option: _OPTION (of_input | of_level | hysteresis | method | because | cause | without)* _END_OPTION
of_input: (MEANING | UNIT | RISK | MISSING | BEYOND) NAME _ASSIGN _value _SEMICOLON
of_level: (SPEED_FACTOR | MODE) NAME _ASSIGN _value _SEMICOLON
hysteresis: _HYSTERESIS NAME _ASSIGN _value _SEMICOLON
method: _METHOD _ASSIGN _value _SEMICOLON
because: _BECAUSE _value _ASSIGN _value _SEMICOLON
cause: _CAUSE NAME _ASSIGN _value _SEMICOLON
without: _WITHOUT NAME _SEMICOLON
_value: NAME | NUMBER | TEXT

NAME: /[A-Za-z_]\w*/
NUMBER: /[+-]?(?:\d+\.(?!\.)\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?/
TEXT: /'(?:\$.|[^'$\n])*'/
_ASSIGN: ":="
_COLON: /:(?!=)/
_SEMICOLON: ";"
_COMMA: ","
_DOTS: ".."
LPAR: /\((?!\*)/
RPAR: ")"
%ignore /\s+/
%ignore /\(\*(?:\(\*(?:(?!\*\))(?:.|\n))*\*\)|(?!\*\)|\(\*)(?:.|\n))*\*\)/
%ignore /\(\*(.|\n)*?\*\)/
%ignore /\/\*(.|\n)*?\*\//
%ignore /\/\/[^\n]*/
"""
_NEXT = re.compile(r"'(?:\$.|[^'$\n])*'|[+-]?[\d.]+\w*|\w+|:=|\.\.|.|$", re.DOTALL)
_KEPT = (
    "COGS",
    "RANGE",
    "DEFAULT",
    "WITH",
    "MEANING",
    "UNIT",
    "RISK",
    "MISSING",
    "BEYOND",
    "SPEED_FACTOR",
    "MODE",
)


class Source:
    """A text of FCL and its name: the syntax tree, and errors with line and column."""

    def __init__(self, text: str, name: object) -> None:
        self._text, self._name = text, name

    def tree(self) -> Tree[Token]:
        """The syntax tree. Raises InputError at the first word that the grammar does not allow."""
        parser = _grammar().parse_interactive(self._text)
        try:
            parser.exhaust_lexer()
            tree: Tree[Token] = parser.feed_eof()
        except UnexpectedInput as error:
            self._refuse(error, parser.accepts())
        return tree

    def fail(self, token: Token | None, message: str) -> NoReturn:
        """Raise InputError: ``message`` about ``token``; None: about the whole text."""
        line, column = (token.line, token.column) if token is not None else (1, 1)
        raise InputError(f"{self._name}:{line}:{column}: {message}")

    def note(self, token: Token, message: str) -> None:
        """Say what was assumed at ``token``."""
        note(f"trepid: {self._name}:{token.line}:{token.column}: {message}")

    def expect(self, token: Token, names: Iterable[str], *, what: str = "one of ") -> str:
        """``token`` as one of ``names``. Raises InputError."""
        known = tuple(names)
        if token not in known:
            self.fail(token, f"expected {what}{', '.join(known)}, got {str(token)!r}{hint(token, known)}")
        return str(token)

    def _refuse(self, error: UnexpectedInput, accepted: set[str]) -> NoReturn:
        at_end = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        at = len(self._text) if at_end else int(error.pos_in_stream or 0)
        found = _NEXT.match(self._text, at)
        got = found.group() if found else ""
        place = Token(
            "", got, line=self._text.count("\n", 0, at) + 1, column=at - self._text.rfind("\n", 0, at)
        )
        if isinstance(error, UnexpectedCharacters):
            unfinished = self._text[at] in "('" or self._text.startswith("/*", at)
            what = "begins a text or a comment that does not end" if unfinished else "is no sign of FCL"
            self.fail(place, f"{self._text[at]!r} {what}")
        shown = repr(got) if got else "the end of the file"
        words = [word for word in KEYWORDS if {word, f"_{word}"} & accepted]
        self.fail(place, f"expected {_expected_words(accepted, words)}, got {shown}{hint(got, words)}")


def hint(word: str, known: Iterable[str]) -> str:
    """``; did you mean ...?`` with the name of ``known`` that is nearest to ``word``, if one is near."""
    known = tuple(known)
    question = did_you_mean(word, known, "") or did_you_mean(word.upper(), known, "")
    return f"; {question}" if question else ""


def _expected_words(accepted: set[str], words: list[str]) -> str:
    if "$END" in accepted:
        return "the end of the file: one function block is a rule file"
    if {"NAME", "NUMBER", "TEXT"} <= accepted:
        return "a value"
    kinds = [f"a {kind.lower()}" for kind in ("NAME", "NUMBER") if kind in accepted]
    signs = [repr(sign) for terminal, sign in SIGNS.items() if terminal in accepted]
    return " or ".join([*kinds, *map(repr, words), *signs])


@cache
def _grammar() -> Lark:
    """The parser, made at the first use."""
    words = [
        f"{'' if word in _KEPT else '_'}{word}.2: /{_SPELLINGS.get(word, word)}\\b/i" for word in KEYWORDS
    ]
    return lalr("\n".join([GRAMMAR, *words]))
