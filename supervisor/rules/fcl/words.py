"""The words of an FCL text, with their places."""

import difflib
import re
from collections.abc import Iterable
from typing import NamedTuple

from trepid.config import InputError

_TOKEN = re.compile(
    r"(?P<skip>\s+|\(\*.*?\*\)|//[^\n]*)"
    r"|(?P<endless>\(\*)"
    r"|(?P<text>'(?:\$.|[^'$])*')"
    r"|(?P<number>[+-]?(?:\d+\.(?!\.)\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<word>[A-Za-z_]\w*)"
    r"|(?P<sign>:=|\.\.|[():;,])",
    re.DOTALL,
)


class Token(NamedTuple):
    """A word, number, 'text' or sign, and where it starts."""

    kind: str
    text: str
    line: int
    column: int

    @property
    def keyword(self) -> str:
        """FCL's own words are the same in capitals."""
        return self.text.upper() if self.kind == "word" else self.text


class Words:
    """The tokens of a text, taken one by one. ``source`` is told in errors."""

    def __init__(self, text: str, source: object) -> None:
        self._source = source
        self._tokens = self._split(text)
        self._index = 0

    @property
    def next(self) -> Token:
        """The token that is taken next; the last one is empty."""
        return self._tokens[self._index]

    def take(self, *expected: str) -> Token:
        """The next token, which must be one of these words or signs of FCL."""
        if self.next.keyword not in expected:
            raise self.error(self.next, f"{_either(expected)}", close_to=expected)
        return self._advance()

    def skip(self, *phrase: str) -> bool:
        """Whether these words or signs stood next; they are passed over then."""
        found = [token.keyword for token in self._tokens[self._index : self._index + len(phrase)]]
        if found != list(phrase):
            return False
        self._index += len(phrase)
        return True

    def name(self, known: Iterable[str] | None = None, *, what: str = "name") -> Token:
        """The next token, a name, and one of ``known`` if that is given."""
        names = () if known is None else tuple(known)
        if self.next.kind != "word" or (known is not None and self.next.text not in names):
            raise self.error(
                self.next, f"{what} of {', '.join(names)}" if names else f"a {what}", close_to=names
            )
        return self._advance()

    def number(self) -> float:
        """The next token, a number."""
        if self.next.kind != "number":
            raise self.error(self.next, "a number")
        return float(self._advance().text)

    def value(self) -> Token:
        """The next token, whatever it says, but no sign."""
        if self.next.kind in ("sign", "end"):
            raise self.error(self.next, "a value")
        return self._advance()

    def error(self, token: Token, expected: str, *, close_to: Iterable[str] = ()) -> InputError:
        """What was expected in the place of ``token``, with a did-you-mean."""
        got = repr(token.text) if token.text else "the end of the file"
        close = difflib.get_close_matches(token.keyword, close_to, n=1) or difflib.get_close_matches(
            token.text, close_to, n=1
        )
        hint = f"; did you mean {close[0]!r}?" if close else ""
        return self.wrong(token, f"expected {expected}, got {got}{hint}")

    def wrong(self, token: Token, told: str) -> InputError:
        """``told`` about the place of ``token``."""
        return InputError(f"{self._source}:{token.line}:{token.column}: {told}")

    def _advance(self) -> Token:
        self._index += 1
        return self._tokens[self._index - 1]

    def _split(self, text: str) -> list[Token]:
        tokens, at, line, start = [], 0, 1, 0
        while at < len(text):
            found = _TOKEN.match(text, at)
            here = Token("sign", text[at], line, at - start + 1)
            if found is None or found.lastgroup == "endless":
                endless = text[at] in "('"
                told = "begins a text or a comment that does not end" if endless else "is no sign of FCL"
                raise self.wrong(here, f"{text[at]!r} {told}")
            if found.lastgroup != "skip":
                tokens.append(here._replace(kind=str(found.lastgroup), text=found.group()))
            line += found.group().count("\n")
            start = at + found.group().rfind("\n") + 1 if "\n" in found.group() else start
            at = found.end()
        return [*tokens, Token("end", "", line, at - start + 1)]


def _either(words: tuple[str, ...]) -> str:
    return " or ".join(repr(word) for word in words)
