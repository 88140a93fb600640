"""The meaning of a condition: its syntax tree to a claim and a scope."""

from dataclasses import dataclass, replace
from typing import Any

from lark import Token
from lark.exceptions import VisitError
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive, v_args

from sim_harness.judging.conditions.claims import (
    Active,
    AtLeastZero,
    Both,
    Claim,
    Is,
    SignalPresent,
    Sum,
    negate,
)
from sim_harness.judging.conditions.conditions import Condition, Word
from sim_harness.judging.conditions.grammar import COMPARISON, SentenceError, error_after, parse_tree
from sim_harness.judging.conditions.scopes import (
    Around,
    Begins,
    CountedEvents,
    ElapsedInstant,
    Ending,
    Instant,
    Scope,
)
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

_SPELLINGS = {"≥": ">=", "≤": "<=", "≠": "!=", "=": "==", "is": "=="}
_FEAR = Sum(((1.0, Signal("decision.fear")),), 0.0)
_LABEL_WORDS = {"mode": [mode.value for mode in Mode], "stop": [stop.value for stop in Stop]}


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


def parse_condition(text: str) -> Condition:
    """The condition that ``text`` states. Raises SentenceError: the column, and the text found and expected."""
    tree = parse_tree(text)
    try:
        condition: Condition = _Meaning(text).transform(tree)
    except VisitError as error:
        raise error.orig_exc from None
    return condition


