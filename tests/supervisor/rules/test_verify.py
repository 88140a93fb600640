"""Verification: its proofs agree with brute force, and rules that cannot drive are reported."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_rig import FALLING, RISING, small_rules

from supervisor.rules.inference import SILENT, FearRules
from supervisor.rules.proofs import calmest, contradictions, lipschitz, repetitions, silent_point, worst
from supervisor.rules.rule_file import LEVELS
from supervisor.rules.verify import knots, load_verified, verify
from supervisor.supervisor import build
from trepid.config import CONFIG_DIR, InputError

SHIPPED = FearRules.load(CONFIG_DIR / "fear.yaml")
INPUTS = {"a": RISING, "b": FALLING, "c": RISING}
GRID = np.linspace(0, 1, 33)  # corners of the sets, middles, and some between

atoms = st.builds(
    lambda name, no, level: f"{name} is {no}{level}",
    st.sampled_from(sorted(INPUTS)),
    st.sampled_from(["", "", "not "]),
    st.sampled_from(LEVELS),
)
expressions = st.recursive(
    atoms,
    lambda inner: st.builds(
        lambda join, parts: f"({f' {join} '.join(parts)})",
        st.sampled_from(["and", "or"]),
        st.lists(inner, min_size=2, max_size=3),
    ),
    max_leaves=4,
)
sentences = st.builds(
    lambda expression, level, weight: f"if {expression} then fear is {level} with weight {weight}",
    expressions,
    st.sampled_from([*LEVELS, "very_low", "very_low"]),
    st.sampled_from([1, 0.5, 0.125]),
)
rule_sets = st.lists(sentences, min_size=1, max_size=6).map(lambda rules: small_rules(*rules, inputs=INPUTS))
numbers = st.sampled_from([i / 64 for i in range(65)])
points = st.fixed_dictionaries(dict.fromkeys(INPUTS, numbers))


@settings(max_examples=80, deadline=None)
@given(rule_sets)
def test_the_check_reports_silence_exactly_where_a_dense_grid_has_no_active_rule(rules: FearRules) -> None:
    strengths = rules.fear_voice.method.strengths
    corners = [i / 8 for i in range(9)]  # fear is silent on closed boxes between feet, which lie on quarters
    silent = any(not strengths(list(point)) for point in itertools.product(corners, repeat=len(INPUTS)))
    found = silent_point(rules)
    assert (found is not None) == silent
    if found is not None:
        assert rules.evaluate(found).texts == (SILENT,)


@settings(max_examples=120, deadline=None)
@given(rule_sets, points, st.sampled_from(sorted(INPUTS)), numbers)
def test_where_a_rule_is_active_fear_never_falls_as_a_risk_rises_not_even_by_rounding(
    rules: FearRules, point: dict[str, float], name: str, x: float
) -> None:
    riskier = max(point[name], x) if INPUTS[name].risk == "rising" else min(point[name], x)
    less, more = rules.evaluate(point), rules.evaluate({**point, name: riskier})
    assert more.fear >= less.fear or SILENT in less.texts


@settings(max_examples=60, deadline=None)
@given(rule_sets, points, st.sampled_from(sorted(INPUTS)), numbers)
def test_fear_changes_no_faster_than_the_bound(
    rules: FearRules, point: dict[str, float], name: str, x: float
) -> None:
    here, there = rules.evaluate(point), rules.evaluate({**point, name: x})
    if SILENT not in (*here.texts, *there.texts):
        assert abs(here.fear - there.fear) <= lipschitz(rules)[name] * abs(point[name] - x) + 1e-12


def test_the_bound_is_reached_by_a_single_ramp() -> None:
    rules = small_rules(
        "if a is high then fear is very_high with weight 0.5", "if b is very_low then fear is very_low"
    )
    assert lipschitz(rules) == {"a": 2, "b": 0}  # 0.5 over a quarter
    steep = [rules.evaluate({"a": a, "b": 0}).fear for a in (0.5, 0.75)]
    assert (steep[1] - steep[0]) / 0.25 == 2


def test_a_steep_rule_of_a_low_level_counts_by_its_increment() -> None:
    rules = small_rules("if a is low then fear is low", "if a is very_high then fear is very_high")
    assert lipschitz(rules)["a"] == 4  # one quarter of fear over a quarter of a, then all of it


@pytest.mark.parametrize(
    ("sentences", "problem"),
    [
        (("if a is very_high or b is very_high then fear is very_high",), "no rule fires at the calmest point"),
        (
            ("if a is very_low then fear is very_low", "if a is high or b is high then fear is very_high"),
            "no rule fires at a=0.25, the rest calm",
        ),
        (
            ("if a is very_low and b is very_low then fear is very_low", "if a is low then fear is very_high"),
            "no rule fires at b=0.25, the rest calm",
        ),
        (
            ("if a is very_low and b is very_low then fear is very_low", "if b is low then fear is very_high"),
            "no rule fires at a=0.25, the rest calm",
        ),
        (("if a is not very_low or a is very_low then fear is high",), "always fires: if a"),
        (("if a is very_high then fear is very_low", "if b is low then fear is very_high"), "always fires: if a"),
        (("if a is not very_high and b is low then fear is medium",), "never fires: if a"),
        (("if a is very_low then fear is very_low", "if a is low then fear is high"), "no rule contains b"),
        (
            ("if a is very_low then fear is very_low", "if a is low or b is low then fear is high"),
            "with every input at its worst fear is 0.750, expected exactly 1",
        ),
        (
            ("if a is low then fear is medium", "if a is very_high and b is low then fear is low"),
            "contradicts 'if a is low then fear is medium', which counts instead: if a is very_high",
        ),
    ],
)  # fmt: skip
def test_the_check_reports_rules_that_could_not_drive(sentences: tuple[str, ...], problem: str) -> None:
    problems = verify(small_rules(*sentences)).problems
    assert any(found.startswith(problem) for found in problems), problems


GOOD = (
    "if a is very_low and b is very_low then fear is very_low",
    "if a is low or b is low then fear is medium",
    "if a is very_high or b is very_high then fear is very_high",
)


def test_rules_that_could_drive_have_no_problems() -> None:
    assert verify(small_rules(*GOOD)).problems == ()


def test_an_estimator_whose_trust_no_rule_lowers_is_reported() -> None:
    assert verify(small_rules(*GOOD, estimators=("cv",))).problems == ("no rule sets the trust in cv",)


def test_trust_lowered_at_calm_inputs_is_reported() -> None:
    rules = small_rules(*GOOD, "if a is very_low then trust_cv is low", estimators=("cv",))
    assert verify(rules).problems == ("always fires: if a is very_low then trust_cv is low",)


def test_rules_of_different_weight_or_output_do_not_contradict() -> None:
    weak, strong = "if a is low then fear is very_high with weight 0.2", "if a is low then fear is medium"
    rules = small_rules(*GOOD, weak, strong, "if a is low then trust_cv is high", estimators=("cv",))
    assert list(contradictions(rules)) == []


def test_a_repeated_rule_adds_nothing() -> None:
    rules = small_rules(*GOOD, "if a is high or b is low then fear is medium")
    assert [a.text for a, _ in repetitions(rules)] == ["if a is high or b is low then fear is medium"]
    assert verify(rules).problems == ()
    assert verify(rules).notes[0].startswith("adds nothing to 'if a is low or b is low")


def test_mamdanis_method_fails_its_check_and_the_report_states_by_how_much() -> None:
    table = [
        f"if a is {LEVELS[i]} and b is {LEVELS[j]} then fear is {LEVELS[(i + j) // 2]}"
        for i, j in itertools.product(range(5), repeat=2)
    ]
    problems = verify(small_rules(*table, method="mamdani")).problems
    assert "with every input at its calmest fear is 0.083, expected exactly 0" in problems
    assert any("fear falls from" in problem for problem in problems)


def test_the_shipped_rules_have_neither_problems_nor_notes() -> None:
    verdict = verify(SHIPPED)
    assert (verdict.problems, verdict.notes) == ((), ())
    assert verdict.slopes.keys() == set(SHIPPED.names)


def test_the_shipped_rules_are_monotone_along_every_input_through_random_points() -> None:
    rng = np.random.default_rng(7)
    for _ in range(15):
        point = {name: float(rng.choice(knots(spec))) for name, spec in SHIPPED.inputs.items()}
        for name, spec in SHIPPED.inputs.items():
            fears = [SHIPPED.evaluate({**point, name: x}).fear for x in knots(spec)]
            assert fears == sorted(fears)


def test_calmest_and_worst_are_the_ends_by_risk() -> None:
    rules = small_rules("if a is low then fear is low", inputs=INPUTS)
    assert calmest(rules) == {"a": 0, "b": 1, "c": 0}
    assert worst(rules) == {"a": 1, "b": 0, "c": 1}


def test_rules_that_could_not_drive_are_refused_with_the_place_of_the_rule(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    text = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    rule = "  - if speed is very_low then fear is medium\n"
    path.write_text(text.replace("rules:\n", f"rules:\n{rule}"), encoding="utf-8")
    line = path.read_text(encoding="utf-8").splitlines().index(rule.rstrip("\n")) + 1
    with pytest.raises(InputError, match=rf"fear\.yaml:{line}:5: always fires: if speed is very_low"):
        load_verified(path)


def test_verified_rules_are_read_again_when_the_file_changes(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    text = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    first = load_verified(path)
    assert load_verified(path) is first
    path.write_text(text.replace("speed_factor: 0.4", "speed_factor: 0.3"), encoding="utf-8")
    assert load_verified(path).file.fear.high.speed_factor == 0.3


@pytest.mark.parametrize("path", sorted((CONFIG_DIR / "fear").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_variant_may_drive(path: Path) -> None:
    assert verify(FearRules.load(path)).problems == ()
    build(rules=path)  # and needs only measured inputs
