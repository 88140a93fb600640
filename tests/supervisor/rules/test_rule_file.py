"""Rule files: the meaning of sentences, and errors with their place."""

from pathlib import Path

import pytest
from supervisor_rig import Drive

from supervisor.rules.inference import FearRules
from supervisor.rules.sentence import Atom, load_rules, parse_rule
from trepid.config import CONFIG_DIR, InputError

INPUTS = ("dark", "fast")
SHIPPED = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")


def is_(name: str, level: str, *, negated: bool = False) -> Atom:
    return Atom(name, level, negated)


def test_the_shipped_rules_load() -> None:
    file, rules = load_rules(CONFIG_DIR / "fear.yaml")
    assert len(rules) == len(file.rules)


@pytest.mark.parametrize(
    ("expression", "cases"),
    [
        ("dark is low", ((is_("dark", "low"),),)),
        ("dark is not low", ((is_("dark", "low", negated=True),),)),
        ("dark is low and fast is high", ((is_("dark", "low"), is_("fast", "high")),)),
        ("dark is low or fast is high", ((is_("dark", "low"),), (is_("fast", "high"),))),
        (
            "not (dark is low and fast is high)",
            ((is_("dark", "low", negated=True),), (is_("fast", "high", negated=True),)),
        ),
        (
            "not (dark is low or fast is not high)",
            ((is_("dark", "low", negated=True), is_("fast", "high")),),
        ),
        (
            "(dark is low or dark is high) and fast is low",
            ((is_("dark", "low"), is_("fast", "low")), (is_("dark", "high"), is_("fast", "low"))),
        ),
    ],
)
def test_and_or_not_and_parentheses_bind_as_in_logic(expression: str, cases: object) -> None:
    assert parse_rule(f"if {expression} then fear is high", INPUTS).cases == cases


def test_a_rule_may_carry_a_weight_and_a_cause() -> None:
    rule = parse_rule("if dark is low then fear is very_high with weight 0.5 because night", INPUTS)
    assert (rule.level, rule.weight, rule.cause) == (4, 0.5, "night")


def test_the_cause_of_a_rule_without_one_is_its_first_input() -> None:
    assert parse_rule("if fast is low or dark is low then fear is low", INPUTS).cause == "fast"


FIRST_RULE = "if state_doubt is very_high then fear is very_high because doubted_state"


@pytest.mark.parametrize(
    ("sentence", "offset", "message"),
    [
        ("if stat_age is high then fear is low", 3, "unknown input 'stat_age'; did you mean 'state_age'?"),
        ("if state_age is hihg then fear is low", 16, "unknown set 'hihg'; did you mean 'high'?"),
        ("if state_age is high then fear is awful", 34, "unknown level 'awful'; known here: very_low"),
        ("if state_age was high then fear is low", 13, "expected 'is', got 'was'"),
        ("if state_age is high then fear is", 33, "the rule ends too early: expected level"),
        ("if (state_age is high then fear is low", 22, "expected ')', got 'then'"),
        (
            "if state_age is high then fear is low with weight 2",
            50,
            "expected a weight above 0 and at most 1",
        ),
        ("if state_age is high then fear is low because 7", 46, "expected a cause"),
        ("if state_age is high then fear is low please", 38, "expected the end of the rule"),
        ("when state_age is high then fear is low", 0, "expected 'if', got 'when'"),
    ],
)
@pytest.mark.parametrize("quote", ["", "'"])
def test_a_bad_word_in_a_rule_is_named_with_line_and_column(
    tmp_path: Path, sentence: str, offset: int, message: str, quote: str
) -> None:
    path = tmp_path / "fear.yaml"
    path.write_text(SHIPPED.replace(FIRST_RULE, f"{quote}{sentence}{quote}"))
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if sentence in text)
    column = len("  - ") + len(quote) + offset + 1
    with pytest.raises(InputError) as error:
        load_rules(path)
    assert str(error.value).startswith(f"{path}:{line}:{column}: ")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("low: [0.08, 0.11, 0.2]", "low: [0.11, 0.08, 0.2]", "must not fall"),
        ("low: [0.08, 0.11, 0.2]", "low: [0.08, 0.2]", "expected 3 points"),
        ("low: [0.08, 0.11, 0.2]", "low: [0.11, 0.12, 0.2]", "leave a gap"),
        ("low: [0.08, 0.11, 0.2]", "low: [0.09, 0.09, 0.2]", "vertical"),
        ("low: [0.08, 0.11, 0.2]", "low: [0.05, 0.3, 0.35]", "not in order"),
        ("very_low: [0.0, 0.0, 0.08, 0.11]", "very_low: [0.0, 0.05, 0.08, 0.11]", "start as a shoulder"),
        ("very_high: [0.25, 0.3, 1.0, 1.0]", "very_high: [0.25, 0.3, 0.9, 1.0]", "end as a shoulder"),
        ("risk: rising", "rsik: rising", "did you mean 'risk'?"),
        ("speed_factor: 0.4", "speed_factor: 0.9", "fear must slow down"),
        ("at: 0.5, ", "at: 0.2, ", "medium must stand above low"),
        ("at: 1.0, ", "at: 0.9, ", "very_high at 1"),
        ("mode: STOP", "mode: KEEP", "milder"),
        ("  frame_age:\n", "  then:\n", "keyword of the rule language"),
        ("range: [0.0, 1.0]", "range: [0.0, .nan]", "finite"),
    ],
)
def test_a_bad_part_of_the_file_is_named_with_line_and_column(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "fear.yaml"
    assert old in SHIPPED
    path.write_text(SHIPPED.replace(old, new, 1))
    with pytest.raises(InputError, match=r"fear\.yaml:\d+:\d+: ") as error:
        load_rules(path)
    assert message in str(error.value)


def test_the_former_name_of_the_path_jitter_still_drives_and_is_reported_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fear.yaml"
    path.write_text(SHIPPED.replace("cnn_path_jitter", "cnn_unrest"), encoding="utf-8")
    drive, former = Drive.under_way(), Drive.under_way()
    former.supervisor.adopt(FearRules.load(path))
    load_rules(path)
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if text == "  cnn_unrest:")
    warning = f"trepid: {path}:{line}:3: warning: the input 'cnn_unrest' is now called 'cnn_path_jitter'\n"
    assert capsys.readouterr().err == warning
    for _ in range(3):
        now, then = drive.frame(), former.frame()
        assert (now.fear, now.input_values) == (then.fear, then.input_values)
    assert "cnn_unrest" in then.inputs and "cnn_path_jitter" in now.inputs
