"""Rule files from IEC 61131-7 Fuzzy Control Language, in the subset that :mod:`supervisor.rules.fcl.export` writes.

One function block; inputs with the five terms as points of degree 0 or 1; outputs fear and trust_NAME with
triangles, or singletons, of which each reaches down to its neighbours; MIN, MAX, COG. A file without our OPTION
block is read as what it says, Mamdani's method; the direction of every risk must be told, ``OPTION RISK speed :=
rising; END_OPTION``, because nothing else tells it.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError

from supervisor.rules.fcl.export import FCL_WORDS, points
from supervisor.rules.fcl.words import Token, Words
from supervisor.rules.inference import DISTRUST_AT
from supervisor.rules.membership import level_sets
from supervisor.rules.rule_file import FEAR, LEVELS, TRUST_PREFIX, RuleFile
from supervisor.rules.sentence import SentenceError, parse_rule
from trepid import config

Corner = tuple[float, float]
_PER_INPUT = {"MEANING": "meaning", "UNIT": "unit", "RISK": "risk", "MISSING": "missing", "BEYOND": "beyond"}
_PER_LEVEL = {"SPEED_FACTOR": "speed_factor", "MODE": "mode"}
_ONLY = {"AND": "MIN", "OR": "MAX", "ACT": "MIN", "ACCU": "MAX", "METHOD": "COG"}


def parse_fcl(text: str, *, source: object, like: RuleFile) -> RuleFile:
    """The rules in ``text``. Actions and hysteresis that it does not tell are those of ``like``.

    Raises InputError with source:line:column of the first thing that is wrong, and what was expected there.
    """
    return _Reader(Words(text, source), like).file()


class _Reader:
    """Recursive descent over the blocks; gathers what a rule file holds, and where each part stood."""

    def __init__(self, words: Words, like: RuleFile) -> None:
        self.words = words
        self.inputs: dict[str, dict[str, Any]] = {}
        self.outputs: dict[str, dict[str, tuple[Token, list[Corner]]]] = {}
        self.rules: list[tuple[str, list[tuple[int, Token]]]] = []
        self.labels: dict[str, int] = {}
        self.causes: dict[int, str] = {}
        self.places: dict[tuple[str | int, ...], Token] = {(): words.next}
        self.actions = {
            level: action.model_dump() for level, action in zip(LEVELS, like.fear.all, strict=True)
        }
        self.hysteresis: dict[str, Any] = like.hysteresis.model_dump()
        self.head: dict[str, Any] = {"method": "mamdani"}

    def file(self) -> RuleFile:
        words = self.words
        words.take("FUNCTION_BLOCK")
        words.name()
        blocks: dict[str, Callable[[], None]] = {
            "VAR_INPUT": self.var_input,
            "VAR_OUTPUT": self.var_output,
            "FUZZIFY": self.fuzzify,
            "DEFUZZIFY": self.defuzzify,
            "RULEBLOCK": self.ruleblock,
            "OPTION": self.option,
        }
        while not words.skip("END_FUNCTION_BLOCK"):
            blocks[words.take(*blocks, "END_FUNCTION_BLOCK").keyword]()
        if words.next.kind != "end":
            raise words.error(words.next, "the end of the file: one function block is a rule file")
        return self.checked()

    def var_input(self) -> None:
        for name in self.variables():
            self.inputs[name.text] = {"meaning": name.text, "unit": "1", "sets": {}}
            self.places["inputs", name.text] = name

    def var_output(self) -> None:
        for name in self.variables():
            if name.text != FEAR and not name.text.startswith(TRUST_PREFIX):
                raise self.words.error(name, f"{FEAR!r} or {TRUST_PREFIX}NAME", close_to=[FEAR])
            self.outputs[name.text] = {}
            self.places["estimators", len(self.outputs) - 1] = name

    def variables(self) -> list[Token]:
        names: list[Token] = []
        while not self.words.skip("END_VAR"):
            names.append(self.words.name())
            self.words.take(":")
            self.words.take("REAL")
            self.words.take(";")
        return names

    def fuzzify(self) -> None:
        name = self.words.name(self.inputs, what="one").text
        spec = self.inputs[name]
        while not self.words.skip("END_FUZZIFY"):
            if self.words.take("TERM", "RANGE", "END_FUZZIFY").keyword == "RANGE":
                spec["range"] = self.range()
                continue
            level, corners = self.term()
            spec["sets"][level.text] = _trapezoid(self.words, level, corners)
            self.places["inputs", name, "sets", level.text] = level
        if len(spec["sets"]) == len(LEVELS):
            ends = spec["sets"]["very_low"][0], spec["sets"]["very_high"][-1]
            spec.setdefault("range", ends)

    def defuzzify(self) -> None:
        terms = self.outputs[self.words.name(self.outputs, what="one").text]
        while not self.words.skip("END_DEFUZZIFY"):
            word = self.words.take("TERM", "ACCU", "METHOD", "DEFAULT", "RANGE", "END_DEFUZZIFY")
            if word.keyword == "TERM":
                level, corners = self.term()
                terms[level.text] = level, corners
            elif word.keyword == "RANGE":
                self.fixed(self.range() == (0, 1), word, "the range 0 .. 1")
            elif word.keyword == "DEFAULT":
                self.words.take(":=")
                self.fixed(
                    self.words.number() == 1,
                    word,
                    "the default 1: where no rule speaks, fear and trust are 1",
                )
                self.words.take(";")
            else:
                self.setting(word)

    def fixed(self, good: bool, token: Token, expected: str) -> None:
        if not good:
            raise self.words.wrong(token, f"expected {expected}")

    def setting(self, word: Token) -> None:
        self.words.take(":")
        self.words.take(_ONLY[word.keyword])
        self.words.take(";")

    def range(self) -> tuple[float, float]:
        for sign in (":=", "("):
            self.words.take(sign)
        low = self.words.number()
        self.words.take("..")
        high = self.words.number()
        for sign in (")", ";"):
            self.words.take(sign)
        return low, high

    def term(self) -> tuple[Token, list[Corner]]:
        """``NAME := 0.5;`` or ``NAME := (x, y) (x, y) ...;``"""
        level = self.words.name(LEVELS, what="one")
        self.words.take(":=")
        corners: list[Corner] = []
        if self.words.next.kind == "number":
            corners.append((self.words.number(), 1.0))
        while not self.words.skip(";"):
            self.words.take("(", ";")
            x = self.words.number()
            self.words.take(",")
            corners.append((x, self.words.number()))
            self.words.take(")")
        return level, corners

    def ruleblock(self) -> None:
        self.words.name()
        while not self.words.skip("END_RULEBLOCK"):
            word = self.words.take("RULE", "AND", "OR", "ACT", "ACCU", "END_RULEBLOCK")
            if word.keyword == "RULE":
                self.rule()
            else:
                self.setting(word)

    def rule(self) -> None:
        label = self.words.value()
        self.fixed(label.text not in self.labels, label, "a number that no rule had before")
        self.labels[label.text] = len(self.rules)
        self.places["rules", len(self.rules)] = label
        self.words.take(":")
        sentence, heard = "", []
        while not self.words.skip(";"):
            weight = self.words.skip("WITH")
            token = self.words.next if self.words.next.text in "()" else self.words.value()
            if token.text in "()":
                self.words.take(token.text)
            word = token.text.lower() if token.text.lower() in FCL_WORDS else token.text
            apart = sentence and not sentence.endswith("(") and word != ")"
            sentence += " with weight " if weight else " " * bool(apart)
            heard.append((len(sentence), token))
            sentence += word
        self.rules.append((sentence, heard))

    def option(self) -> None:
        words = self.words
        while not words.skip("END_OPTION"):
            word = words.take(*_PER_INPUT, *_PER_LEVEL, "HYSTERESIS", "METHOD", "BECAUSE", "END_OPTION")
            store, around, key = self.stored(word)
            words.take(":=")
            self.places[(*around, key)] = words.next
            store[key] = _plain(words.value())
            words.take(";")

    def stored(self, word: Token) -> tuple[dict[Any, Any], tuple[str, ...], Any]:
        """Where the value of an option goes: a mapping, its place in the file, and the key."""
        words = self.words
        if word.keyword in _PER_INPUT:
            name = words.name(self.inputs, what="one").text
            return self.inputs[name], ("inputs", name), _PER_INPUT[word.keyword]
        if word.keyword in _PER_LEVEL:
            level = words.name(LEVELS, what="one").text
            return self.actions[level], ("fear", level), _PER_LEVEL[word.keyword]
        if word.keyword == "HYSTERESIS":
            return self.hysteresis, ("hysteresis",), words.name(self.hysteresis, what="one").text
        if word.keyword == "METHOD":
            return self.head, (), "method"
        label = words.value()
        self.fixed(label.text in self.labels, label, "the number of a rule above")
        return self.causes, ("causes",), self.labels[label.text]

    def checked(self) -> RuleFile:
        for level, place in zip(LEVELS, self.peaks(FEAR), strict=True):
            self.actions[level]["at"] = place
        estimators = [name.removeprefix(TRUST_PREFIX) for name in self.outputs if name != FEAR]
        for name in estimators:
            self.peaks(TRUST_PREFIX + name)
        data = {
            **self.head,
            "estimators": estimators,
            "inputs": self.inputs,
            "rules": [self.sentence(index) for index in range(len(self.rules))],
            "fear": self.actions,
            "hysteresis": self.hysteresis,
        }
        try:
            file = RuleFile.model_validate(data)
        except ValidationError as error:
            raise self.words.wrong(self.place(error.errors()[0]["loc"]), _complaint(error, data)) from error
        for index in range(len(self.rules)):
            self.understood(index, file)
        return file

    def peaks(self, output: str) -> tuple[float, ...]:
        """Where the terms of an output stand; each must reach down to its neighbours."""
        if output not in self.outputs:
            raise self.words.wrong(self.places[()], f"no output {output!r}: expected it in VAR_OUTPUT")
        terms = self.outputs[output]
        missing = [level for level in LEVELS if level not in terms]
        if missing:
            raise self.words.wrong(self.places[()], f"{output} has no TERM {missing[0]}")
        at = tuple(next((x for x, y in terms[level][1] if y == 1), float("nan")) for level in LEVELS)
        for level, shape in level_sets(at).items():
            token, corners = terms[level]
            if len(corners) != 1 and corners != points(shape):
                expected = " ".join(f"({x:g}, {y})" for x, y in points(shape))
                raise self.words.wrong(token, f"expected {level} to reach down to its neighbours: {expected}")
        if output != FEAR and at != DISTRUST_AT:
            raise self.words.wrong(
                terms["low"][0], f"expected trust at {', '.join(f'{x:g}' for x in DISTRUST_AT)}"
            )
        return at

    def sentence(self, index: int) -> str:
        cause = self.causes.get(index)
        return self.rules[index][0] + (f" because {cause}" if cause else "")

    def understood(self, index: int, file: RuleFile) -> None:
        """Refuse a rule that says nothing, at the word where it goes wrong."""
        try:
            parse_rule(self.sentence(index), file.inputs, outputs=file.outputs)
        except SentenceError as error:
            heard = [token for offset, token in self.rules[index][1] if offset <= error.offset]
            raise self.words.wrong(heard[-1] if heard else self.places["rules", index], str(error)) from error

    def place(self, path: tuple[str | int, ...]) -> Token:
        """Where the part of the file at ``path``, or the nearest part around it, stood."""
        while path not in self.places:
            path = path[:-1]
        return self.places[path]


def _trapezoid(words: Words, level: Token, corners: list[Corner]) -> list[float]:
    """The points of trimf or trapmf whose corners these are."""
    top = [x for x, y in corners if y == 1]
    rises, falls = (
        corners[:1] != [(top[0], 1)] if top else True,
        corners[-1:] != [(top[-1], 1)] if top else True,
    )
    if [y for _, y in corners] != [*[0] * rises, *[1] * len(top), *[0] * falls] or not 0 < len(top) <= 2:
        raise words.wrong(
            level, "expected points that rise from 0 to 1 once and fall to 0 once, or shoulders at 1"
        )
    return [corners[0][0], *top, corners[-1][0]]


def _plain(token: Token) -> Any:
    if token.kind == "number":
        return float(token.text)
    if token.kind == "text":
        return re.sub(r"\$(.)", r"\1", token.text[1:-1])
    return token.text


def _complaint(error: ValidationError, data: Mapping[str, Any]) -> str:
    problem = error.errors()[0]
    if problem["type"] == "missing" and problem["loc"][-1] == "risk":
        return (
            f"which way is {problem['loc'][1]} a risk? Expected RISK {problem['loc'][1]} := rising; in OPTION"
        )
    return config.complaint(error, data, RuleFile)
