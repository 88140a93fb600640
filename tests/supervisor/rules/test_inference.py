"""The engine: scikit-fuzzy's sets, fear that never falls as a risk rises, and no silence."""

import itertools
import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import skfuzzy
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_rig import FALLING, RISING, small_rules
from scipy.stats import kendalltau

from supervisor.rules.inference import SILENT, FearRules, Trust, centroid
from supervisor.rules.proofs import calmest, worst
from supervisor.rules.rule_file import LEVELS, Input, RuleFile, Sets
from supervisor.rules.scikit import fear_of, simulation
from supervisor.rules.sentence import parse_rule
from trepid.config import CONFIG_DIR
from trepid.messages import Mode

RULES = FearRules.load(CONFIG_DIR / "fear.yaml")
CALM, WORST = calmest(RULES) | {"segments_support": 0.0}, worst(RULES)  # a car without segments
POINTS = st.fixed_dictionaries(
    {name: st.floats(*spec.range, allow_subnormal=False) for name, spec in RULES.inputs.items()}
)


def rules_of(*sentences: str, inputs: dict[str, Input] | None = None) -> FearRules:
    """The shipped file with other rules, and other inputs if given."""
    file = RuleFile(
        inputs=inputs or RULES.inputs,
        rules=sentences,
        fear=RULES.file.fear,
        hysteresis=RULES.file.hysteresis,
    )
    return FearRules(file, tuple(parse_rule(sentence, file.inputs) for sentence in sentences))


