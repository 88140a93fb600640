"""Rule files from IEC 61131-7 Fuzzy Control Language, in the subset that :mod:`cockpit.rulebook.fcl_export` writes.

One function block; inputs with the five terms as points of degree 0 or 1; outputs fear and trust_NAME with
triangles, or singletons, of which each reaches down to its neighbours; MIN, MAX, COG, or COGS for singletons, whose
centre of gravity is that of these triangles here. A file without the OPTION block of the export is read as
Mamdani's method; the direction of every risk must be given, ``OPTION RISK speed := rising; END_OPTION``, because
FCL has no word for it.
"""

import re
from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any

from lark import Token, Tree
from pydantic import ValidationError

from cockpit.rulebook.fcl_export import FCL_WORDS, points
from cockpit.rulebook.fcl_grammar import Source, hint
from supervisor.rules.inference import DISTRUST_AT
from supervisor.rules.rule_file import FEAR, LEVELS, TRUST_PREFIX, RuleFile, level_sets
from supervisor.rules.sentence import SentenceError, parse_rule
from supervisor.rules.shapes import polyline
from trepid import config
from trepid.causes import unknown_cause

Corner = tuple[float, float]
PIECEWISE = {"trian": (0.0, 1.0, 0.0), "trape": (0.0, 1.0, 1.0, 0.0)}
"""Degrees of the corners of sets that jFuzzyLogic names by kind (Cingolani and Alcalá-Fdez, FUZZ-IEEE 2012)."""


def parse_fcl(text: str, *, source: object, like: RuleFile) -> RuleFile:
    """The rules in ``text``. Actions and hysteresis that it does not state are those of ``like``.

    Raises InputError with source:line:column of the first error and the expected text.
    """
    return _Reader(Source(text, source), like).file()


