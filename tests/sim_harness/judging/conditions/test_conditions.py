"""Sentences over time: robustness by hand, by brute force and by rtamt; errors of wrong sentences."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.judging.conditions.meaning import parse_condition
from sim_harness.judging.conditions.signals import SUFFIXES, UNITS
from sim_harness.judging.trace import Trace, column_names
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.roads.disturbances import Disturbance
from supervisor.rules.inference import FearRules
from trepid.config import CONFIG_DIR

DT_S = 0.1
RULES = FearRules.load(CONFIG_DIR / "fear.yaml")


def run(n=11, labels=None, start_s=0.0, **signals):
    """A trace of ``n`` samples every 0.1 s; signals that are not given are absent."""
    columns = {name: np.full(n, np.nan) for name in column_names(("cv", "cnn"))}
    for name in ("departures", "interventions", "collisions"):
        columns[name] = np.zeros(n)
    columns |= {"t_s": start_s + DT_S * np.arange(n)}
    columns |= {
        name.replace("__", "."): np.broadcast_to(np.asarray(v, float), n) for name, v in signals.items()
    }
    words = {}
    for label in ("section", "mode", "stop", "cause", "path_source"):
        column = (labels or {}).get(label, ["-"] * n)
        words[label] = tuple(dict.fromkeys(word for word in column if word is not None))
        columns[label] = np.array(
            [-1 if word is None else words[label].index(word) for word in column], float
        )
    return Trace(columns, words)


def robustness(text, trace):
    return parse_condition(text).robustness(trace)


def flags(n, *spans):
    """1 in each [from, to) of samples, else 0."""
    active = np.zeros(n)
    for start, stop in spans:
        active[start:stop] = 1
    return active


RAMP = run(speed_mps=np.arange(11.0), lateral_offset_m=np.linspace(-0.5, 0.5, 11))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("speed <= 12", 2.0),
        ("speed_mps <= 36 km/h", 0.0),
        ("always speed >= 3 m/s", -3.0),
        ("eventually speed >= 8", 2.0),
        ("never speed > 9", -1.0),
        ("speed >= 3 from t = 0.5 s on", 2.0),
        ("speed >= 3 after 500 ms", 2.0),
        ("speed <= 3 before t = 0.2 s", 1.0),
        ("speed <= 3 until t = 0.2 s", 1.0),
        ("speed <= 7 from t = 0.2 s to 0.5 s", 2.0),
        ("speed >= 1 between t = 0.2 s and t = 0.5 s", 1.0),
        ("speed >= 9 at the end", 1.0),
        ("speed == 5 at t = 0.5 s", 0.0),
        ("speed >= 5 at t = 0.59 s", 0.0),  # a sample holds until the next one
        ("|lateral_offset| <= 30 cm", -0.2),
        ("-0.3 m <= lateral_offset <= 0.6 m", -0.2),
        ("speed + 2 m/s >= 1", 1.0),
        ("speed <= 12 m/s and |lateral_offset| <= 0.7 m", 0.2),
        ("speed >= 3 or lateral_offset <= 0", 0.2),
        ("not (speed >= 11)", 1.0),
        ("speed <= 7 while speed <= 5", 2.0),
        ("speed >= 9 within 0.3 s of speed >= 7", 1.0),
        ("speed >= 9 for 0.3 s after speed >= 7", -2.0),
        ("speed <= 5 within 0.3 s before speed >= 7", 1.0),
        ("always speed >= 6 within 0.3 s of speed >= 7", 1.0),
    ],
)
def test_a_sentence_has_the_robustness_worked_out_by_hand(text, expected):
    assert robustness(text, RAMP) == pytest.approx(expected, abs=1e-9)


def test_each_occurrence_of_an_event_is_judged_and_the_worst_decides():
    fear = np.full(21, 0.1)
    fear[4], fear[16] = 0.9, 0.7  # glare comes at 0.2 s and at 1.2 s: fear follows after 0.2 s and 0.4 s
    trace = run(21, decision__fear=fear, disturbance__glare=3 * flags(21, (2, 8), (12, 18)))
    assert robustness("fear >= 0.5 within 0.5 s of glare", trace) == pytest.approx(0.2)
    assert robustness("fear >= 0.5 within 0.3 s of glare", trace) == pytest.approx(-0.4)
    assert robustness("fear <= 0.2 from glare ends on", trace) == pytest.approx(-0.5)
    assert robustness("fear <= 0.2 for 0.3 s after glare ends", trace) == pytest.approx(0.1)
    assert robustness("fear <= 0.2 until glare", trace) == pytest.approx(0.1)


def test_a_window_excludes_the_samples_around_its_events():
    trace = run(21, speed_mps=np.arange(21.0), disturbance__glare=flags(21, (10, 12)))
    assert robustness("speed >= 7 for 0.5 s before glare", trace) == -2.0
    assert robustness("speed >= 7 for 0.5 s before glare from t = 0.8 s on", trace) == 1.0
    assert robustness("speed <= 13 for 0.5 s after glare", trace) == -2.0
    assert robustness("speed <= 13 for 0.5 s after glare until t = 1.2 s", trace) == 1.0
    assert "glare did not occur" in parse_condition(
        "speed <= 99 for 1 s after glare until t = 0.5 s"
    ).explain(trace)


def test_a_state_active_from_the_start_begins_there_and_an_absent_state_has_no_end():
    trace = run(speed_mps=np.arange(11.0), fault__frozen_camera=flags(11, (0, 4)))
    assert robustness("speed <= 2 for 0.2 s after frozen_camera begins", trace) == 0.0
    assert robustness("speed <= 5 for 0.1 s after frozen_camera ends", trace) == 0.0
    assert robustness("speed >= 4 from frozen_camera ends on", trace) == 0.0


def test_words_are_true_or_false_and_spelling_of_modes_does_not_depend_on_case():
    trace = run(
        labels={"mode": [None, *["KEEP"] * 7, *["STOP"] * 3], "section": ["plain"] * 5 + ["worn"] * 6}
    )
    assert robustness("eventually mode is stop before t = 0.8 s", trace) == math.inf
    assert robustness("eventually mode is STOP before t = 0.7 s", trace) == -math.inf
    assert robustness("never mode is FOLLOW", trace) == math.inf
    assert robustness("never mode is STOP", trace) == -math.inf
    assert robustness("mode is not KEEP whenever section is worn after 0.8 s", trace) == math.inf
    assert robustness("section is 'worn' from mode is STOP on", trace) == math.inf
    for claim in ("mode is KEEP", "mode is not KEEP"):  # before the first decision neither is true
        assert "no sample to judge" in parse_condition(f"{claim} at t = 0 s").explain(trace)


def test_scopes_by_section_judge_only_its_samples():
    offset_m = [0.9] * 5 + [0.1, 0.25, 0.2] + [0.9] * 3
    trace = run(lateral_offset_m=offset_m, labels={"section": ["plain"] * 5 + ["worn"] * 3 + ["plain"] * 3})
    for scope in ("while section is worn", "while worn", "during worn"):
        assert robustness(f"|lateral_offset| <= 0.3 m {scope}", trace) == pytest.approx(0.05)


def test_a_condition_whose_event_never_occurred_is_not_passed():
    for text in (
        "speed <= 99 within 2 s of glare",
        "speed <= 99 while glare",
        "speed <= 99 until glare",
        "speed <= 99 from t = 10 s on",
        "time_gap >= 1.5 s",
        "eventually time_gap >= 0 s",
        "cv.confidence >= 0",
    ):
        condition = parse_condition(text)
        assert condition.robustness(RAMP) == -math.inf
        assert "failed" in condition.explain(RAMP)


def test_any_and_whenever_pass_without_an_occurrence():
    assert robustness("speed <= 0 within 2 s before any departure", RAMP) == math.inf
    assert robustness("speed <= 0 whenever glare", RAMP) == math.inf
    assert robustness("speed <= 0 within 2 s of any glare", RAMP) == math.inf


def test_departures_are_events():
    trace = run(decision__fear=np.linspace(0, 1, 11), departures=flags(11, (6, 11)))
    assert robustness("fear >= 0.5 within 0.3 s before departure", trace) == pytest.approx(0.1)
    assert robustness("fear >= 0.7 within 0.3 s before departure", trace) == pytest.approx(-0.1)


def test_an_absent_signal_is_not_judged_and_its_absence_can_be_a_condition():
    gap_m = [math.nan, math.nan, *[20.0] * 9]
    trace = run(lead_gap_m=gap_m, speed_mps=10.0, decision__fear=[math.nan, *[0.2] * 10])
    assert robustness("time_gap >= 1.5 s", trace) == pytest.approx(0.5)
    assert robustness("never time_gap < 1.5 s", trace) == pytest.approx(0.5)
    assert robustness("time_gap is known", trace) == -math.inf
    assert robustness("time_gap is known from t = 0.2 s on", trace) == math.inf
    assert robustness("fear is not unknown after 0.1 s", trace) == math.inf
    # A false operand decides a conjunction, a true one a disjunction; else the result is open.
    assert robustness("speed <= 9 and time_gap >= 3 s at t = 0 s", trace) == -1.0
    assert robustness("speed >= 9 or time_gap >= 3 s at t = 0 s", trace) == 1.0
    for pair in ("speed >= 9 and time_gap >= 3 s", "speed <= 9 or time_gap >= 3 s"):
        assert "no sample to judge" in parse_condition(f"{pair} at t = 0 s").explain(trace)


def test_standing_still_keeps_any_time_gap():
    trace = run(lead_gap_m=2.0, speed_mps=[*[4.0] * 5, *[0.0] * 6])
    assert robustness("time_gap >= 0.4 s", trace) == pytest.approx(0.1)
    assert robustness("time_gap >= 5 s from t = 0.5 s on", trace) == math.inf


@given(st.floats(0, 1))
def test_words_for_fear_mean_the_levels_that_the_supervisor_reports(fear):
    trace, names = run(1, decision__fear=fear), ("very_low", "low", "medium", "high", "very_high")
    at = names.index(RULES.level(fear))
    for i, name in enumerate(names):
        claims = {">=": at >= i, ">": at > i, "<=": at <= i, "<": at < i, "is": at == i, "!=": at != i}
        for sign, true in claims.items():
            assert (robustness(f"fear {sign} {name}", trace) >= 0) == true, (sign, name)


@pytest.mark.parametrize("sign", ["<", "<=", ">", ">=", "==", "!="])
@pytest.mark.parametrize("speed", [4.0, 5.0, 6.0])
def test_a_claim_passes_exactly_when_it_is_true_and_its_negation_when_it_is_not(sign, speed):
    trace = run(1, speed_mps=speed)
    true = eval(f"{speed} {sign} 5.0")
    assert (robustness(f"speed {sign} 5", trace) >= 0) == true
    assert (robustness(f"not speed {sign} 5", trace) >= 0) == (not true)
    assert (robustness(f"never speed {sign} 5", trace) >= 0) == (not true)


small = st.sampled_from([math.nan, -1.0, 0.0, 0.5, 1.0, 2.0])


@settings(max_examples=150, deadline=None)
@given(
    speeds=st.lists(small, min_size=1, max_size=9),
    glare=st.lists(st.booleans(), min_size=9, max_size=9),
    quantifier=st.sampled_from(["always", "eventually", "never"]),
    sign=st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
    scope=st.sampled_from(["", "while", "within", "window"]),
)
def test_robustness_has_the_sign_of_the_plain_meaning(speeds, glare, quantifier, sign, scope):
    n = len(speeds)
    trace = run(n, speed_mps=speeds, disturbance__glare=[float(g) for g in glare[:n]])
    words = {
        "": "",
        "while": "while glare",
        "within": "within 0.2 s of glare",
        "window": "from t = 0.2 s to 0.4 s",
    }
    begins = [i for i in range(n) if glare[i] and (i == 0 or not glare[i - 1])]
    stretches = {
        "": [range(n)],
        "while": [[i for i in range(n) if glare[i]]],
        "within": [range(i, min(i + 3, n)) for i in begins],
        "window": [range(2, min(5, n))],
    }[scope]
    true = [[eval(f"{speeds[i]} {sign} 0.5") for i in s if not math.isnan(speeds[i])] for s in stretches]
    if quantifier == "eventually":
        expected = bool(true) and all(any(stretch) for stretch in true)
    else:
        expected = any(true) and all(all(t == (quantifier == "always") for t in stretch) for stretch in true)
    assert (robustness(f"{quantifier} speed {sign} 0.5 {words[scope]}", trace) >= 0) == expected


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-5, 5), min_size=3, max_size=20), st.floats(-0.999, 0.999), st.booleans())
def test_no_change_smaller_than_the_robustness_changes_the_verdict(speeds, share, eventually):
    text = ("eventually" if eventually else "always") + " |speed| <= 2 and speed >= -1.5"
    margin = robustness(text, run(len(speeds), speed_mps=speeds))
    nudged = np.array(speeds) + share * abs(margin) * np.cos(np.arange(len(speeds)))
    if abs(margin) > 1e-9:
        assert (robustness(text, run(len(speeds), speed_mps=nudged)) >= 0) == (margin >= 0)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("speed <= 1.2", "always(speed <= 1.2)"),
        ("eventually speed >= 1.2 from t = 0.5 s to 1.2 s", "eventually[5:12](speed >= 1.2)"),
        ("always speed >= -1 and offset <= 1 from t = 0.3 s on", "always[3:40](speed >= -1 and offset <= 1)"),
        ("never speed > 1 or offset < -1", "always(not (speed > 1 or offset < -1))"),
        (
            "speed >= 0.5 within 0.4 s of glare",
            "always((rise(glare > 0)) implies (eventually[0:4](speed >= 0.5)))",
        ),
        ("speed <= 1 for 0.3 s after glare", "always((rise(glare > 0)) implies (always[0:3](speed <= 1)))"),
        ("speed >= 0 while glare", "always((glare > 0) implies (speed >= 0))"),
    ],
)
def test_robustness_agrees_with_rtamt(ours, theirs, seed):
    rtamt = pytest.importorskip("rtamt")
    rng = np.random.default_rng(seed)
    speed, offset = rng.normal(size=(2, 41))
    active = np.repeat(rng.integers(0, 2, size=9), 5)[:41]
    active[:10] = [0] * 5 + [1] * 5
    specification = rtamt.StlDiscreteTimeSpecification()
    for name in ("speed", "offset", "glare", "out"):
        specification.declare_var(name, "float")
    specification.spec = f"out = {theirs}"
    specification.parse()
    # A scope is true or false by infinity, so that robustness stays that of the claim.
    infinite = np.where(active > 0, 1e9, -1e9)
    rows = {
        "time": list(range(41)),
        "speed": speed.tolist(),
        "offset": offset.tolist(),
        "glare": infinite.tolist(),
    }
    expected = specification.evaluate(rows)[0][1]
    trace = run(41, speed_mps=speed, lateral_offset_m=offset, disturbance__glare=active)
    assert robustness(ours.replace("offset", "lateral_offset"), trace) == pytest.approx(expected)


def test_the_worst_moment_is_explained_from_the_start_of_the_run():
    speed = [4.0, 5.0, 6.5, 5.0]
    condition = parse_condition("speed <= 6 m/s")
    assert condition.explain(run(4, speed_mps=speed, start_s=100.0)) == (
        "speed <= 6 m/s: failed by 0.5 m/s at 0.20 s, speed_mps = 6.5"
    )
    never_held = parse_condition("speed <= 6 m/s while glare").explain(run(4, speed_mps=speed))
    assert never_held.endswith("failed: its `while` never held")
    never_came = parse_condition("speed <= 6 m/s within 1 s of glare").explain(run(4, speed_mps=speed))
    assert never_came == "speed <= 6 m/s within 1 s of glare: failed: glare did not occur"


WRONG = {
    "sped <= 5": (1, "did you mean 'speed'?"),
    "speed <= 5 furlongs": (12, "no unit 'furlongs'"),
    "speed <= 5 s": (10, "in s"),
    "speed + 1 s <= 5": (9, "cannot add s to m/s"),
    "speed": (6, "expected a comparison"),
    "speed <=": (9, "expected a signal or a number, found the end"),
    "fear >= hgh": (9, "did you mean 'high'?"),
    "speed >= high": (1, "expected fear before a level"),
    "mode is STOPP": (9, "did you mean 'STOP'?"),
    "mode STOP": (6, "expected 'is' after 'mode'"),
    "mode is": (8, "expected a word for 'mode'"),
    "speed <= 5 m/s within glare": (23, "expected a time in s, found 'glare'"),
    "speed <= 5 m/s within 2 m of glare": (23, "expected a time in s, got 'm'"),
    "speed <= 5 m/s within 2 s to glare": (27, "expected 'of', 'after' or 'before'"),
    "speed <= 5 m/s within 2 s of": (29, "expected"),
    "speed <= 5 and": (15, "expected a signal or a number"),
    "": (1, "expected a signal or a number"),
    "3 < 5": (1, "only numbers"),
    "speed < 5 ! 3": (11, "'!' means nothing here"),
    "(speed < 5": (11, "expected ')'"),
    "|speed < 5": (8, "expected '|'"),
    "speed < 5 before 3 s before 4 s": (22, "limits again"),
    "always never speed < 5": (8, "found 'never'"),
    "speed < 5 between t = 1 s or 2 s": (27, "expected 'and'"),
    "speed < 5 at the start": (18, "expected 'end'"),
    "speed + fear is known": (9, "cannot add"),
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_sentence_is_reported_with_its_place_and_the_expected_words(text):
    column, message = WRONG[text]
    with pytest.raises(ValueError) as caught:
        parse_condition(text)
    assert f"{text!r}, column {column}: " in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


WORDS = [
    *(
        "always",
        "never",
        "within",
        "of",
        "while",
        "speed",
        "fear",
        "high",
        "mode",
        "is",
        "STOP",
        "t",
        "=",
        ">=",
    ),
    *(
        "5",
        "0.5 s",
        "m/s",
        "(",
        ")",
        "|",
        "and",
        "not",
        "glare",
        "begins",
        "any",
        "the end",
        "'",
        "°",
        "after",
        "-",
    ),
]


@settings(max_examples=200, deadline=None)
@given(st.one_of(st.text(max_size=30), st.lists(st.sampled_from(WORDS), max_size=9).map(" ".join)))
def test_no_text_at_all_raises_anything_but_a_value_error(text):
    try:
        condition = parse_condition(text)
    except ValueError as error:
        assert "column" in str(error)
    else:
        assert condition.explain(RAMP)


def test_events_that_a_scenario_does_not_have_are_found_before_it_runs():
    condition = parse_condition("speed <= 5 within 2 s of glar")
    with pytest.raises(
        ValueError, match="column 26: nothing called 'glar' happens here; did you mean 'glare'"
    ):
        condition.check({"event": {"glare", "worn"}})
    parse_condition("speed <= 5 within 2 s of glare").check({"event": {"glare", "worn"}})


def test_every_unit_of_the_trace_can_be_written():
    assert set(SUFFIXES.values()) - {unit for unit, _ in UNITS.values()} <= {"1/m²"}


def test_disturbances_are_where_the_vehicle_is_and_come_again_with_each_lap():
    trace = run(station_m=10.0 * np.arange(11))
    fog = Disturbance(kind="fog", grade=4, from_m=20, to_m=40)
    scenario = Scenario(description="", tags=["weather"], road="town", duration_s=1.0, disturbances=[fog])
    once = with_events(trace, scenario, SimpleNamespace(closed=False))["disturbance.fog"]
    assert np.flatnonzero(once).tolist() == [3] and once[3] == 4.0
    laps = with_events(trace, scenario, SimpleNamespace(closed=True, length_m=50.0))["disturbance.fog"]
    assert np.flatnonzero(laps).tolist() == [3, 8]
