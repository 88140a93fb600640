"""Membership functions of scikit-fuzzy as straight lines: the error is bounded and the proofs hold on the lines."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_rig import EVEN, FALLING, RISING, small_rules

from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import contradictions, lipschitz, silent_point
from supervisor.rules.rule_file import LEVELS, Input, Membership, Sets
from supervisor.rules.scikit import stated_degrees
from supervisor.rules.shapes import FuzzySet, compile_set, curve_degree, evaluate, polyline
from supervisor.rules.verify import verify
from trepid.config import CONFIG_DIR, InputError

FUNCTIONS = {
    "trimf": (0.2, 0.5, 0.9),
    "trapmf": (0.2, 0.4, 0.5, 0.9),
    "gaussmf": (0.5, 0.1),
    "gauss2mf": (0.4, 0.1, 0.6, 0.05),
    "gbellmf": (0.2, 3.0, 0.5),
    "sigmf": (0.5, 40.0),
    "dsigmf": (0.3, 60.0, 0.7, 60.0),
    "psigmf": (0.3, 60.0, 0.7, -60.0),
    "smf": (0.2, 0.7),
    "zmf": (0.2, 0.7),
    "pimf": (0.1, 0.4, 0.6, 0.9),
    "piecemf": (0.2, 0.4, 0.9),
}
CURVED_SETS = Sets(
    very_low=Membership(zmf=(0.0, 0.25)),
    low=Membership(gaussmf=(0.25, 0.08)),
    medium=Membership(pimf=(0.25, 0.5, 0.5, 0.75)),
    high=Membership(gbellmf=(0.1, 3.0, 0.75)),
    very_high=Membership(sigmf=(0.85, 60.0)),
)
CURVED = Input(meaning="a risk", unit="1", range=(0, 1), risk="rising", sets=CURVED_SETS)
CURVED_FALLING = Input(
    meaning="a safety",
    unit="1",
    range=(0, 1),
    risk="falling",
    sets=Sets(
        very_low=Membership(sigmf=(0.15, -60.0)),
        low=Membership(gaussmf=(0.3, 0.08)),
        medium=Membership(pimf=(0.25, 0.5, 0.5, 0.75)),
        high=Membership(gaussmf=(0.75, 0.08)),
        very_high=Membership(smf=(0.75, 1.0)),
    ),
)
INPUTS = {"a": CURVED, "b": CURVED_FALLING}
CURVED_RULES = small_rules(
    "if a is high and b is not high then fear is very_high",
    "if a is low or b is medium then fear is medium with weight 0.7",
    "if a is not very_low then fear is low",
    "if a is very_low and b is very_high then fear is very_low",
    inputs=INPUTS,
)
share = st.floats(0, 1, allow_subnormal=False)


def test_every_membership_function_of_the_file_is_tested_here() -> None:
    assert FUNCTIONS.keys() == Membership.model_fields.keys() - {"polyline"}


@pytest.mark.parametrize("tolerance", [0.01, 0.001, 0.0001])
@pytest.mark.parametrize("function", FUNCTIONS)
def test_the_lines_differ_from_the_function_by_less_than_the_tolerance(
    function: str, tolerance: float
) -> None:
    shape, error = compile_set(function, FUNCTIONS[function], (0.0, 1.0), tolerance)
    x = np.random.default_rng(0).random(3000)
    lines = np.array([shape.membership(value) for value in x])
    difference = np.abs(lines - evaluate(function, FUNCTIONS[function], x)).max()
    assert difference <= error + 1e-9 <= tolerance + 1e-9
    assert len(shape.rise) + len(shape.fall) < 400


@pytest.mark.parametrize(
    ("function", "parameters", "message"),
    [
        ("gaussmf", (2.0, 0.1), "must reach 1"),
        ("gaussmf", (0.5, 0.0), "not within 0..1"),
        ("dsigmf", (0.4, 5.0, 0.6, 5.0), "must reach 1"),
        ("sigmf", (0.5, 1e9), "too steep"),
        ("pimf", (0.9, 0.6, 0.4, 0.1), "a <= b <= c <= d"),
    ],
)
def test_a_function_that_makes_no_set_is_refused(
    function: str, parameters: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        compile_set(function, parameters, (0.0, 1.0), 0.001)


def test_a_polyline_keeps_its_corners_and_refuses_two_hills() -> None:
    corners = ((0.0, 0.0), (0.1, 0.25), (0.5, 1.0), (0.6, 1.0), (0.8, 0.5), (1.0, 0.0))
    assert np.allclose(polyline(corners).corners(), corners, atol=1e-15)
    with pytest.raises(ValueError, match="rise from 0 to 1 once"):
        polyline(((0.0, 0.0), (0.2, 1.0), (0.4, 0.5), (0.6, 1.0), (1.0, 0.0)))


@given(share, share, st.lists(st.tuples(share, share), max_size=6))
def test_a_curved_edge_keeps_order_bit_for_bit(x: float, y: float, inner: list[tuple[float, float]]) -> None:
    places = sorted({s for s, _ in inner if 0 < s < 1})
    knots = tuple(zip(places, sorted(d for _, d in inner)[: len(places)], strict=True))
    low, high = sorted((x, y))
    assert curve_degree(low, knots) <= curve_degree(high, knots)


@settings(max_examples=200, deadline=None)
@given(share, share, st.sampled_from("ab"), share)
def test_fear_never_falls_as_a_risk_with_curved_sets_rises(a: float, b: float, name: str, x: float) -> None:
    less, more = {"a": a, "b": b}, {"a": a, "b": b}
    more[name] = max(x, a) if name == "a" else min(x, b)
    assert CURVED_RULES.evaluate(more).fear >= CURVED_RULES.evaluate(less).fear


def test_the_proofs_agree_with_a_grid_on_curved_sets() -> None:
    rules = small_rules(
        "if a is medium then fear is high", "if b is medium then fear is very_high", inputs=INPUTS
    )
    grid = [{"a": a, "b": b} for a, b in itertools.product(np.linspace(0, 1, 41).tolist(), repeat=2)]
    assert silent_point(rules) is not None
    whole = small_rules(*(r.text for r in rules.rules), "if a is low then fear is very_low", inputs=INPUTS)
    silent = silent_point(whole)
    fires = [bool(whole.fear_voice.method.strengths([p["a"], p["b"]])) for p in grid]
    assert (silent is None) == all(fires)
    slopes, step = lipschitz(rules), 1e-4
    for point in grid:
        for name in ("a", "b"):
            other = {**point, name: min(point[name] + step, 1.0)}
            change = abs(rules.evaluate(other).fear - rules.evaluate(point).fear)
            assert change <= slopes[name] * step + 1e-12


def test_a_rule_dominated_by_another_rule_is_found_on_curved_sets_too() -> None:
    void, counts = "if a is high then fear is low", "if a is medium then fear is high"
    rules = small_rules(void, counts, "if b is low then fear is low", inputs=INPUTS)
    assert [(a.text, b.text) for a, b in contradictions(rules)] == [(void, counts)]


def test_a_function_and_its_points_infer_the_same_to_the_last_bit() -> None:
    stated = {level: Membership(trapmf=RISING.shapes[level][:4]) for level in LEVELS}
    functions = Input(**{**RISING.model_dump(exclude={"sets"}), "sets": Sets(**stated)})
    assert [functions.shapes[level] for level in LEVELS] == [RISING.shapes[level] for level in LEVELS]
    assert EVEN.low == (0, 0.25, 0.5) and FALLING.shapes["low"] == FuzzySet(0, 0.25, 0.25, 0.5)


def curved_file(folder: Path, function: str) -> Path:
    text = (CONFIG_DIR / "fear" / "first_drive.yaml").read_text(encoding="utf-8")
    assert "low: [0.25, 0.35, 0.45]" in text
    path = folder / "fear.yaml"
    path.write_text(text.replace("low: [0.25, 0.35, 0.45]", f"low: {function}"), encoding="utf-8")
    return path


def test_a_file_with_functions_passes_the_checks_and_uses_them(tmp_path: Path) -> None:
    rules = FearRules.load(curved_file(tmp_path, "{gaussmf: [0.35, 0.04]}"))
    assert verify(rules).problems == ()
    x = np.linspace(0, 0.34, 50)
    expected = stated_degrees(rules.inputs["lateral_error"], "low", x)
    found = [rules.memberships({"lateral_error": v})["lateral_error"]["low"] for v in x.tolist()]
    assert found == pytest.approx(expected.tolist(), abs=0.001)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            "{gausmf: [0.35, 0.04]}",
            r"unknown field 'inputs.lateral_error.sets.low.gausmf'; did you mean 'gaussmf'",
        ),
        ("{gaussmf: [0.35]}", r"low.gaussmf"),
        ("{gaussmf: [0.35, 0.04], trimf: [0, 1, 2]}", "expected one membership function"),
        ("{}", "expected one membership function"),
        ("{gaussmf: null}", "expected one membership function"),
        ("{gaussmf: [9.0, 0.04]}", "the greatest degree in the range is 0; it must reach 1"),
        ("{pimf: [0.4, 0.3, 0.2, 0.1]}", "a <= b <= c <= d"),
    ],
)
def test_a_bad_function_is_refused_with_line_and_column(tmp_path: Path, function: str, message: str) -> None:
    path = curved_file(tmp_path, function)
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if f"low: {function}" in text)
    with pytest.raises(InputError, match=rf"fear\.yaml:{line}:\d+: .*{message}"):
        FearRules.load(path)
