"""Fuzzy Control Language: a round trip keeps the rules, and an error is reported with its place."""

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML
from rule_rig import FALLING, RISING, small_rules
from typer.testing import CliRunner

from cockpit.rulebook.cli import app
from cockpit.rulebook.fcl_export import fcl
from cockpit.rulebook.fcl_read import parse_fcl
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import RuleFile
from supervisor.rules.sentence import parse_rule
from trepid.config import CONFIG_DIR, InputError

SHIPPED = FearRules.load(CONFIG_DIR / "fear.yaml")
SMALL = small_rules(
    "if not (a is very_low or b is not very_high) then fear is very_high with weight 0.5 because dark",
    "if a is high and (b is low or a is very_high) then fear is medium",
    "if b is low then trust_cv is low with weight 0.25",
    "if a is very_low then fear is very_low",
    inputs={"a": RISING, "b": FALLING},
    estimators=("cv", "cnn"),
)
TEXT = fcl(SMALL)


def compile_rules(file: RuleFile) -> FearRules:
    return FearRules(file, tuple(parse_rule(text, file.inputs, outputs=file.outputs) for text in file.rules))


def read_back(rules: FearRules) -> FearRules:
    return compile_rules(parse_fcl(fcl(rules), source="rules.fcl", like=SHIPPED.file))


@pytest.mark.parametrize("rules", [SHIPPED, SMALL], ids=["shipped", "small"])
@pytest.mark.parametrize("method", ["monotone", "mamdani"])
def test_exported_and_imported_rules_infer_the_same_to_the_last_bit(rules: FearRules, method: str) -> None:
    own = compile_rules(rules.file.model_copy(update={"method": method}))
    again, rng = read_back(own), random.Random(5)
    for _ in range(50):
        point = {n: rng.choice([rng.uniform(*s.range), None]) for n, s in rules.inputs.items()}
        full = {n: rng.uniform(*s.range) for n, s in rules.inputs.items()}
        for values in (point, full):
            assert again.evaluate(values) == own.evaluate(values)
            assert again.trust(values) == own.trust(values)
            assert again.memberships(values) == own.memberships(values)


def test_spaces_between_the_words_of_a_rule_change_nothing() -> None:
    rules = [rule.replace(" ", "  ") for rule in SMALL.file.rules]
    spaced = compile_rules(SMALL.file.model_copy(update={"rules": type(SMALL.file.rules)(rules)}))
    assert any("with  weight" in rule for rule in rules)
    assert fcl(spaced) == fcl(SMALL)


def test_export_and_import_lose_no_part_of_a_file() -> None:
    assert read_back(SMALL).file == SMALL.file
    assert fcl(read_back(SHIPPED)) == fcl(SHIPPED)
    declaring = FearRules.load(CONFIG_DIR / "fear" / "first_drive.yaml")
    assert declaring.file.causes and declaring.file.without
    again = read_back(declaring).file
    assert (again.causes, again.without) == (declaring.file.causes, declaring.file.without)


def test_the_verbs_export_and_import_make_a_rule_file_that_checks_as_before(tmp_path: Path) -> None:
    run = CliRunner().invoke
    (tmp_path / "f.fcl").write_text(
        run(app, ["export", str(CONFIG_DIR / "fear.yaml")]).stdout, encoding="utf-8"
    )
    (tmp_path / "f.yaml").write_text(run(app, ["import", str(tmp_path / "f.fcl")]).stdout, encoding="utf-8")
    assert YAML(typ="safe").load(tmp_path / "f.yaml")["method"] == "monotone"
    imported = YAML(typ="safe").load(tmp_path / "f.yaml")
    assert not {"causes", "without"} & imported.keys(), "the file declares none"
    assert run(app, ["check", str(tmp_path / "f.yaml")]).exit_code == 0


FOREIGN = """\
FUNCTION_BLOCK tipping // by another tool
VAR_INPUT a : REAL; b : REAL; END_VAR
VAR_OUTPUT fear : REAL; END_VAR
FUZZIFY a
  TERM very_low := (0, 1) (0.25, 0); TERM low := (0, 0) (.25, 1) (.5, 0);
  TERM medium := (0.25, 0) (0.5, 1) (0.75, 0); TERM high := (0.5, 0) (0.75, 1) (1, 0);
  TERM very_high := (0.75, 0) (1, 1);
END_FUZZIFY
fuzzify b
  TERM very_low := (0, 1) (0.25, 0); TERM low := (0, 0) (.25, 1) (.5, 0);
  TERM medium := (0.25, 0) (0.5, 1) (0.75, 0); TERM high := (0.5, 0) (0.75, 1) (1, 0);
  TERM very_high := (0.75, 0) (1e0, 1); RANGE := (0..1);
END_FUZZIFY
DEFUZZIFY fear
  TERM very_low := 0; TERM low := 0.25; TERM medium := 0.5; TERM high := 0.75; TERM very_high := 1;
  METHOD : COG; DEFAULT := 1;
END_DEFUZZIFY
RULEBLOCK one AND : MIN; ACCU : MAX;
  RULE 1 : IF a IS low AND NOT (b IS high) THEN fear IS medium WITH 0.5; (* over
  two lines *)
END_RULEBLOCK
OPTION RISK a := rising; RISK b := falling; END_OPTION
END_FUNCTION_BLOCK
"""


