"""The meaning of a condition: its syntax tree to a claim and a scope."""

from dataclasses import dataclass, replace
from typing import Any

from lark import Token
from lark.exceptions import VisitError
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive, v_args

from sim_harness.judging.conditions.claims import Above, Active, Both, Claim, Either, Is, Known, Sum
from sim_harness.judging.conditions.grammar import COMPARISON, SentenceError, error_after, parse_tree
from sim_harness.judging.conditions.scopes import Around, Begins, Counted, Elapsed, Ending, Instant, Scope
from sim_harness.judging.conditions.signals import (
    UNITS,
    Signal,
    close_to,
    fear_border,
    find_signal,
    signal_names,
)
from supervisor.rules.rule_file import LEVELS
from trepid.messages import Mode, Stop

_SPELLINGS = {"≥": ">=", "≤": "<=", "≠": "!=", "=": "=="}
_FEAR = Sum(((1.0, Signal("decision.fear")),), 0.0)
_LABEL_WORDS = {"mode": [mode.value for mode in Mode], "stop": [stop.value for stop in Stop]}


@dataclass(frozen=True, slots=True)
class Word:
    """A name in a sentence that must be known in its scenario, and its column, from 1."""

    kind: str  # event (a fault, disturbance, manoeuvre or section), estimator, or the label that has the word
    text: str
    column: int


@dataclass(frozen=True, slots=True)
class Sentence:
    """The meaning of a sentence."""

    claim: Claim
    scope: Scope
    eventually: bool
    words: tuple[Word, ...]


@dataclass(frozen=True, slots=True)
class _Operand:
    """A side of a comparison; ``unit`` None: a bare number, which takes the unit of the other side."""

    sum: Sum
    unit: str | None
    offset: int
    level: str | None = None


@dataclass(frozen=True, slots=True)
class _Limit:
    """The fields of a scope that one of its words sets."""

    word: Token
    fields: dict[str, Any]


def parse(text: str) -> Sentence:
    """The meaning of ``text``. Raises SentenceError: the column, the text found there and the text expected."""
    tree = parse_tree(text)
    meaning = _Meaning(text)
    try:
        quantifier, claim, *limits = meaning.transform(tree)
    except VisitError as error:
        raise error.orig_exc from None
    scope = Scope()
    taken: set[str] = set()
    for limit in limits:
        if taken & limit.fields.keys():
            offset = limit.word.start_pos or 0
            raise SentenceError(text, offset, f"{str(limit.word)!r} limits again what was limited before")
        taken |= limit.fields.keys()
        scope = replace(scope, **limit.fields)
    at_some_time = any(limit.word == "within" for limit in limits)
    eventually = quantifier == "eventually" or (quantifier is None and at_some_time)
    words = sorted(meaning.words, key=lambda word: word.column)
    return Sentence(claim.negated() if quantifier == "never" else claim, scope, eventually, tuple(words))