@settings(max_examples=25, deadline=None)
@given(POINTS)
def test_memberships_are_those_of_scikit_fuzzy(point: dict[str, float]) -> None:
    memberships = RULES.memberships(point)
    for name, spec in RULES.inputs.items():
        for level in LEVELS:
            points = getattr(spec.sets, level)
            if not isinstance(points, tuple):  # a polyline
                continue
            function = skfuzzy.trapmf if len(points) == 4 else skfuzzy.trimf
            expected = float(function(np.array([point[name]]), list(points))[0])
            assert memberships[name][level] == pytest.approx(expected, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(POINTS, st.sampled_from(RULES.names), st.floats(0, 1))
def test_fear_never_falls_as_a_risk_rises(point: dict[str, float], name: str, part: float) -> None:
    riskier = point[name] + part * (RULES.inputs[name].worst - point[name])
    assert (
        RULES.evaluate({**point, name: riskier}).fear >= RULES.evaluate(point).fear - 1e-12
    )  # rounding of a sum


def fears_of(confidences: list[float], **others: float) -> list[float]:
    alone = {**CALM, "lead_confidence": 0.0} | others  # no vehicle to follow
    return [RULES.evaluate({**alone, "lane_confidence": c}).fear for c in confidences]


def test_without_a_path_every_loss_of_confidence_raises_fear() -> None:
    fears = fears_of([0.0, 0.01, 0.05, 0.1, 0.15, 0.18, 0.23, 0.3, 0.38, 0.45, 0.55, 0.65], lateral_error=2.0)
    assert all(one > other for one, other in itertools.pairwise(fears))
    assert fears[0] == 1.0


def test_below_the_highest_level_confidence_alone_raises_fear_by_less_than_a_sixth_of_a_level() -> None:
    step = RULES.file.fear.very_high.at - RULES.file.fear.high.at
    high = fears_of([0.2, 0.4, 0.6], lateral_error=2.0)
    assert all(RULES.file.fear.high.at < fear < RULES.file.fear.high.at + step / 6 for fear in high)


@pytest.mark.parametrize("lateral_error", [0.0, 2.0])
def test_the_highest_level_of_fear_begins_half_way_down_the_edge_of_very_low_confidence(
    lateral_error: float,
) -> None:
    above, below = fears_of([0.151, 0.149], lateral_error=lateral_error)
    assert RULES.mode(above) is Mode.CAUTION
    assert RULES.mode(below) is Mode.STOP


@settings(max_examples=60, deadline=None)
@given(POINTS, st.sampled_from(RULES.names), st.sampled_from([None, math.nan, math.inf, -math.inf]))
def test_a_missing_input_makes_fear_1_and_is_named(
    point: dict[str, float], name: str, absent: float | None
) -> None:
    result = RULES.evaluate({**point, name: absent})
    assert result.fear == 1
    assert result.texts[0].startswith(f"missing {name}")


def test_an_input_left_out_is_missing() -> None:
    assert RULES.evaluate({}).fear == 1
    assert {f"missing {name}" for name in RULES.names} <= {
        text.split(":")[0] for text in RULES.evaluate({}).texts
    }


@pytest.mark.parametrize("side", ["worst", "calmest"])
@pytest.mark.parametrize("name", RULES.names)
def test_a_value_beyond_the_range_counts_as_its_end_only_where_the_file_permits_it(
    name: str, side: str
) -> None:
    spec = RULES.inputs[name]
    middle, end = sum(spec.range) / 2, getattr(spec, side)
    result = RULES.evaluate({**CALM, name: end + (end - middle)})
    if spec.beyond == "end":
        assert result == RULES.evaluate({**CALM, name: end})
    else:
        assert (result.fear, result.texts[0].split(" ")[:2]) == (1, ["impossible", name])


def test_fear_is_exactly_0_when_all_is_calm_and_exactly_1_at_the_worst() -> None:
    calm, terrified = RULES.evaluate(CALM), RULES.evaluate(WORST)
    assert (calm.fear, calm.level, calm.cause) == (0, "very_low", "none")
    assert (terrified.fear, terrified.level) == (1, "very_high")


def test_where_no_rule_is_active_fear_is_1() -> None:
    result = rules_of("if speed is very_high then fear is low").evaluate(CALM)
    assert (result.fear, result.cause) == (1, "no_rule")
    assert result.texts[-1] == SILENT


def test_strength_is_min_for_and_max_for_or_and_times_the_weight() -> None:
    values = {**CALM, "disagreement": 0.6, "lateral_error": 0.4}  # low: 0.75 and 2/3
    both, either, weighted = (
        rules_of(f"if {text}").evaluate(values)
        for text in (
            "disagreement is low and lateral_error is low then fear is very_high",
            "disagreement is low or lateral_error is low then fear is very_high",
            "disagreement is low then fear is very_high with weight 0.5",
        )
    )
    assert both.strengths[0] == pytest.approx(2 / 3)
    assert either.strengths[0] == pytest.approx(0.75)
    assert weighted.strengths[0] == pytest.approx(0.375)
    assert both.fear == pytest.approx(2 / 3)  # a rule for level 1 at strength t gives t


def test_fear_is_the_choquet_integral_of_the_levels() -> None:
    result = rules_of(
        "if disagreement is low then fear is medium",
        "if disagreement is medium then fear is very_high",
    ).evaluate({**CALM, "disagreement": 1.0})  # low: 1, medium: 0.6
    assert result.fear == pytest.approx(0.5 * 1.0 + 0.5 * 0.6)


def test_not_holds_where_the_set_and_all_calmer_ones_do_not() -> None:
    rules = rules_of(
        "if speed is not very_low then fear is very_high", "if speed is low then fear is very_low"
    )
    for speed in (0.0, 0.4, 0.75, 2.0, 30.0):
        not_slow = 1 - RULES.memberships({"speed": speed})["speed"]["very_low"]
        assert rules.evaluate({**CALM, "speed": speed}).fear == pytest.approx(not_slow)


def _two_inputs() -> dict[str, Input]:
    sets = Sets(
        very_low=(0, 0, 0.25),
        low=(0, 0.25, 0.5),
        medium=(0.25, 0.5, 0.75),
        high=(0.5, 0.75, 1),
        very_high=(0.75, 1, 1),
    )
    return {
        name: Input(meaning=name, unit="1", range=(0, 1), risk="rising", sets=sets) for name in ("a", "b")
    }


def test_fear_ranks_points_as_mamdanis_method_does() -> None:
    """25 rules over two inputs, fear the mean level; scikit-fuzzy's primitives give the centroid."""
    table = {(i, j): round((i + j) / 2 + 0.1) for i, j in itertools.product(range(5), repeat=2)}
    rules = rules_of(
        *(
            f"if a is {LEVELS[i]} and b is {LEVELS[j]} then fear is {LEVELS[k]}"
            for (i, j), k in table.items()
        ),
        inputs=_two_inputs(),
    )
    universe = np.linspace(0, 1, 201)
    sets = [
        skfuzzy.trimf(universe, [max(0, k - 1) / 4, k / 4, min(4, k + 1) / 4]) for k in range(len(LEVELS))
    ]

    def mamdani(a: float, b: float) -> float:
        degree = [[skfuzzy.interp_membership(universe, s, x) for s in sets] for x in (a, b)]
        clipped = [np.fmin(min(degree[0][i], degree[1][j]), sets[k]) for (i, j), k in table.items()]
        return float(skfuzzy.defuzz(universe, np.max(clipped, axis=0), "centroid"))

    points = np.random.default_rng(1).random((80, 2))
    ours = [rules.evaluate({"a": a, "b": b}).fear for a, b in points]
    theirs = [mamdani(a, b) for a, b in points]
    assert kendalltau(ours, theirs).statistic > 0.85


@given(st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=60, deadline=None)
def test_more_fear_is_never_faster(one: float, other: float) -> None:
    less, more = sorted((one, other))
    assert RULES.speed_factor(more) <= RULES.speed_factor(less)
    assert (RULES.speed_factor(0), RULES.speed_factor(1)) == (1, 0)


@pytest.mark.parametrize(
    ("values", "cause", "mode"),
    [
        ({"brightness": 0.02, "lane_confidence": 0.1}, "dark", Mode.STOP),
        ({"brightness": 0.0, "contrast": 0.0, "under_exposed": 1.0, "frozen": 1.0}, "dark", Mode.STOP),
        ({"brightness": 1.0, "contrast": 0.0, "over_exposed": 1.0}, "over_exposed", Mode.STOP),
        ({"brightness": 0.05}, "dark", Mode.CAUTION),
        ({"over_exposed": 0.6, "lane_confidence": 0.1}, "over_exposed", Mode.STOP),
        ({"over_exposed": 0.6}, "over_exposed", Mode.CAUTION),
        ({"sharpness": 1.0}, "blurred", Mode.CAUTION),
        ({"frozen": 0.5, "speed": 5.0}, "frozen_camera", Mode.STOP),
        ({"frozen": 2.0, "speed": 0.0}, "none", Mode.KEEP),
        ({"lane_confidence": 0.0, "lead_confidence": 0.0}, "no_road", Mode.STOP),
        ({"lane_confidence": 0.0}, "no_road", Mode.CAUTION),
        ({"cv_confidence": 0.0}, "low_confidence", Mode.CAUTION),
        ({"disagreement": 4.0}, "disagreement", Mode.STOP),
        ({"separation": 0.6}, "disagreement", Mode.CAUTION),
        ({"frame_age": 0.4}, "stale_data", Mode.STOP),
        ({"estimator_age": 0.5}, "lost_estimator", Mode.STOP),
        ({"cv_confidence": None, "estimator_age": 0.6}, "lost_estimator", Mode.STOP),
        ({"state_age": None, "speed": None}, "vehicle_state_lost", Mode.STOP),
        ({"brightness": None, "sharpness": None}, "image_statistics_lost", Mode.STOP),
        ({"cv_confidence": None, "frame_age": 0.4}, "stale_data", Mode.STOP),
        ({"lateral_demand": 5.0}, "demand", Mode.CAUTION),
        ({"cv_confidence": 0.8, "second_confidence": 0.35}, "none", Mode.KEEP),
        ({"cv_confidence": 0.8, "second_confidence": 0.35, "cnn_path_jitter": 0.25}, "odd_road", Mode.STOP),  # snow
        ({"lead_confidence": 0.0}, "none", Mode.KEEP),
    ],
)  # fmt: skip
def test_the_shipped_rules_name_the_cause(values: dict[str, float | None], cause: str, mode: Mode) -> None:
    result = RULES.evaluate({**CALM, **values})
    assert (result.cause, RULES.mode(result.fear)) == (cause, mode)


@pytest.mark.parametrize(
    "image",
    [
        {"over_exposed": 0.43},
        {"under_exposed": 0.75},
        {"brightness": 0.06},
        {"sharpness": 1.0},
        {"contrast": 0.02},
    ],
)
def test_in_a_poor_image_a_lane_that_only_a_distrusted_network_sees_raises_fear(
    image: dict[str, float],
) -> None:
    seen, remembered = (
        RULES.evaluate({**CALM, **image, "seen_confidence": confidence}).fear for confidence in (0.9, 0.5)
    )
    assert seen <= 0.5 and remembered > 0.7
    assert RULES.evaluate({**CALM, "seen_confidence": 0.5}).fear == 0.0  # between two dashes of a line


@pytest.mark.parametrize(
    ("edges", "cause"),
    [({"edge_doubt": 0.15}, "weak_edges"), ({"speed": 8.0}, "unmarked"), ({}, "unmarked")],
)
def test_edges_between_two_dashes_make_no_road_without_lines(edges: dict[str, float], cause: str) -> None:
    gap, bare = ({**CALM, "unmarked": 1.0, "unmarked_way": way_m, **edges} for way_m in (12.0, 20.0))
    assert RULES.evaluate(gap).fear == 0.0
    assert RULES.evaluate(bare).cause == cause and RULES.evaluate(bare).fear > 0.2


@settings(max_examples=20, deadline=None)
@given(POINTS, POINTS)
def test_evaluating_changes_nothing(point: dict[str, float], other: dict[str, float]) -> None:
    before = RULES.evaluate(point)
    RULES.evaluate(other)
    assert RULES.evaluate(point) == before


def test_rules_are_reported_strongest_first() -> None:
    strengths = list(RULES.evaluate({**CALM, "disagreement": 1.9}).strengths)
    assert len(strengths) > 1
    assert strengths == sorted(strengths, reverse=True)


def test_a_weight_can_only_calm() -> None:
    heavy = parse_rule("if disagreement is high then fear is very_high", RULES.names)
    light = replace(heavy, weight=0.3)
    values = {**CALM, "disagreement": 3.0}
    fears = [FearRules(RULES.file, (rule,)).evaluate(values).fear for rule in (heavy, light)]
    assert fears == [1, pytest.approx(0.3)]


def random_results(seed: int) -> list[tuple[float, str, tuple[float, ...]]]:
    """Fear, cause and strengths of the shipped rules at random points."""
    rng = np.random.default_rng(seed)
    points = [{n: float(rng.uniform(*spec.range)) for n, spec in RULES.inputs.items()} for _ in range(200)]
    return [(result.fear, result.cause, result.strengths) for result in map(RULES.evaluate, points)]


def test_threads_that_share_the_rules_compute_the_same_bits() -> None:
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(random_results, [1, 2, 3, 4])) == [
            random_results(seed) for seed in (1, 2, 3, 4)
        ]


