"""Rule files as IEC 61131-7 Fuzzy Control Language (FCL), which other fuzzy tools read.

FCL has words for the sets, the rules and Mamdani's method, which another tool computes. Direction of risk, causes
and actions have no word in FCL; they stand in the OPTION block, which the standard leaves to each vendor.
``docs/fear.md`` lists the mapping; :mod:`cockpit.rulebook.fcl_read` reads it back.
"""

import re

from supervisor.rules.inference import DISTRUST_AT, FearRules
from supervisor.rules.rule_file import FEAR, LEVELS, Input, level_sets
from supervisor.rules.sentence import Rule
from supervisor.rules.shapes import FuzzySet

FCL_WORDS = frozenset({"if", "then", "is", "and", "or", "not"})


def fcl(rules: FearRules) -> str:
    """The text of an FCL function block with the same rules."""
    at = tuple(action.at for action in rules.file.fear.all)
    outputs = {name: at if name == FEAR else DISTRUST_AT for name in rules.file.outputs}
    lines = [
        "FUNCTION_BLOCK fear_rules",
        *_variables("VAR_INPUT", rules.names),
        *_variables("VAR_OUTPUT", tuple(outputs)),
        *(line for name, spec in rules.inputs.items() for line in _fuzzify(name, spec)),
        *(line for name, places in outputs.items() for line in _defuzzify(name, places)),
        "RULEBLOCK rules",
        "  AND : MIN;  OR : MAX;  ACT : MIN;  ACCU : MAX;",
        *(f"  RULE {number} : {_rule(rule)};" for number, rule in enumerate(rules.rules, start=1)),
        "END_RULEBLOCK",
        *_options(rules),
        "END_FUNCTION_BLOCK",
    ]
    return "\n".join(lines) + "\n"


def points(shape: FuzzySet) -> list[tuple[float, float]]:
    """Corners (x, degree) of a set, the whole degrees as integers."""
    return [(x, int(y) if y in (0.0, 1.0) else y) for x, y in shape.corners()]


def _variables(block: str, names: tuple[str, ...]) -> list[str]:
    return [block, *(f"  {name} : REAL;" for name in names), "END_VAR"]


def _terms(sets: dict[str, FuzzySet]) -> list[str]:
    return [
        f"  TERM {level} := {' '.join(f'({x!r}, {y!r})' for x, y in points(shape))};"
        for level, shape in sets.items()
    ]


def _fuzzify(name: str, spec: Input) -> list[str]:
    return [f"FUZZIFY {name}", *_terms(spec.shapes), "END_FUZZIFY"]


def _defuzzify(name: str, at: tuple[float, ...]) -> list[str]:
    """Where no rule fires, fear is 1 and trust is 1."""
    method = ["  ACCU : MAX;", "  METHOD : COG;", "  DEFAULT := 1;", "  RANGE := (0 .. 1);"]
    return [f"DEFUZZIFY {name}", *_terms(level_sets(at)), *method, "END_DEFUZZIFY"]


def _rule(rule: Rule) -> str:
    """The sentence in FCL's words; its cause stands among the options."""
    sentence = re.split(r" with weight | because ", " ".join(rule.text.split()))[0]
    words = re.findall(r"\w+|\S", sentence)
    text = " ".join(word.upper() if word in FCL_WORDS else word for word in words)
    return text + ("" if rule.weight == 1 else f" WITH {rule.weight!r}")


def _options(rules: FearRules) -> list[str]:
    file = rules.file
    lines = ["OPTION", f"  METHOD := {file.method};"]
    lines += [f"  CAUSE {name} := {_quote(meaning)};" for name, meaning in file.causes.items()]
    lines += [f"  WITHOUT {cause};" for cause in file.without]
    for name, spec in file.inputs.items():
        lines += [f"  MEANING {name} := {_quote(spec.meaning)};", f"  UNIT {name} := {_quote(spec.unit)};"]
        lines += [f"  RISK {name} := {spec.risk};", f"  MISSING {name} := {spec.missing};"]
        lines.append(f"  BEYOND {name} := {spec.beyond};")
    for level, action in zip(LEVELS, file.fear.all, strict=True):
        lines.append(f"  SPEED_FACTOR {level} := {action.speed_factor!r};")
        lines.append(f"  MODE {level} := {action.mode.value};")
    lines += [f"  HYSTERESIS {name} := {value!r};" for name, value in file.hysteresis.model_dump().items()]
    stated = [(number, rule) for number, rule in enumerate(rules.rules, start=1) if " because " in rule.text]
    lines += [f"  BECAUSE {number} := {rule.cause};" for number, rule in stated]
    return [*lines, "END_OPTION"]


def _quote(text: str) -> str:
    return "'" + text.replace("$", "$$").replace("'", "$'").replace("\n", " ") + "'"