class _Meaning(Transformer_NonRecursive[Token, Any]):
    """The meaning of each rule of the grammar, from the meanings of its parts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text
        self.words: list[Word] = []

    def start(self, parts: list[Any]) -> list[Any]:
        return parts

    # Claims.

    def conjunction(self, parts: list[Claim]) -> Claim:
        return Both(*parts)

    def disjunction(self, parts: list[Claim]) -> Claim:
        return Either(*parts)

    def negation(self, parts: list[Any]) -> Claim:
        claim: Claim = parts[1].negated()
        return claim

    def active(self, parts: list[Token]) -> Claim:
        """A name alone; the name of a signal needs a comparison."""
        name = parts[0]
        if name.type == "NAME" and find_signal(name):
            raise error_after(self._text, name.end_pos or 0, COMPARISON)
        return self._named(name)

    def _named(self, name: Token) -> Claim:
        return Active(self._noted("event", name))

    def _noted(self, kind: str, name: Token) -> str:
        """``name`` without quotes, kept as a word of the sentence."""
        column = (name.start_pos or 0) + 1 + (name.type == "QUOTED")
        self.words.append(Word(kind, name.strip("'"), column))
        return name.strip("'")

    def label(self, parts: list[Any]) -> Claim:
        label, comparison, negated, token = parts
        word = self._noted(str(label), token)
        known = _LABEL_WORDS.get(label)
        if known is not None:
            same = [name for name in known if name.lower() == word.lower()]
            if not same:
                message = f"{label} has no {word!r}; it has {', '.join(known)}{close_to(word, known)}"
                raise SentenceError(self._text, token.start_pos, message)
            word = same[0]
        return Is(str(label), word, (negated is None) == (comparison not in ("!=", "≠")))

    def comparison(self, parts: list[Any]) -> Claim:
        """sum {operator sum}: all of the comparisons hold."""
        claim = self._compared(*parts[:3])
        for i in range(2, len(parts) - 2, 2):
            claim = Both(claim, self._compared(*parts[i : i + 3]))
        return claim

    def equality(self, parts: list[Any]) -> Claim:
        """sum is [not] known|unknown|sum."""
        left, _, negated, right = parts
        if isinstance(right, _Operand):
            claim = self._compared(left, "==", right)
            return claim if negated is None else claim.negated()
        if len(left.sum.signals) != 1 or left.sum.constant != 0.0:
            raise SentenceError(self._text, left.offset, f"only a single signal can be {right}")
        return Known(left.sum.signals[0][1], (negated is None) == (right == "known"))

    def _compared(self, left: _Operand, sign: str, right: _Operand) -> Claim:
        """One comparison."""
        sign = _SPELLINGS.get(sign, sign)
        if right.level is not None and left.sum == _FEAR and left.level is None:
            return _fear_at(sign, right.level)
        if left.level or right.level:
            message = "expected fear before a level, as in 'fear >= high'"
            raise SentenceError(self._text, left.offset, message)
        if left.unit is not None and right.unit is not None and left.unit != right.unit:
            message = f"this is in {right.unit or '1'}, what it is compared with in {left.unit or '1'}"
            raise SentenceError(self._text, right.offset, message)
        difference = left.sum + -right.sum
        if not difference.signals:
            message = "expected a signal in the comparison, found only numbers"
            raise SentenceError(self._text, left.offset, message)
        return _ordered(difference, sign)

    # Sums.

    def sum(self, parts: list[Any]) -> _Operand:
        """[sign] term {sign term}, all in one unit."""
        first = parts[1]
        total, unit, level = Sum((), 0.0), None, None
        for sign, term in zip(parts[::2], parts[1::2], strict=True):
            if unit is not None and term.unit is not None and unit != term.unit:
                raise SentenceError(
                    self._text, term.offset, f"cannot add {term.unit or '1'} to {unit or '1'}"
                )
            unit = term.unit if unit is None else unit
            level = term.level or level
            total = total + (-term.sum if sign in ("-", "−") else term.sum)
        offset = first.offset if parts[0] is None else parts[0].start_pos
        return _Operand(total, unit, offset, level)

    def number(self, parts: list[Any]) -> _Operand:
        number, unit = parts
        name, factor = UNITS[unit] if unit else (None, 1.0)
        return _Operand(Sum((), float(number) * factor), name, number.start_pos)

    def signal(self, parts: list[Token]) -> _Operand:
        return self._signal(parts[0], absolute=False)

    def magnitude(self, parts: list[Token]) -> _Operand:
        return self._signal(parts[0], absolute=True)

    def _signal(self, name: Token, *, absolute: bool) -> _Operand:
        signal = find_signal(name)
        offset = name.start_pos or 0
        if signal is None:
            hint = close_to(name, [*signal_names(), *LEVELS])
            raise SentenceError(self._text, offset, f"no signal {str(name)!r}{hint}")
        if signal.estimator:
            self.words.append(Word("estimator", signal.estimator, offset + 1))
        signal = replace(signal, absolute=absolute)
        return _Operand(Sum(((1.0, signal),), 0.0), signal.unit, offset)

    def level(self, parts: list[Token]) -> _Operand:
        return _Operand(Sum((), 0.0), None, parts[0].start_pos or 0, level=str(parts[0]))

    # Scopes.

    def around(self, parts: list[Any]) -> _Limit:
        """within|for D s of|after|before [any] event."""
        word, duration_s, side, may_lack, event = parts
        before_s, after_s = (duration_s, 0.0) if side == "before" else (0.0, duration_s)
        return _Limit(word, {"around": Around(event, before_s, after_s, must_happen=may_lack is None)})

    def condition(self, parts: list[Any]) -> _Limit:
        word, claim = parts
        return _Limit(word, {"while_claim": claim, "while_must_hold": word != "whenever"})

    def during(self, parts: list[Token]) -> _Limit:
        return _Limit(parts[0], {"while_claim": self._named(parts[1])})

    def since(self, parts: list[Any]) -> _Limit:
        return _Limit(parts[0], {"start": parts[1]})

    def up_to(self, parts: list[Any]) -> _Limit:
        return _Limit(parts[0], {"end": parts[1]})

    def interval(self, parts: list[Any]) -> _Limit:
        return _Limit(parts[0], {"start": parts[1], "end": parts[-1]})

    def moment(self, parts: list[Any]) -> _Limit:
        return _Limit(parts[0], {"start": parts[1], "end": parts[1]})

    def elapsed(self, parts: list[float]) -> Instant:
        return Elapsed(parts[0])

    def ending(self, _: list[Token]) -> Instant:
        return Ending()

    def counted(self, parts: list[Token]) -> Instant:
        return Counted(str(parts[0]))

    @v_args(meta=True)
    def becomes(self, meta: Meta, parts: list[Any]) -> Instant:
        claim, edge = parts
        text = self._text[meta.start_pos : meta.end_pos]
        ends = edge == "ends"
        return Begins(claim.negated() if ends else claim, text, after_start=ends)

    def seconds(self, parts: list[Any]) -> float:
        """A duration or a time [s]."""
        number, written = parts
        unit, factor = UNITS[written] if written else ("s", 1.0)
        if unit != "s":
            message = f"expected a time in s, got {str(written)!r}"
            raise SentenceError(self._text, number.start_pos, message)
        return float(number) * factor


def _fear_at(sign: str, level: str) -> Claim:
    """Fear against one of its levels, which are intervals: ``<= high`` is below the upper border of high."""
    low, high = fear_border(level)
    from_low, to_high = Above(_lowered(_FEAR, low), False), Above(_lowered(_FEAR, high), False).negated()
    claims: dict[str, Claim] = {
        ">=": from_low,
        "<": from_low.negated(),
        "<=": to_high,
        ">": to_high.negated(),
        "!=": Either(from_low.negated(), to_high.negated()),
    }
    return claims.get(sign, Both(from_low, to_high))


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