def test_rules_sent_to_another_process_and_back_compute_the_same_bits() -> None:
    again = pickle.loads(pickle.dumps(RULES))
    for point in (CALM, WORST, {**CALM, "disagreement": 1.9, "speed": 7.7}):
        assert again.evaluate(point) == RULES.evaluate(point)
        assert again.trust(point) == RULES.trust(point)


def test_trust_is_1_without_an_active_rule_and_falls_to_the_value_of_a_rule() -> None:
    rules = small_rules("if a is high then trust_cv is low because dim", estimators=("cv", "cnn"))
    assert rules.trust({"a": 0.0})["cv"] == Trust(1, "none", (), ())
    assert rules.trust({"a": 1.0})["cv"][:2] == (0.25, "dim")
    assert rules.trust({"a": 0.625})["cv"].trust == pytest.approx(1 - 0.5 * 0.75)
    assert rules.trust({"a": 1.0})["cnn"].trust == 1


def test_trust_needs_only_the_inputs_of_its_rules_and_takes_a_missing_one_as_the_worst() -> None:
    rules = small_rules("if a is high then trust_cv is very_low because dim", estimators=("cv",))
    assert rules.trust({"a": 0.0, "b": None})["cv"].trust == 1
    lost = rules.trust({"a": None})["cv"]
    assert (lost.trust, lost.cause, lost.texts[0]) == (0, "missing_data", "missing a: taken as very_high")


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 1), st.floats(0, 1), st.sampled_from("ab"), st.floats(0, 1))
def test_more_risk_is_never_more_trust(a: float, b: float, name: str, x: float) -> None:
    rules = small_rules(
        "if a is low and b is not very_low then trust_cv is medium with weight 0.7",
        "if a is high or b is very_high then trust_cv is very_low",
        estimators=("cv",),
    )
    less, more = {"a": a, "b": b}, {"a": a, "b": b}
    more[name] = max(x, less[name])
    assert rules.trust(more)["cv"].trust <= rules.trust(less)["cv"].trust


def test_rules_about_trust_do_not_raise_fear() -> None:
    doubt, fear = "if a is high then trust_cv is very_low", "if a is very_high then fear is low"
    rules = small_rules(doubt, fear, estimators=("cv",))
    assert rules.evaluate({"a": 0.75, "b": 0}).cause == "no_rule"


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