class _Reader:
    """Walks over the blocks of the syntax tree; collects the contents of a rule file and the place of each part."""

    def __init__(self, source: Source, like: RuleFile) -> None:
        self.source = source
        self.data: dict[str, Any] = {
            "method": "mamdani",
            "estimators": [],
            "causes": {},
            "without": [],
            "inputs": {},
            "rules": [],
            "fear": {level: getattr(like.fear, level).model_dump() for level in LEVELS},
            "hysteresis": like.hysteresis.model_dump(),
            "because": {},  # cause of each rule that states one
        }
        self.outputs: dict[str, dict[str, tuple[Token, list[Corner]]]] = {}
        self.known = set(LEVELS)  # names of sets and variables
        self.words: list[list[tuple[int, Token]]] = []  # of each rule, with their offsets in its sentence
        self.labels: dict[str, list[int]] = {}  # number of a rule -> its places; every block counts anew
        self.places: dict[tuple[str | int, ...], Token] = {}
        self.cogs: list[tuple[Token, Token]] = []  # outputs with METHOD : COGS, and its place

    def file(self) -> RuleFile:
        _, *blocks = self.source.tree().children
        self.spell(blocks)
        for block in blocks:
            assert isinstance(block, Tree)
            read: Callable[[list[Any]], None] = getattr(self, str(block.data))
            read(block.children)
        return self.check()

    def spell(self, blocks: list[Any]) -> None:
        """Write the names of sets and variables in small letters: capitals make no difference in IEC 61131-3."""
        declared = [
            part for block in blocks if block.data in ("var_input", "var_output") for part in block.children
        ]
        self.known |= {name.lower() for part in declared for name in _names(part)}
        for block in blocks:
            for part in block.iter_subtrees():
                part.children = [self.spell_name(child) for child in part.children]

    def spell_name(self, child: Any) -> Any:
        is_known = isinstance(child, Token) and child.type == "NAME" and child.lower() in self.known
        return child.update(value=child.lower()) if is_known else child

    def var_input(self, parts: list[Any]) -> None:
        for part in parts:
            for name in _names(part):
                self.data["inputs"][str(name)] = {"meaning": str(name), "unit": "1", "sets": {}}
                self.places["inputs", str(name)] = name
                for subrange in part.find_data("subrange"):
                    self.set_range(str(name), subrange)

    def var_output(self, parts: list[Any]) -> None:
        for part in parts:
            for name in _names(part):
                if name != FEAR and not name.startswith(TRUST_PREFIX):
                    expected = f"{FEAR!r} or {TRUST_PREFIX}NAME"
                    self.source.fail(name, f"expected {expected}, got {str(name)!r}{hint(name, [FEAR])}")
                self.outputs[str(name)] = {}
                self.places["estimators", len(self.outputs) - 1] = name
            for subrange in part.find_data("subrange"):
                self.require(_numbers(subrange) == (0, 1), subrange.children[0], "the range 0 .. 1")

    def set_range(self, name: str, part: Any) -> None:
        self.data["inputs"][name]["range"] = _numbers(part)
        self.places["inputs", name, "range"] = part.children[0]

    def fuzzify(self, parts: list[Any]) -> None:
        name = self.source.expect(parts[0], self.data["inputs"])
        spec, ends = self.data["inputs"][name], dict[str, Corner]()
        for part in parts[1:]:
            if part.data == "range":
                self.set_range(name, part)
                continue
            level, corners = self.term(part)
            spec["sets"][str(level)] = self.shape(level, corners)
            ends[str(level)] = corners[0][0], corners[-1][0]
            self.places["inputs", name, "sets", str(level)] = level
        if len(spec["sets"]) == len(LEVELS):
            spec.setdefault("range", (ends["very_low"][0], ends["very_high"][1]))

    def defuzzify(self, parts: list[Any]) -> None:
        terms = self.outputs[self.source.expect(parts[0], self.outputs)]
        for part in parts[1:]:
            if isinstance(part, Token):
                self.cogs.append((parts[0], part))
            elif part.data == "term":
                level, corners = self.term(part)
                terms[str(level)] = level, corners
            elif part.data == "range":
                self.require(_numbers(part) == (0, 1), part.children[0], "the range 0 .. 1")
            else:
                expected = "the default 1: where no rule fires, fear and trust are 1"
                self.require(_numbers(part) == (1,), part.children[0], expected)

    def term(self, part: Any) -> tuple[Token, list[Corner]]:
        """``NAME := 0.5;``, ``NAME := (x, y) (x, y) ...;``, or ``NAME := trian a b c;`` of jFuzzyLogic."""
        level, *corners = part.children
        self.source.expect(level, LEVELS)
        if corners and corners[0].data == "piecewise":
            return level, _piecewise(self.source, *corners[0].children)
        numbers = [_numbers(corner) for corner in corners]
        return level, [(pair[0], pair[1] if len(pair) > 1 else 1.0) for pair in numbers]

    def shape(self, level: Token, corners: list[Corner]) -> Any:
        """The set with these corners: the points of trimf or trapmf, or a polyline."""
        try:
            found = polyline(tuple(corners))
        except ValueError as error:
            self.source.fail(level, str(error))
        if found.rise or found.fall:
            return {"polyline": corners}
        top = [x for x, y in corners if y == 1]
        return [found.a, *top, found.d]

    def ruleblock(self, parts: list[Any]) -> None:
        own: set[str] = set()
        for part in parts[1:]:
            label, *words = part.children
            self.require(label not in own, label, "a number that no earlier rule has in this block")
            own.add(str(label))
            self.labels.setdefault(str(label), []).append(len(self.words))
            self.places["rules", len(self.words)] = label
            sentence, offsets = _sentence(words)
            self.data["rules"].append(sentence)
            self.words.append(offsets)

    def option(self, entries: list[Any]) -> None:
        for entry in entries:
            *around, key = path = self.path(entry)
            value = self.places[path] = entry.children[-1]
            part: Any = self.data
            for name in around:
                part = part[name]
            if isinstance(part, list):
                part.append(str(value))
            else:
                part[key] = _plain(value)

    def path(self, entry: Any) -> tuple[str | int, ...]:
        """Place of an option in the rule file."""
        match entry.data, entry.children:
            case "of_input", [word, name, _]:
                return "inputs", self.source.expect(name, self.data["inputs"]), word.lower()
            case "of_level", [word, level, _]:
                return "fear", self.source.expect(level, LEVELS), word.lower()
            case "hysteresis", [name, _]:
                return "hysteresis", self.source.expect(name, self.data["hysteresis"])
            case "because", [label, _]:
                self.require(label in self.labels, label, "the number of a rule above")
                first, *others = self.labels[str(label)]
                self.require(not others, label, "a number that the rules of one block alone have")
                return "because", first
            case "cause", [name, _]:
                return "causes", str(name)
        return ("without", len(self.data["without"])) if entry.data == "without" else ("method",)

    def require(self, good: bool, token: Token, expected: str) -> None:
        if not good:
            self.source.fail(token, f"expected {expected}")

    def check(self) -> RuleFile:
        for level, place in zip(LEVELS, self.peaks(FEAR), strict=True):
            self.data["fear"][level]["at"] = place
        for name in (name for name in self.outputs if name != FEAR):
            self.peaks(name)
        for output, token in self.cogs:
            singletons = all(len(corners) == 1 for _, corners in self.outputs[str(output)].values())
            self.require(singletons, token, "singletons such as TERM low := 0.25; for COGS, else COG")
            self.source.note(token, "read as COG of triangles that reach down to the neighbouring singletons")
        self.data["estimators"] = [name.removeprefix(TRUST_PREFIX) for name in self.outputs if name != FEAR]
        for index, cause in self.data.pop("because").items():
            self.data["rules"][index] += f" because {cause}"
        data = {key: value for key, value in self.data.items() if value or key not in ("causes", "without")}
        try:
            file = RuleFile.model_validate(data)
        except ValidationError as error:
            self.source.fail(self.place(error.errors()[0]["loc"]), _complaint(error, data))
        for index in range(len(file.rules)):
            self.check_rule(index, file)
        return file

    def peaks(self, output: str) -> tuple[float, ...]:
        """Positions of the terms of an output; each term must reach down to its neighbours."""
        if output not in self.outputs:
            self.source.fail(None, f"no output {output!r}: expected it in VAR_OUTPUT")
        terms = self.outputs[output]
        missing = [level for level in LEVELS if level not in terms]
        if missing:
            self.source.fail(None, f"{output} has no TERM {missing[0]}")
        at = tuple(next((x for x, y in terms[level][1] if y == 1), float("nan")) for level in LEVELS)
        for level, shape in level_sets(at).items():
            token, corners = terms[level]
            if len(corners) != 1 and corners != points(shape):
                expected = " ".join(f"({x:g}, {y:g})" for x, y in points(shape))
                self.source.fail(token, f"expected {level} to reach down to its neighbours: {expected}")
        if output != FEAR and at != DISTRUST_AT:
            self.source.fail(terms["low"][0], f"expected trust at {', '.join(f'{x:g}' for x in DISTRUST_AT)}")
        return at

    def check_rule(self, index: int, file: RuleFile) -> None:
        """Refuse a sentence that is not a rule, at its wrong word, and a cause that is not known."""
        try:
            rule = parse_rule(file.rules[index], file.inputs, outputs=file.outputs)
        except SentenceError as error:
            passed = [token for offset, token in self.words[index] if offset <= error.offset]
            self.source.fail(passed[-1] if passed else self.places["rules", index], str(error))
        problem = unknown_cause(rule.cause, file.known_causes)
        if problem:
            self.source.fail(self.places["because", index], problem)

    def place(self, path: tuple[str | int, ...]) -> Token | None:
        """The token of the part of the file at ``path``, or of the nearest part around it."""
        while path and path not in self.places:
            path = path[:-1]
        return self.places.get(path)