RULE = "IF a IS low AND NOT (b IS high) THEN fear IS medium WITH 0.5"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FUNCTION_BLOCK tipping", "/* a head\n * over lines **/ FUNCTION_BLOCK tipping"),
        ("VAR_INPUT a", "(* one *) VAR_INPUT /* two (* not nested */ a // three /* (* \n"),
        ("VAR_INPUT a", "(* one (* in *) the (*other*)*) VAR_INPUT a"),
        ("VAR_INPUT a", "(* one (* two *) VAR_INPUT (* three *) a"),
        ("a : REAL; b : REAL;", "a : LREAL; b : lreal;"),
        (RULE, RULE.replace("a IS low", "a (* in *) IS /* a */ low // rule\n")),
        ("METHOD : COG;", "METHOD : COGS;"),
        ("METHOD : COG;", "method : cogs;"),
        ("fear IS medium WITH", "(fear IS medium) WITH"),
        ("fear IS medium WITH", "((fear IS medium)) WITH"),
        ("a : REAL; b : REAL;", "a, b : REAL;"),
        ("b : REAL; END_VAR", "b : REAL (0..1.0); END_VAR"),
        ("fear : REAL;", "Fear : REAL (0. .. 1.);"),
        (RULE, RULE.replace("a IS low", "A IS Low").replace("fear IS medium", "FEAR IS MEDIUM")),
        ("VAR_INPUT a", "VAR_INPUT A"),
        ("low := (0, 0) (.25, 1) (.5, 0)", "low := trian 0 0.25 0.5"),
        ("medium := (0.25, 0) (0.5, 1) (0.75, 0)", "medium := TRAPE 0.25 0.5 0.5 0.75"),
    ],
)
def test_comments_cogs_brackets_ranges_and_capitals_change_nothing(old: str, new: str) -> None:
    assert old in FOREIGN
    plain = parse_fcl(FOREIGN, source="f.fcl", like=SHIPPED.file)
    assert parse_fcl(FOREIGN.replace(old, new, 1), source="f.fcl", like=SHIPPED.file) == plain


SECOND_BLOCK = "RULEBLOCK two RULE 1 : IF b IS low THEN fear IS high WITH 2.5E-1; END_RULEBLOCK\nOPTION"


def test_every_rule_block_counts_its_rules_from_the_beginning() -> None:
    file = parse_fcl(FOREIGN.replace("OPTION", SECOND_BLOCK, 1), source="f.fcl", like=SHIPPED.file)
    assert file.rules[1:] == ("if b is low then fear is high with weight 0.25",)


def test_a_cause_of_a_number_that_two_blocks_have_is_refused() -> None:
    text = FOREIGN.replace("OPTION", SECOND_BLOCK + " BECAUSE 1 := dark;", 1)
    with pytest.raises(InputError, match="expected a number that the rules of one block alone have"):
        parse_fcl(text, source="f.fcl", like=SHIPPED.file)


@pytest.mark.parametrize(
    "condition",
    [
        "(a IS low) AND (NOT (b IS high))",
        "((a IS low AND (NOT ((b IS high)))))",
        "(NOT (NOT (a IS low) OR (b IS high)))",
    ],
)
def test_brackets_of_a_condition_group_as_deep_as_they_are_written(condition: str) -> None:
    plain, nested = (
        compile_rules(parse_fcl(text, source="f.fcl", like=SHIPPED.file))
        for text in (FOREIGN, FOREIGN.replace("a IS low AND NOT (b IS high)", condition, 1))
    )
    rng = random.Random(3)
    for _ in range(30):
        values = {"a": rng.random(), "b": rng.random()}
        assert nested.evaluate(values).fear == pytest.approx(plain.evaluate(values).fear, abs=1e-12)