@v_args(inline=True)
class _Meaning(Transformer_NonRecursive[Token, Any]):
    """The meaning of each rule of the grammar, from the meanings of its parts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text
        self._words: list[Word] = []

    def start(self, quantifier: Token | None, claim: Claim, *limits: _Limit) -> Condition:
        scope, taken = Scope(), set[str]()
        for limit in limits:
            if taken & limit.fields.keys():
                raise self._error(limit.word, f"{str(limit.word)!r} limits again what was limited before")
            taken |= limit.fields.keys()
            scope = replace(scope, **limit.fields)
        at_some_time = quantifier is None and any(limit.word == "within" for limit in limits)
        return Condition(
            self._text,
            negate(claim) if quantifier == "never" else claim,
            scope,
            eventually=quantifier == "eventually" or at_some_time,
            words=tuple(sorted(self._words, key=lambda word: word.column)),
        )

    def _error(self, place: Token | _Operand, message: str) -> SentenceError:
        offset = place.offset if isinstance(place, _Operand) else place.start_pos or 0
        return SentenceError(self._text, offset, message)

    # Claims.

    conjunction = Both

    def disjunction(self, first: Claim, second: Claim) -> Claim:
        return negate(Both(negate(first), negate(second)))

    def negation(self, _: Token, claim: Claim) -> Claim:
        return negate(claim)

    def active(self, name: Token) -> Claim:
        """A name alone; the name of a signal needs a comparison."""
        if name.type == "NAME" and find_signal(name):
            raise error_after(self._text, name.end_pos or 0, COMPARISON)
        return Active(self._note_name("event", name))

    def _note_name(self, kind: str, name: Token) -> str:
        """``name`` without quotes, kept as a word of the sentence."""
        column = (name.start_pos or 0) + 1 + (name.type == "QUOTED")
        self._words.append(Word(kind, name.strip("'"), column))
        return name.strip("'")

    def label(self, label: Token, comparison: Token, not_: Token | None, token: Token) -> Claim:
        word = self._note_name(str(label), token)
        known = _LABEL_WORDS.get(label)
        if known is not None:
            same = [name for name in known if name.lower() == word.lower()]
            if not same:
                hint = close_to(word, known)
                raise self._error(token, f"{label} has no {word!r}; it has {', '.join(known)}{hint}")
            word = same[0]
        claim = Is(str(label), word)
        return claim if (not_ is None) == (comparison not in ("!=", "≠")) else negate(claim)

    def comparison(self, left: _Operand, sign: Token, right: _Operand, *more: Any) -> Claim:
        """sum operator sum {operator sum}: all of the comparisons hold."""
        claim = self._comparison(left, sign, right)
        return Both(claim, self.comparison(right, *more)) if more else claim

    def equality(self, left: _Operand, sign: Token, not_: Token | None, right: _Operand | Token) -> Claim:
        """sum is [not] known|unknown|sum."""
        if isinstance(right, _Operand):
            claim = self._comparison(left, sign, right)
        elif len(left.sum.terms) != 1 or left.sum.constant != 0.0:
            raise self._error(left, f"only a single signal can be {right}")
        else:
            known = SignalPresent(left.sum.terms[0][1])
            claim = known if right == "known" else negate(known)
        return claim if not_ is None else negate(claim)

    def _comparison(self, left: _Operand, sign: Token, right: _Operand) -> Claim:
        """One comparison. The levels of fear are intervals: ``<= high`` is below the upper border of high."""
        if right.level is not None and left.sum == _FEAR and left.level is None:
            low, high = (Sum((), -border) for border in fear_border(right.level))
            return _ordered_claim(AtLeastZero(_FEAR + low), sign, negate(AtLeastZero(_FEAR + high)))
        if left.level or right.level:
            raise self._error(left, "expected fear before a level, as in 'fear >= high'")
        if left.unit is not None and right.unit is not None and left.unit != right.unit:
            message = f"this is in {right.unit or '1'}, what it is compared with in {left.unit or '1'}"
            raise self._error(right, message)
        difference = left.sum + -right.sum
        if not difference.terms:
            raise self._error(left, "expected a signal in the comparison, found only numbers")
        return _ordered_claim(AtLeastZero(difference), sign, AtLeastZero(-difference))

    # Sums.

    def sum(self, sign: Token | None, first: _Operand, *more: Any) -> _Operand:
        """[sign] term {sign term}, all in one unit."""
        total = first.sum if sign in (None, "+") else -first.sum
        unit, level = first.unit, first.level
        for following, term in zip(more[::2], more[1::2], strict=True):
            if unit is not None and term.unit is not None and unit != term.unit:
                raise self._error(term, f"cannot add {term.unit or '1'} to {unit or '1'}")
            unit = term.unit if unit is None else unit
            level = term.level or level
            total = total + (term.sum if following == "+" else -term.sum)
        return _Operand(total, unit, first.offset if sign is None else sign.start_pos or 0, level)

    def number(self, number: Token, unit: Token | None) -> _Operand:
        name, factor = UNITS[unit] if unit else (None, 1.0)
        return _Operand(Sum((), float(number) * factor), name, number.start_pos or 0)

    def signal(self, name: Token, *, absolute: bool = False) -> _Operand:
        signal = find_signal(name)
        if signal is None:
            raise self._error(name, f"no signal {str(name)!r}{close_to(name, [*signal_names(), *LEVELS])}")
        offset = name.start_pos or 0
        if signal.estimator:
            self._words.append(Word("estimator", signal.estimator, offset + 1))
        return _Operand(Sum(((1.0, replace(signal, absolute=absolute)),), 0.0), signal.unit, offset)

    def magnitude(self, name: Token) -> _Operand:
        return self.signal(name, absolute=True)

    def level(self, name: Token) -> _Operand:
        return _Operand(Sum((), 0.0), None, name.start_pos or 0, level=str(name))

    # Scopes.

    def around(
        self, word: Token, duration_s: float, side: Token, may_lack: Token | None, event: Instant
    ) -> _Limit:
        """within|for D s of|after|before [any] event."""
        before_s, after_s = (duration_s, 0.0) if side == "before" else (0.0, duration_s)
        return _Limit(word, {"around": Around(event, before_s, after_s, must_happen=may_lack is None)})

    def condition(self, word: Token, claim: Claim) -> _Limit:
        return _Limit(word, {"while_claim": claim, "while_must_hold": word != "whenever"})

    def during(self, word: Token, name: Token) -> _Limit:
        return _Limit(word, {"while_claim": Active(self._note_name("event", name))})

    def since(self, word: Token, start: Instant) -> _Limit:
        return _Limit(word, {"start": start})

    def up_to(self, word: Token, end: Instant) -> _Limit:
        return _Limit(word, {"end": end})

    def interval(self, word: Token, start: Instant, *rest: Any) -> _Limit:
        return _Limit(word, {"start": start, "end": rest[-1]})

    def moment(self, word: Token, instant: Instant) -> _Limit:
        return _Limit(word, {"start": instant, "end": instant})

    elapsed, ending, counted = ElapsedInstant, Ending, CountedEvents

    @v_args(meta=True, inline=True)
    def becomes(self, meta: Meta, claim: Claim, edge: Token | None) -> Instant:
        text = self._text[meta.start_pos : meta.end_pos]
        ends = edge == "ends"
        return Begins(negate(claim) if ends else claim, text, after_start=ends)

    def seconds(self, number: Token, written: Token | None) -> float:
        """A duration or a time [s]."""
        unit, factor = UNITS[written] if written else ("s", 1.0)
        if unit != "s":
            raise self._error(number, f"expected a time in s, got {str(written)!r}")
        return float(number) * factor


def _ordered_claim(at_least: Claim, sign: Token, at_most: Claim) -> Claim:
    """The comparison ``sign``, from the claims that its left side is at least and at most its right side."""
    claims: dict[str, Claim] = {
        ">=": at_least,
        "<=": at_most,
        ">": negate(at_most),
        "<": negate(at_least),
        "==": Both(at_least, at_most),
        "!=": negate(Both(at_least, at_most)),
    }
    return claims[_SPELLINGS.get(sign, sign)]
