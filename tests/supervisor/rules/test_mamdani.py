"""Mamdani's method is scikit-fuzzy's, but for the points of scikit-fuzzy's grid."""

import itertools

import numpy as np
import pytest
from rule_rig import FALLING, RISING, small_rules

from supervisor.rules.inference import SILENT, FearRules
from supervisor.rules.mamdani import centroid
from supervisor.rules.rule_file import LEVELS
from supervisor.rules.scikit import fear_of, simulation

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:skfuzzy")

INPUTS = {"a": RISING, "b": FALLING}
TABLE = [
    f"if a is {LEVELS[i]} and b is {LEVELS[j]} then fear is {LEVELS[round((i + 4 - j) / 2)]}"
    for i, j in itertools.product(range(5), repeat=2)
]
RICH = [
    "if not (a is very_low or b is very_high) then fear is very_high with weight 0.7",
    "if a is high or b is low then fear is medium with weight 0.4",
    "if a is not high and b is medium then fear is low",
    "if a is very_low or b is very_high then fear is very_low",
    "if (a is low or a is medium) and not b is very_low then fear is high with weight 0.9",
]
TOLERANCE = 1e-5
"""Of a place on 0..1: 401 points miss corners of the outline by up to 1/400, the area by its square."""


@pytest.mark.parametrize("sentences", [TABLE, RICH], ids=["table", "and, or, not, weights"])
def test_fear_is_the_centroid_of_scikit_fuzzy(sentences: list[str]) -> None:
    rules = small_rules(*sentences, inputs=INPUTS, method="mamdani")
    peer = simulation(rules, places=401)
    for a, b in np.random.default_rng(3).random((25, 2)):
        point = {"a": float(a), "b": float(b)}
        assert rules.evaluate(point).fear == pytest.approx(fear_of(peer, point), abs=TOLERANCE)


def test_the_centroid_of_a_single_full_triangle_is_its_peak() -> None:
    at = (0.0, 0.25, 0.5, 0.75, 1.0)
    assert centroid(at, [0, 0, 1, 0, 0]) == pytest.approx(0.5)
    assert centroid(at, [1, 0, 0, 0, 0]) == pytest.approx(0.25 / 3)  # half a triangle
    assert centroid(at, [1, 1, 1, 1, 1]) == pytest.approx(0.5)


def test_the_centroid_is_that_of_a_fine_integral_also_between_unevenly_placed_levels() -> None:
    at, truth = (0.0, 0.1, 0.35, 0.8, 1.0), [0.3, 0.9, 0.2, 0.55, 0.7]
    y = np.linspace(0, 1, 200_001)
    feet = [(at[max(k - 1, 0)], at[k], at[min(k + 1, 4)]) for k in range(5)]
    shapes = [np.interp(y, [a - 1e-12, b, c + 1e-12], [a == b, 1, b == c]) for a, b, c in feet]
    outline = np.max([np.minimum(t, shape) for t, shape in zip(truth, shapes, strict=True)], axis=0)
    assert centroid(at, truth) == pytest.approx(
        np.trapezoid(y * outline, y) / np.trapezoid(outline, y), abs=1e-8
    )


def test_a_missing_input_or_a_silent_rule_base_makes_fear_1_in_contrast_to_scikit_fuzzy() -> None:
    rules: FearRules = small_rules("if a is high then fear is low", inputs=INPUTS, method="mamdani")
    assert rules.evaluate({"a": 0.75, "b": 1}).fear == pytest.approx(0.25)
    assert rules.evaluate({"a": 0.75, "b": float("nan")}).fear == 1
    assert rules.evaluate({"a": 0.1, "b": 1})[0::3] == (1, (SILENT,))


def test_trust_is_1_minus_the_centroid_of_the_rules_that_lower_it() -> None:
    doubt = "if a is high then trust_cv is low"
    rules = small_rules(doubt, *TABLE, estimators=("cv",), method="mamdani", inputs=INPUTS)
    assert rules.trust({"a": 0.75})["cv"].trust == pytest.approx(0.25)
    assert rules.trust({"a": 0.0})["cv"].trust == 1
