"""Bad rule files: exit code 2 and one line, with file:line:column where there is a line; never a traceback."""

import copy
import io
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

import trepid.cli
from supervisor.rules.inference import FearRules
from supervisor.rules.sentence import SentenceError, parse_rule
from supervisor.rules.verify import verify
from trepid.config import CONFIG_DIR, InputError

GOOD = (CONFIG_DIR / "fear" / "first_drive.yaml").read_text(encoding="utf-8")
RULE = "if time_gap is low then fear is high because lead_close"
BEGUN = GOOD.splitlines().index("inputs:") + 1  # line of `inputs:`
RULE_AT = next(f"{n}:{line.index('if') + 1}" for n, line in enumerate(GOOD.splitlines(), 1) if RULE in line)


def with_rule(text: str) -> str:
    return GOOD.replace(RULE, text, 1)


def with_part(old: str, new: str) -> str:
    assert old in GOOD, old
    return GOOD.replace(old, new, 1)


BAD: dict[str, tuple[str | bytes | None, str]] = {
    "the former meaning of sight": (
        GOOD.replace("  lane_confidence:\n", "  sight:\n", 1).replace("if lane_confidence", "if sight"),
        r":\d+:\d+: .*its former meaning is seen_confidence",
    ),
    # No YAML mapping at all.
    "missing": (None, r"bad\.yaml: cannot be read: No such file"),
    "empty": ("", ":1:1: expected a mapping"),
    "only a comment": ("# nothing\n", ":1:1: expected a mapping"),
    "binary": (b"\x00\x01\xff\xfe\x80", r"bad\.yaml:1:3: byte 0xff is no UTF-8; save it as UTF-8"),
    "a list": ("- a\n", ":1:1: expected a mapping"),
    "tab": (with_part("    unit: s", "\tunit: s"), r":\d+:\d+: not valid YAML"),
    "unclosed bracket": (with_part("range: [0.0, 1.0]", "range: [0.0, 1.0"), r":\d+:\d+: not valid YAML"),
    "unclosed quote": (with_part('unit: "1"', 'unit: "1'), r":\d+:\d+: not valid YAML"),
    "input twice": (with_part("  brightness:\n", "  speed:\n"), ":.*: not valid YAML: .*duplicate key"),
    "unknown alias": (with_part("*estimator_age", "*nowhere"), r":\d+:11: not valid YAML: .*alias"),
    "tag": (with_part("risk: rising", "risk: !!python/name:os.system rising"), "not valid YAML: unknown tag"),
    "nested 500 deep": (GOOD + "a: " + "{a: " * 500 + "1" + "}" * 500, r"bad\.yaml: nested too deeply"),
    # Fields of the file.
    "misspelt section": (with_part("rules:", "ruels:"), r":\d+:1: unknown field 'ruels'; did you mean 'rules'"),
    "no rules": (re.sub(r"rules:\n(  - .*\n)+", "", GOOD), ":1: 'rules' is missing"),
    "empty rules": (re.sub(r"rules:\n(  - .*\n)+", "rules: []\n", GOOD), ":1: rules: .*at least 1 item"),
    "rules as a mapping": (re.sub(r"rules:\n(  - .*\n)+", "rules: {a: b}\n", GOOD), "rules: Input should be"),
    "rule that is a number": (with_rule("17"), "rules.18: Input should be a valid string"),
    "rule that is a mapping": (with_rule("if a: b"), "rules.18: Input should be a valid string"),
    "no inputs": ("inputs: {}\n" + GOOD[GOOD.index("rules:\n") :], ":1:1: inputs: .*at least 1 item"),
    "unknown method": (GOOD + "method: sugeno\n", r":\d+:1: method: unknown value 'sugeno'; known here: monotone"),
    "estimator twice": (GOOD + "estimators: [cv, cv]\n", "estimators.1: 'cv' is listed twice"),
    "estimator in capitals": (GOOD + "estimators: [CV]\n", "estimators.0: String should match pattern"),
    # Inputs.
    "input as a keyword": (with_part("  brightness:\n", "  not:\n"), ":3: inputs.not: 'not' is a keyword"),
    "input as an output": (
        with_part("  brightness:\n", "  trust_cv:\n") + "estimators: [cv]\n",
        ":3: inputs.trust_cv: 'trust_cv' is a keyword",
    ),
    "input in capitals": (with_part("  brightness:\n", "  Brightness:\n"), "String should match pattern"),
    "misspelt field": (with_part("risk: rising", "rsik: rising"), "unknown field .*rsik'; did you mean 'risk'"),
    "no unit": (with_part("    unit: s\n", ""), f":{BEGUN + 1}:3: 'inputs.frame_age.unit' is missing"),
    "no direction": (with_part("    risk: rising\n", ""), "'inputs.frame_age.risk' is missing"),
    "direction upwards": (with_part("risk: rising", "risk: up"), "risk: unknown value 'up'; known here: rising"),
    "range of one": (with_part("range: [0.0, 1.0]", "range: [0.0]"), "range.1: Field required|range.1' is missing"),
    "range that falls": (with_part("range: [0.0, 1.0]", "range: [1.0, 0.0]"), "range must rise"),
    "range without end": (with_part("range: [0.0, 1.0]", "range: [0.0, .inf]"), "finite number"),
    "range in words": (with_part("range: [0.0, 1.0]", "range: [low, high]"), "range.0: Input should be"),
    "four sets": (with_part("      low: [0.11, 0.14, 0.17]\n", ""), "'inputs.frame_age.sets.low' is missing"),
    "sixth set": (
        with_part("      low: [0.11, 0.14, 0.17]\n", "      low: [0.11, 0.14, 0.17]\n      lower: [0, 1, 2]\n"),
        "unknown field 'inputs.frame_age.sets.lower'; did you mean 'low'",
    ),
    "two points": (with_part("low: [0.11, 0.14, 0.17]", "low: [0.11, 0.14]"), "low: expected 3 points .* got 2"),
    "points that fall": (with_part("low: [0.11, 0.14, 0.17]", "low: [0.14, 0.11, 0.17]"), "must not fall"),
    "gap between sets": (with_part("low: [0.11, 0.14, 0.17]", "low: [0.15, 0.16, 0.17]"), "leave a gap"),
    "sets in disorder": (with_part("low: [0.11, 0.14, 0.17]", "low: [0.05, 0.3, 0.4]"), "not in order"),
    "vertical edge": (with_part("low: [0.11, 0.14, 0.17]", "low: [0.12, 0.12, 0.17]"), "vertical"),
    "no left shoulder": (with_part("very_low: [0.0, 0.0, 0.11, 0.14]", "very_low: [0.0, 0.1, 0.11, 0.14]"), "as a"),
    "cause in words": (with_part("missing: stale_data", "missing: stale data"), "missing: String should match"),
    "beyond": (with_part("beyond: end", "beyond: clip"), "beyond: unknown value 'clip'; known here: broken, end"),
    # Actions and hysteresis.
    "faster in fear": (with_part("speed_factor: 0.2", "speed_factor: 0.9"), "speed_factor of high is above"),
    "calm does not stand at 0": (with_part("at: 0.0, ", "at: 0.1, "), "very_low must stand at 0"),
    "levels in disorder": (with_part("at: 0.5, ", "at: 0.9, "), "high must stand above medium"),
    "speed over 1": (with_part("speed_factor: 0.8", "speed_factor: 1.8"), "less than or equal to 1"),
    "milder mode": (with_part("mode: STOP", "mode: KEEP"), "the mode of very_high is milder"),
    "mode FOLLOW": (with_part("mode: STOP", "mode: FOLLOW"), "mode: unknown value 'FOLLOW'"),
    "negative time": (with_part("calm_after_s: 2.0", "calm_after_s: -2.0"), "greater than or equal to 0"),
    "no recovery": (with_part("recovery_per_s: 0.1", "recovery_per_s: 0"), "recovery_per_s: .*greater than 0"),
    "level missing": (re.sub(r"  medium:    \{.*\n", "", GOOD), "'fear.medium' is missing"),
    "misspelt direction": (with_part("risk: rising", "risk: raising"), "'raising'; did you mean 'rising'"),
    "misspelt mode": (with_part("mode: STOP", "mode: STPO"), "mode: unknown value 'STPO'; did you mean 'STOP'"),
    "a gap is named": (with_part("low: [0.11, 0.14", "low: [0.15, 0.16"), r"no set covers 0\.14 to 0\.15"),
    "too little indentation": (with_part("    unit: s", "   unit: s"), r":\d+:\d+: .*wrong indentation"),
    "too much indentation": (with_part("    unit: s", "      unit: s"), r":\d+:\d+: .*wrong indentation"),
    "a tab is named": (with_part("    unit: s", "\tunit: s"), "a tab; write spaces"),
    # Sentences.
    "fear as an input": (with_rule("if fear is high then fear is very_high"), "'fear'; it is an output"),
    "empty sentence": (with_rule('""'), "the rule ends too early: expected 'if'"),
    "when": (with_rule("when time_gap is low then fear is high"), f":{RULE_AT}: expected 'if', got 'when'"),
    "misspelt input": (with_rule("if tim_gap is low then fear is high"), "'tim_gap'; did you mean 'time_gap'"),
    "misspelt set": (with_rule("if time_gap is lwo then fear is high"), "unknown set 'lwo'; did you mean 'low'"),
    "misspelt level": (with_rule("if time_gap is low then fear is hgh"), "'hgh'; did you mean 'high'"),
    "misspelt fear": (with_rule("if time_gap is low then faer is high"), "'faer'; did you mean 'fear'"),
    "trust of a stranger": (with_rule("if time_gap is low then trust_cv is low"), "unknown output 'trust_cv'"),
    "trust that is full": (
        with_rule("if time_gap is low then trust_cv is very_high") + "estimators: [cv]\n",
        "trust_cv is very_high where no rule lowers it; expected very_low",
    ),
    "no then": (with_rule("if time_gap is low fear is high"), "expected 'then', got 'fear'"),
    "comma": (with_rule("if time_gap is low, speed is low then fear is high"), "expected 'then', got ','"),
    "open parenthesis": (with_rule("if (time_gap is low then fear is high"), r"expected '\)', got 'then'"),
    "capitals": (with_rule("IF time_gap IS low THEN fear IS high"), "unknown word 'IF'|expected 'if', got 'IF'"),
    "weight over 1": (with_rule("if time_gap is low then fear is high with weight 1.5"), "a weight above 0"),
    "weight in words": (with_rule("if time_gap is low then fear is high with weight half"), "got 'half'"),
    "weight of dots": (with_rule("if time_gap is low then fear is high with weight 1.2.3"), "got '1.2.3'"),
    "cause in capitals": (with_rule("if time_gap is low then fear is high because Lead"), "expected a cause"),
    "more behind it": (with_rule("if time_gap is low then fear is high please"), "expected the end of the rule"),
    "nested 50 deep": (
        with_rule("if " + "(" * 50 + "time_gap is low" + ")" * 50 + " then fear is high"),
        "nested deeper than 32",
    ),
    "2^20 cases": (
        with_rule("if " + " and ".join(["(time_gap is low or speed is high)"] * 20) + " then fear is high"),
        "more than 256 cases; split it",
    ),
}  # fmt: skip


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bad.yaml"