def _names(part: Any) -> list[Token]:
    return [token for token in part.children if isinstance(token, Token)]


def _numbers(part: Any) -> tuple[float, ...]:
    return tuple(float(token) for token in part.children if token.type == "NUMBER")


def _piecewise(source: Source, kind: Token, *numbers: Token) -> list[Corner]:
    """The corners of a set that jFuzzyLogic names by its kind: a triangle, or a trapezoid."""
    name = source.expect(kind.update(value=kind.lower()), PIECEWISE)
    degrees = PIECEWISE[name]
    if len(numbers) != len(degrees):
        source.fail(kind, f"expected {len(degrees)} numbers after {name}")
    corners = zip(map(float, numbers), degrees, strict=True)
    return list(dict.fromkeys(corners))  # a trapezoid may be a triangle


def _sentence(words: list[Any]) -> tuple[str, list[tuple[int, Token]]]:
    """A rule as a sentence of the rule language, and the offset in it of every token."""
    sentence, offsets = "", []
    for token in _without_brackets_of_the_conclusion(words):
        word = token.lower() if token.lower() in FCL_WORDS else str(token)
        if token.type == "WITH":
            word = "with weight"
        if token.type == "NUMBER":
            word = f"{Decimal(word):f}"  # a rule has no exponents
        sentence += " " * bool(sentence and not sentence.endswith("(") and word != ")")
        offsets.append((len(sentence), token))
        sentence += word
    return sentence, offsets


def _without_brackets_of_the_conclusion(words: list[Any]) -> list[Any]:
    """``words`` without the pairs of brackets around what follows THEN, up to WITH."""
    then = next((at for at, token in enumerate(words) if token.lower() == "then"), len(words))
    end = next((at for at, token in enumerate(words) if at > then and token.type == "WITH"), len(words))
    conclusion = words[then + 1 : end]
    while len(conclusion) > 1 and (conclusion[0].type, conclusion[-1].type) == ("LPAR", "RPAR"):
        conclusion = conclusion[1:-1]
    return [*words[: then + 1], *conclusion, *words[end:]]


def _plain(token: Token) -> Any:
    if token.type == "NUMBER":
        return float(token)
    if token.type == "TEXT":
        return re.sub(r"\$(.)", r"\1", token[1:-1])
    return str(token)


def _complaint(error: ValidationError, data: Mapping[str, Any]) -> str:
    problem = error.errors()[0]
    if problem["type"] == "missing" and problem["loc"][-1] == "risk":
        name = problem["loc"][1]
        return f"the direction of the risk {name} is missing: expected RISK {name} := rising; in OPTION"
    return config.complaint(error, data, RuleFile)