def test_a_foreign_file_is_read_as_mamdanis_with_the_risks_that_it_states() -> None:
    file = parse_fcl(FOREIGN, source="f.fcl", like=SHIPPED.file)
    assert (file.method, file.rules) == (
        "mamdani",
        ("if a is low and not (b is high) then fear is medium with weight 0.5",),
    )
    assert (file.inputs["b"].risk, file.inputs["b"].range) == ("falling", (0, 1))
    assert file.fear.high.speed_factor == SHIPPED.file.fear.high.speed_factor


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("FUNCTION_BLOCK", "FUNKTION_BLOCK", ":1:1: expected 'FUNCTION_BLOCK', got 'FUNKTION_BLOCK'; did you mean"),
        ("  a : REAL;", "  a : REEL;", ":3:7: expected 'REAL', got 'REEL'"),
        ("  fear : REAL;", "  faer : REAL;", ":7:3: expected 'fear' or trust_NAME, got 'faer'; did you"),
        ("FUZZIFY a", "FUZZIFY c", ":11:9: expected one of a, b, got 'c'"),
        ("TERM low := ", "TERM lwo := ", "expected one of very_low, low"),
        ("TERM low := (0.0, 0)", "TERM low := (0.0, 0.5)", ":13:8: expected points that rise from 0 to 1 once"),
        ("TERM low := (0.0, 0)", "TERM low := (0.0 0)", ":13:20: expected ',', got '0'"),
        ("TERM low := (0.0, 0)", "TERM low := (0.3, 0)", ":13:8: the points must not fall"),
        ("TERM low := (0.0, 0)", "TERM low := (-1.0, 0)", "not in order"),
        ("TERM low := (0.0, 0)", "TERM low := gauss 0.3 0.1; TERM low := (0.0, 0)", "one of trian, trape"),
        ("TERM low := (0.0, 0)", "TERM low := trian 0.3; TERM low := (0.0, 0)", "expected 3 numbers after trian"),
        ("METHOD : COG;", "METHOD : MOM;", ": expected 'COG' or 'COGS', got 'MOM'"),
        ("DEFAULT := 1;", "DEFAULT := 0;", "expected the default 1"),
        ("RANGE := (0 .. 1)", "RANGE := (0 .. 2)", "expected the range 0 .. 1"),
        ("fear : REAL;", "fear : REAL (0..2);", "expected the range 0 .. 1"),
        ("a : REAL;", "a : REAL (1 .. 0);", ":3:3: inputs.a: range must rise"),
        ("DEFAULT := 1;", "DEFAULT := NC;", "expected the default 1: where no rule fires"),
        ("AND : MIN;", "AND : PROD;", "expected 'MIN', got 'PROD'"),
        ("RULE 2 ", "RULE 1 ", "expected a number that no earlier rule has"),
        ("IF a IS high", "IF aa IS high", "unknown input 'aa'; did you mean 'a'?"),
        ("THEN fear IS medium;", "THEN fear IS medum;", "unknown level 'medum'; did you mean 'medium'?"),
        ("WITH 0.25", "WITH 25", "expected a weight above 0 and at most 1, got '25'"),
        ("THEN fear IS medium;", "THEN fear IS medium, trust_cv IS low;", "expected a value, got ','"),
        ("RISK a := rising;", "RISK a := up;", "inputs.a.risk: unknown value 'up'"),
        ("  RISK a := rising;", "", "the direction of the risk a is missing: expected RISK a := rising; in OPTION"),
        ("BECAUSE 1 ", "BECAUSE 9 ", "expected the number of a rule above"),
        ("BECAUSE 1 := dark", "BECAUSE 1 := dakr", "unknown cause 'dakr'; did you mean 'dark'?"),
        ("HYSTERESIS band", "HYSTERESIS bund", "expected one of band"),
        ("MODE low := KEEP", "MODE low := STOP", "the mode of medium is milder"),
        ("END_FUNCTION_BLOCK", "END_FUNCTION", "did you mean 'END_FUNCTION_BLOCK'?"),
        ("END_FUNCTION_BLOCK", "", "got the end of the file"),
        ("END_FUNCTION_BLOCK", "END_FUNCTION_BLOCK FUNCTION_BLOCK", "expected the end of the file"),
        ("END_FUNCTION_BLOCK", "(* END_FUNCTION_BLOCK", "begins a text or a comment that does not end"),
        ("END_FUNCTION_BLOCK", "/* END_FUNCTION_BLOCK", "begins a text or a comment that does not end"),
        ("METHOD : COG;", "METHOD : COGS;", "expected singletons such as TERM low := 0.25; for COGS, else COG"),
        ("MEANING a := 'a risk'", "MEANING a := 'a risk", "begins a text or a comment that does not end"),
        ("VAR_OUTPUT", "VAR_OUTPUT %", "'%' is no sign of FCL"),
    ],
)  # fmt: skip
def test_an_error_is_reported_with_line_and_column(old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(InputError, match=r"^rules\.fcl:\d+:\d+: [^\n]*$") as error:
        parse_fcl(TEXT.replace(old, new, 1), source="rules.fcl", like=SHIPPED.file)
    assert message in str(error.value)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_mutilated_file_is_read_or_refused_in_one_line(data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(TEXT)))
    cut = data.draw(st.integers(0, 30))
    put = data.draw(st.text("()':=;.,0123456789 \nabIFTHEN_*$", max_size=6))
    try:
        parse_fcl(TEXT[:at] + put + TEXT[at + cut :], source="rules.fcl", like=SHIPPED.file)
    except InputError as error:
        assert str(error).startswith("rules.fcl:")
        assert "\n" not in str(error)