def test_there_are_more_than_forty_kinds() -> None:
    assert len(BAD) >= 40


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_ends_with_2_and_one_line(
    kind: str, path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    content, message = BAD[kind]
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    monkeypatch.setattr(sys, "argv", ["trepid", "fear", "check", str(path)])
    assert trepid.cli.main() == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert output.err.startswith(f"trepid: {path}:")
    assert re.search(message, output.err), output.err


def test_a_file_that_could_not_drive_ends_with_1(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path.write_text(with_part("if state_age is very_high then fear", "if state_age is very_low then fear"))
    monkeypatch.setattr(sys, "argv", ["trepid", "fear", "check", str(path)])
    assert trepid.cli.main() == 1
    assert "always fires: if state_age is very_low" in capsys.readouterr().err


def loads_or_is_told(path: Path) -> None:
    """Reads and verifies the file, or checks that the error is one line."""
    try:
        rules = FearRules.load(path)
    except InputError as error:
        assert "\n" not in str(error)
        assert str(error).startswith(f"{path}:")
        return
    assert all("\n" not in problem for problem in verify(rules).problems)
    assert rules.evaluate({}).fear == 1


share = st.floats(0, 1, exclude_max=True)
STRANGE = ["", " ", "\n", "\t", "- ", '"', "'", "#", "&a ", "!!set ", "\x00", "\u2028", "é", "if ", "not "]
PLAIN = [
    ":",
    "[",
    "}",
    "|",
    "*a",
    "(",
    "is",
    "very_high",
    "-1",
    "1e999",
    ".nan",
    "0x1F",
    "null",
    "2020-01-01",
]
ODD: list[Any] = [
    None,
    True,
    -1,
    0,
    1e308,
    "",
    "if",
    [],
    [[]],
    {},
    {"a": 1},
    "x" * 1000,
    [0, 0, 0, 0],
    10**400,
]


def small() -> dict[str, Any]:
    """A rule file that is read in a few milliseconds."""
    data = YAML(typ="safe").load(GOOD)
    data["inputs"] = {name: data["inputs"][name] for name in ("time_gap", "speed")}
    data["rules"] = [RULE, "if speed is high then fear is very_high", "if speed is low then fear is very_low"]
    return data


def dump(data: dict[str, Any]) -> str:
    buffer = io.StringIO()
    YAML(typ="safe").dump(data, buffer)
    return buffer.getvalue()


SMALL = dump(small())


@given(
    st.lists(
        st.tuples(share, st.integers(0, 12), st.sampled_from([*STRANGE, *PLAIN])), min_size=1, max_size=3
    )
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_with_strange_characters_is_refused_in_one_line_or_loads(
    path: Path, changes: list[tuple[float, int, str]]
) -> None:
    text = SMALL
    for place, cut, snippet in changes:
        at = int(place * len(text))
        text = text[:at] + snippet + text[at + cut :]
    path.write_text(text, encoding="utf-8")
    loads_or_is_told(path)


def _parts(data: Any) -> list[tuple[Any, Any]]:
    """Every (holder, key) below ``data``."""
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    return [part for key in keys for part in ((data, key), *_parts(data[key]))]


@given(st.lists(st.tuples(share, st.sampled_from(ODD)), min_size=1, max_size=2))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_with_odd_values_is_refused_in_one_line_or_loads(
    path: Path, changes: list[tuple[float, Any]]
) -> None:
    data = YAML(typ="safe").load(SMALL)
    for place, value in changes:
        parts = _parts(data)
        holder, key = parts[int(place * len(parts))]
        holder[key] = copy.deepcopy(value)
    path.write_text(dump(data), encoding="utf-8")
    loads_or_is_told(path)


KNOWN = ["if", "then", "and", "or", "not", "is", "fear", "trust_cv", "speed", "time_gap", "low", "very_high"]
OTHERS = ["(", ")", "with", "weight", "because", "0.5", "dark", "1e9", "%"]


@given(st.lists(st.sampled_from([*KNOWN, *OTHERS]), max_size=14))
@settings(max_examples=300, deadline=None)
def test_shuffled_words_parse_or_are_refused_at_a_place_in_the_sentence(words: list[str]) -> None:
    sentence = f"if time_gap is {' '.join(words)}"
    try:
        parse_rule(sentence, ("speed", "time_gap"), outputs=("fear", "trust_cv"))
    except SentenceError as error:
        assert 0 <= error.offset <= len(sentence)
        assert "\n" not in str(error)
