"""``trepid fear``: exit codes, JSON fields, and checks that find the errors."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cockpit.rulebook.cli import app
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest, worst
from supervisor.rules.verify import verify
from trepid.config import CONFIG_DIR, InputError

FILE = CONFIG_DIR / "fear.yaml"
SHIPPED = FILE.read_text(encoding="utf-8")
CALM_RULE = next(line for line in SHIPPED.splitlines() if line.endswith("then fear is very_low")) + "\n"
RULES = FearRules.load(FILE)


def fear(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, arguments)
    if isinstance(result.exception, InputError):
        raise result.exception
    return result.exit_code, result.stdout


def explain(*values: str) -> dict[str, Any]:
    code, out = fear("explain", str(FILE), *values, "--json")
    assert code == 0
    return json.loads(out)  # type: ignore[no-any-return]


def test_the_shipped_rules_pass_their_check() -> None:
    code, out = fear("check", str(FILE))
    assert code == 0
    assert "a rule fires everywhere, monotone, reaches 0 and 1" in out


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (CALM_RULE, "", "no rule fires at the calmest point"),
        ("lane_confidence is very_high and", "lane_confidence is high and speed is very_low and", "no rule fires"),
        (
            CALM_RULE,
            CALM_RULE + "  - if speed is not very_high and lane_confidence is not very_low then fear is low\n",
            "never fires: if speed is not very_high",
        ),
        (CALM_RULE, CALM_RULE + "  - if speed is very_low then fear is medium\n", "always fires: if speed"),
        ("lane_width_error is", "lateral_error is", "no rule contains lane_width_error"),
        ("then fear is very_high", "then fear is high", "fear is 0.750, expected exactly 1"),
    ],
)  # fmt: skip
def test_a_rule_file_that_could_not_drive_fails_its_check(
    tmp_path: Path, old: str, new: str, problem: str
) -> None:
    path = tmp_path / "fear.yaml"
    assert old in SHIPPED
    path.write_text(SHIPPED.replace(old, new))
    assert any(problem in found for found in verify(FearRules.load(path)).problems)


def test_a_unit_that_is_not_that_of_the_values_is_refused_at_its_place(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    path.write_text(SHIPPED.replace("vehicle\n    unit: m/s\n", "vehicle\n    unit: km/h\n"))
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if text.endswith("km/h"))
    with pytest.raises(
        InputError, match=rf":{line}:5: inputs.speed.unit: speed is measured in m/s, not in km/h"
    ):
        fear("check", str(path))


@pytest.mark.parametrize(
    ("condition", "idle"),
    [
        ("speed is low and speed is very_high", "speed is low"),
        ("speed is very_high and speed is not very_low", "speed is not very_low"),
        ("speed is very_low and cv_jitter is high", "speed is very_low"),
    ],
)
def test_a_condition_that_changes_nothing_is_noted(tmp_path: Path, condition: str, idle: str) -> None:
    path = tmp_path / "fear.yaml"
    rule = f"if {condition} then fear is low because demand"
    path.write_text(SHIPPED.replace(CALM_RULE, f"{CALM_RULE}  - {rule}\n"))
    verdict = verify(FearRules.load(path))
    assert f"the condition '{idle}' changes nothing: {rule}" in verdict.notes
    assert not [note for note in verify(RULES).notes if "changes nothing" in note]


def test_a_failed_check_exits_with_1_and_lists_the_problems(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    path.write_text(SHIPPED.replace(CALM_RULE, ""))
    code, out = fear("check", str(path), "--json")
    assert code == 1
    assert "no rule fires at the calmest point" in json.loads(out)["problems"]


def test_a_passed_check_reports_the_bound_on_the_rate_of_fear() -> None:
    code, out = fear("check", str(FILE))
    answer = json.loads(fear("check", str(FILE), "--json")[1])
    assert code == 0
    assert answer["problems"] == []
    assert answer["lipschitz"].keys() == set(RULES.names)
    assert all(f"of {name}\n" in out for name in RULES.names)


def test_many_files_are_checked_at_once_and_one_bad_one_fails_them(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    path.write_text(SHIPPED.replace(CALM_RULE, ""))
    code, out = fear("check", str(FILE), str(path), str(FILE), "--json")
    assert code == 1
    assert [bool(json.loads(line)["problems"]) for line in out.splitlines()] == [False, True, False]


def test_explain_gives_the_fields_of_the_design() -> None:
    answer = explain("disagreement=2")
    assert list(answer)[:7] == ["fear", "level", "memberships", "rules", "cause", "speed_factor", "mode"]
    assert set(answer["rules"][0]) == {"text", "strength"}
    assert set(answer["memberships"]) == {*RULES.names, "fear"}
    assert set(answer["memberships"]["disagreement"]) == {"very_low", "low", "medium", "high", "very_high"}
    assert answer["cause"] == "disagreement"
    assert answer["fear"] == RULES.evaluate({**calmest(RULES), "disagreement": 2.0}).fear


def test_explain_of_all_calm_and_all_worst_values() -> None:
    ends = [explain(*(f"{n}={x}" for n, x in point.items())) for point in (calmest(RULES), worst(RULES))]
    assert [(answer["fear"], answer["mode"], answer["speed_factor"]) for answer in ends] == [
        (0, "KEEP", 1),
        (1, "STOP", 0),
    ]


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
def test_explain_takes_a_text_without_a_number_as_missing(text: str) -> None:
    answer = explain(f"brightness={text}")
    assert (answer["fear"], answer["cause"]) == (1, "image_statistics_lost")


def test_explain_assumes_inputs_that_are_not_given_calm_and_lists_them() -> None:
    answer = explain("speed=3", "brightness=0.05")
    assert (answer["mode"], answer["cause"]) == ("CAUTION", "dark")
    assert answer["assumed_calm"] == [n for n in RULES.names if n not in ("speed", "brightness")]
    out = fear("explain", str(FILE), "speed=3", "brightness=0.05")[1]
    assert f"assumed calm, because not given: {len(RULES.names) - 2} of {len(RULES.names)} inputs" in out
    everything = [f"{name}={value}" for name, value in calmest(RULES).items()]
    assert explain(*everything)["assumed_calm"] == []
    assert "assumed" not in fear("explain", str(FILE), *everything)[1]


def test_the_option_calm_of_earlier_versions_changes_nothing() -> None:
    assert fear("explain", str(FILE), "speed=3", "--calm") == fear("explain", str(FILE), "speed=3")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("disagremnt=1", "did you mean 'disagreement'?"),
        ("zzz=1", "known here: frame_age"),
        ("speed=fast", "expected a number"),
        ("speed", "expected NAME=VALUE"),
    ],
)
def test_explain_names_a_bad_value(value: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        fear("explain", str(FILE), value)
    assert message in str(error.value)


def test_explain_as_text_states_fear_mode_speed_and_cause() -> None:
    code, out = fear("explain", str(FILE), "frame_age=0.5")
    assert code == 0
    assert out.startswith("fear 1.000 (very_high): STOP, speed x 0.00, because of stale_data")


def test_show_prints_inputs_sets_rules_and_levels() -> None:
    code, out = fear("show", str(FILE))
    assert code == 0
    for name in RULES.names:
        assert f"{name} [" in out
    for rule in RULES.rules:
        assert rule.text in out
    assert "CAUTION" in out


def test_show_refuses_values_without_a_surface() -> None:
    with pytest.raises(InputError, match=r"^speed=3: values are for --surface X Y; "):
        fear("show", str(FILE), "speed=3")


def test_a_missing_file_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read"):
        fear("check", "nowhere.yaml")


def test_every_problem_is_one_line() -> None:
    hole = FearRules(RULES.file, RULES.rules[:5])
    problems = verify(hole).problems
    assert problems
    assert all("\n" not in problem for problem in problems)


def test_a_check_against_scikit_fuzzy_reports_differences_and_rank_agreement() -> None:
    small = str(CONFIG_DIR / "fear" / "first_drive.yaml")
    code, out = fear("check", small, "--against-skfuzzy", "--points", "12", "--json")
    assert code == 0
    found = json.loads(out)["skfuzzy"]
    assert 2 <= found["points"] <= 12
    assert found["greatest_difference_mamdani"] < 1e-4
    assert found["greatest_difference_of_degrees"] < 1e-12
    assert found["kendall_tau"] > 0.3
    text = fear("check", small, "--against-skfuzzy", "--points", "3")[1]
    assert "rank agreement (Kendall)" in text


@pytest.mark.long
def test_the_shipped_rules_with_inputs_of_trust_alone_are_compared_with_scikit_fuzzy() -> None:
    assert "angle_jitter" not in {name for rule in RULES.fear_voice.rules for name in rule.inputs}
    code, out = fear("check", str(FILE), "--against-skfuzzy", "--points", "2", "--json")
    assert code == 0
    assert json.loads(out)["skfuzzy"]["greatest_difference_mamdani"] < 1e-4


def test_a_check_reports_the_error_of_every_compiled_membership_function(tmp_path: Path) -> None:
    path = tmp_path / "curved.yaml"
    text = (CONFIG_DIR / "fear" / "first_drive.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("low: [0.25, 0.35, 0.45]", "low: {gaussmf: [0.35, 0.04]}"), encoding="utf-8")
    code, out = fear("check", str(path))
    assert code == 0
    assert "lateral_error is low: gaussmf as straight lines, within 0.000" in out
    errors = json.loads(fear("check", str(path), "--json")[1])["approximation"]
    assert 0 < errors["lateral_error"]["low"] <= 0.001
