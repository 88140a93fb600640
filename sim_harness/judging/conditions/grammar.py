"""The language of conditions: a sentence to a claim and a scope (the table is in ``docs/conditions.md``)."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NoReturn

from sim_harness.judging.conditions.claims import Above, Active, Both, Claim, Either, Is, Known, Sum
from sim_harness.judging.conditions.scopes import Around, Begins, Counted, Elapsed, Ending, Instant, Scope
from sim_harness.judging.conditions.signals import (
    COUNTERS,
    UNITS,
    Signal,
    close_to,
    fear_border,
    find_signal,
    signal_names,
)
from sim_harness.judging.trace import LABELS
from supervisor.rules.rule_file import LEVELS
from trepid.messages import Mode, Stop

_UNIT = "|".join(re.escape(unit) for unit in sorted(UNITS, key=len, reverse=True))
_TOKEN = re.compile(
    rf"""\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)\s*(?P<unit>(?:{_UNIT})(?![\w/^]))?
    |(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)
    |'(?P<quoted>[^']+)'
    |(?P<symbol>>=|<=|==|!=|[<>=≥≤≠−|+\-()])
    |(?P<bad>\S))""",
    re.VERBOSE,
)
_SPELLINGS = {"≥": ">=", "≤": "<=", "≠": "!=", "−": "-", "=": "=="}
_COMPARISONS = (">=", "<=", ">", "<", "==", "!=")
_SCOPES = (
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
_UNKNOWN_UNIT = re.compile(r"\s*([^\W\d_][\w/^]*|[°%]\S*)")
_RESERVED = {*_SCOPES, "always", "never", "eventually", "and", "or", "not", "is", "of", "on", "to", "any"}
_KNOWN_WORDS = {"mode": [mode.value for mode in Mode], "stop": [stop.value for stop in Stop]}


@dataclass(frozen=True, slots=True)
class Word:
    """A word of a sentence and where it stands, from 1."""

    text: str
    column: int


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str  # number, name, quoted, symbol, end
    text: str
    column: int
    end: int  # where the text goes on
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class Sentence:
    """What a sentence says."""

    claim: Claim
    scope: Scope
    eventually: bool
    events: tuple[Word, ...]


@dataclass(frozen=True, slots=True)
class _Operand:
    """A side of a comparison; ``unit`` None: a bare number, which takes the unit of the other side."""

    sum: Sum
    unit: str | None
    column: int
    level: str | None = None


def parse(text: str) -> Sentence:
    """``text``, understood. Raises ValueError with column, what was found and what was expected."""
    return _Parser(text).sentence()


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = _tokens(text)
        self._at = 0
        self._events: list[Word] = []

    def sentence(self) -> Sentence:
        """[always|never|eventually] claim {scope}."""
        quantifier = self._accept("always", "never", "eventually")
        claim = self._claim()
        scope, at_some_time = self._scope()
        if quantifier == "never":
            claim = claim.negated()
        eventually = at_some_time if quantifier is None else quantifier == "eventually"
        return Sentence(claim, scope, eventually, tuple(self._events))

    # Scopes.

    def _scope(self) -> tuple[Scope, bool]:
        """All scopes, and whether one of them says that once is enough."""
        scope, at_some_time = Scope(), False
        rules: dict[str, Callable[[Scope], Scope]] = {
            "within": self._around,
            "for": self._around,
            "while": lambda s: replace(s, while_claim=self._claim()),
            "whenever": lambda s: replace(s, while_claim=self._claim(), while_must_hold=False),
            "during": lambda s: replace(s, while_claim=self._active()),
            "from": self._from,
            "after": lambda s: replace(s, start=self._instant()),
            "before": lambda s: replace(s, end=self._instant()),
            "until": lambda s: replace(s, end=self._instant()),
            "between": self._between,
            "at": self._at_instant,
        }
        while self._token.kind != "end":
            before, column = scope, self._token.column
            word = self._accept(*_SCOPES) or self._fail(
                "'and', 'or', the end, or one of " + ", ".join(_SCOPES)
            )
            at_some_time |= word == "within"
            scope = rules[word](scope)
            if any(_set_twice(before, scope, field) for field in ("around", "start", "end", "while_claim")):
                raise self._error(column, f"{word!r} limits again what was limited before")
        return scope, at_some_time

    def _around(self, scope: Scope) -> Scope:
        """within|for D s of|after|before [any] event."""
        duration_s = self._seconds()
        side = self._accept("of", "after", "before") or self._fail("'of', 'after' or 'before'")
        may_lack = self._accept("any") is not None
        event = self._event()
        before_s, after_s = (duration_s, 0.0) if side == "before" else (0.0, duration_s)
        return replace(scope, around=Around(event, before_s, after_s, must_happen=not may_lack))

    def _from(self, scope: Scope) -> Scope:
        """from instant [on | to instant]."""
        scope = replace(scope, start=self._instant())
        if self._accept("to", "until"):
            return replace(scope, end=self._instant())
        self._accept("on")
        return scope

    def _between(self, scope: Scope) -> Scope:
        start = self._instant()
        if not self._accept("and"):
            self._fail("'and'")
        return replace(scope, start=start, end=self._instant())

    def _at_instant(self, scope: Scope) -> Scope:
        instant = self._instant()
        return replace(scope, start=instant, end=instant)

    def _instant(self) -> Instant:
        """t = X s | X s | the end | event."""
        if self._token.text == "t" and self._accept("t"):
            if not self._accept("=="):
                self._fail("'='")
            return Elapsed(self._seconds())
        if self._token.kind == "number":
            return Elapsed(self._seconds())
        if self._accept("the"):
            if not self._accept("end"):
                self._fail("'end'")
            return Ending()
        return self._event()

    def _event(self) -> Instant:
        """name [begins|ends] | departure | ... | claim that becomes true."""
        start = self._token
        if start.kind == "name" and start.text in COUNTERS:
            self._advance()
            return Counted(start.text)
        claim = self._active() if self._names_event() else self._either()
        ends = self._accept("begins", "ends") == "ends"
        text = self._text[start.column - 1 : self._tokens[self._at - 1].end].strip()
        return Begins(claim.negated() if ends else claim, text, after_start=ends)

    def _seconds(self) -> float:
        """A duration or a time [s]."""
        token = self._token
        if token.kind != "number":
            self._fail("a time in s")
        self._advance()
        unit, factor = UNITS[token.unit] if token.unit else ("s", 1.0)
        if unit != "s":
            raise self._error(token.column, f"expected a time in s, got {token.unit!r}")
        return float(token.text) * factor

    # Claims.

    def _claim(self) -> Claim:
        return self._either()

    def _either(self) -> Claim:
        claim = self._both()
        while self._accept("or"):
            claim = Either(claim, self._both())
        return claim

    def _both(self) -> Claim:
        claim = self._single()
        while self._accept("and"):
            claim = Both(claim, self._single())
        return claim

    def _single(self) -> Claim:
        """not claim | (claim) | event name | label is word | comparison."""
        if self._accept("not"):
            return self._single().negated()
        if self._accept("("):
            claim = self._claim()
            if not self._accept(")"):
                self._fail("')'")
            return claim
        if self._names_event():
            return self._active()
        if self._token.text in LABELS:
            return self._label()
        return self._comparison()

    def _names_event(self) -> bool:
        """A name that is no signal, with nothing after it that would compare it."""
        token, following = self._token, self._tokens[min(self._at + 1, len(self._tokens) - 1)]
        if token.kind == "quoted":
            return True
        named = token.kind == "name" and token.text not in _RESERVED and token.text not in LABELS
        compared = following.text in (*_COMPARISONS, "is", "+", "-") and following.kind in ("symbol", "name")
        return named and not compared and find_signal(token.text) is None

    def _active(self) -> Claim:
        token = self._token
        if token.kind != "quoted" and (token.kind != "name" or token.text in _RESERVED):
            self._fail("the name of a fault, disturbance, manoeuvre or section")
        self._advance()
        self._events.append(Word(token.text, token.column))
        return Active(token.text)

    def _label(self) -> Claim:
        """label is|== [not] word."""
        label = self._token.text
        self._advance()
        comparison = self._accept("is", "==", "!=") or self._fail(f"'is' after {label!r}")
        wanted = (self._accept("not") is None) == (comparison != "!=")
        token = self._token
        if token.kind not in ("name", "quoted"):
            self._fail(f"a word for {label!r}")
        self._advance()
        return Is(label, self._word(label, token), wanted)

    def _word(self, label: str, token: _Token) -> str:
        """The word of ``label``; where all are known, one of these."""
        known = _KNOWN_WORDS.get(label)
        if known is None:
            return token.text
        same = [word for word in known if word.lower() == token.text.lower()]
        if not same:
            hint = close_to(token.text, known)
            raise self._error(token.column, f"{label} has no {token.text!r}; it has {', '.join(known)}{hint}")
        return same[0]

    def _comparison(self) -> Claim:
        """sum {op sum} | signal is [not] known|level."""
        left = self._sum()
        if self._accept("is"):
            return self._is(left)
        if self._token.text not in _COMPARISONS:
            self._fail(f"a comparison ({', '.join(_COMPARISONS)}, is)")
        claim: Claim | None = None
        while (sign := self._token.text) in _COMPARISONS and self._token.kind == "symbol":
            self._advance()
            right = self._sum()
            one = self._compared(left, sign, right)
            claim, left = (Both(claim, one) if claim else one), right
        assert claim is not None  # the loop ran
        return claim

    def _is(self, left: _Operand) -> Claim:
        wanted = self._accept("not") is None
        state = self._accept("known", "unknown")
        if state is None:
            claim = self._compared(left, "==", self._sum())
            return claim if wanted else claim.negated()
        if len(left.sum.signals) != 1 or left.sum.constant != 0.0:
            raise self._error(left.column, f"only a single signal can be {state}")
        return Known(left.sum.signals[0][1], wanted == (state == "known"))

    def _compared(self, left: _Operand, sign: str, right: _Operand) -> Claim:
        """One comparison."""
        if left.level or right.level:
            return self._fear(left, sign, right)
        if left.unit is not None and right.unit is not None and left.unit != right.unit:
            raise self._error(
                right.column,
                f"this is in {right.unit or '1'}, what it is compared with in {left.unit or '1'}",
            )
        difference = left.sum + -right.sum
        if not difference.signals:
            raise self._error(left.column, "expected a signal in the comparison, found only numbers")
        return _ordered(difference, sign)

    def _fear(self, left: _Operand, sign: str, right: _Operand) -> Claim:
        """Fear against one of its levels, which are stretches: `<= high` is below where more than high begins."""
        fear = Sum(((1.0, Signal("decision.fear")),), 0.0)
        if right.level is None or left.sum != fear:
            raise self._error(left.column, "expected fear before a level, as in 'fear >= high'")
        low, high = fear_border(right.level)
        from_low, to_high = Above(_lowered(fear, low), False), Above(_lowered(fear, high), False).negated()
        claims: dict[str, Claim] = {
            ">=": from_low,
            "<": from_low.negated(),
            "<=": to_high,
            ">": to_high.negated(),
            "!=": Either(from_low.negated(), to_high.negated()),
        }
        return claims.get(sign, Both(from_low, to_high))

    def _sum(self) -> _Operand:
        """[-] term {+|- term}."""
        column = self._token.column
        total, unit, level = Sum((), 0.0), None, None
        sign: str | None = self._accept("-", "+") or "+"
        while sign:
            term = self._term()
            if unit is not None and term.unit is not None and unit != term.unit:
                raise self._error(term.column, f"cannot add {term.unit or '1'} to {unit or '1'}")
            unit = term.unit if unit is None else unit
            level = term.level or level
            total = total + (-term.sum if sign == "-" else term.sum)
            sign = self._accept("+", "-")
        return _Operand(total, unit, column, level)

    def _term(self) -> _Operand:
        """number [unit] | signal | |signal| | level."""
        token = self._token
        if token.kind == "number":
            self._advance()
            unit, factor = UNITS[token.unit] if token.unit else (None, 1.0)
            return _Operand(Sum((), float(token.text) * factor), unit, token.column)
        if self._accept("|"):
            signal = self._signal()
            if not self._accept("|"):
                self._fail("'|'")
            signal = replace(signal, absolute=True)
        elif token.kind == "name" and token.text in LEVELS:
            self._advance()
            return _Operand(Sum((), 0.0), None, token.column, level=token.text)
        else:
            signal = self._signal()
        return _Operand(Sum(((1.0, signal),), 0.0), signal.unit, token.column)

    def _signal(self) -> Signal:
        token = self._token
        if token.kind != "name" or token.text in _RESERVED:
            self._fail("a signal or a number")
        signal = find_signal(token.text)
        if signal is None:
            hint = close_to(token.text, [*signal_names(), *LEVELS])
            raise self._error(token.column, f"no signal {token.text!r}{hint}")
        self._advance()
        return signal

    # Tokens.

    @property
    def _token(self) -> _Token:
        return self._tokens[self._at]

    def _advance(self) -> None:
        self._at += 1

    def _accept(self, *words: str) -> str | None:
        """Step over one of ``words`` if it is next."""
        if self._token.kind in ("name", "symbol") and self._token.text in words:
            self._advance()
            return self._tokens[self._at - 1].text
        return None

    def _fail(self, expected: str) -> NoReturn:
        found = "the end" if self._token.kind == "end" else repr(self._token.text)
        raise self._error(self._token.column, f"expected {expected}, found {found}")

    def _error(self, column: int, message: str) -> ValueError:
        return ValueError(f"{self._text!r}, column {column}: {message}")


def _tokens(text: str) -> list[_Token]:
    tokens, at = [], 0
    text = text.rstrip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        assert match is not None and match.lastgroup is not None  # `bad` takes any character
        kind = "number" if match["number"] else match.lastgroup
        column = match.start(kind) + 1
        if kind == "bad":
            raise ValueError(f"{text!r}, column {column}: {match['bad']!r} means nothing here")
        tail = _UNKNOWN_UNIT.match(text, match.end()) if kind == "number" and not match["unit"] else None
        if tail and tail[0].strip() not in _RESERVED:
            raise ValueError(
                f"{text!r}, column {tail.start(1) + 1}: no unit {tail[1]!r}; there are {', '.join(UNITS)}"
            )
        word = _SPELLINGS.get(match[kind], match[kind])
        tokens.append(_Token(kind, word, column, match.end(), match["unit"]))
        at = match.end()
    return [*tokens, _Token("end", "", len(text) + 1, len(text))]


def _ordered(difference: Sum, sign: str) -> Claim:
    """``difference`` compared with zero."""
    above, below = Above(difference, False), Above(-difference, False)
    claims: dict[str, Claim] = {
        ">=": above,
        "<=": below,
        ">": below.negated(),
        "<": above.negated(),
        "!=": Either(below.negated(), above.negated()),
    }
    return claims.get(sign, Both(above, below))


def _lowered(total: Sum, by: float) -> Sum:
    return Sum(total.signals, total.constant - by)


def _set_twice(before: Scope, after: Scope, field: str) -> bool:
    old, new = getattr(before, field), getattr(after, field)
    return old is not None and old is not new
