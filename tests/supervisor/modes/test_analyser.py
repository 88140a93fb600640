"""The analyser names the cause before its consequences, and the part with the cause."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supervisor.modes.analyser import NOTHING, SUSPECTS, Finding, analyse, traced_cause
from supervisor.situation.features import BEYOND, Features
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).analyser
FINE: Features = {
    "frame_age": 0.03,
    "estimator_age": 0.03,
    "state_age": 0.01,
    "state_doubt": 0.0,
    "speed": 8.0,
    "seen_confidence": 0.9,
    "second_confidence": 0.9,
    "unmarked": 0.0,
    "brightness": 0.5,
    "contrast": 0.2,
    "over_exposed": 0.0,
    "under_exposed": 0.0,
    "sharpness": 300.0,
    "frozen": 0.0,
    "spots": 0.0,
    "lead_distance": BEYOND,
    "time_gap": BEYOND,
    "disagreement": 0.1,
    "separation": 0.05,
}
AGES_S = {"cv": 0.03, "cnn": 0.03}
BLIND = {"seen_confidence": 0.0}


def finding(**changes: float | None) -> Finding:
    return analyse(FINE | changes, SETTINGS, ages_s=AGES_S)


def test_when_all_is_well_nothing_is_found() -> None:
    assert finding() == NOTHING


@pytest.mark.parametrize(
    ("cause", "part", "changes"),
    [
        ("stale_data", "camera", {"frame_age": 0.12, "estimator_age": 0.12}),
        ("vehicle_state_lost", "vehicle", {"speed": None}),
        ("image_statistics_lost", "perception", {"brightness": None}),
        ("dark", "camera", BLIND | {"brightness": 0.0, "contrast": 0.0, "sharpness": 0.0, "frozen": 0.2}),
        ("over_exposed", "camera", BLIND | {"over_exposed": 0.8, "contrast": 0.01}),
        ("frozen_camera", "camera", {"frozen": 0.08}),
        ("blurred", "camera", BLIND | {"sharpness": 3.0}),
        ("dirty_lens", "lens", {"spots": 0.3, "seen_confidence": 0.4}),
        ("occluded", "traffic", {"seen_confidence": 0.3, "lead_distance": 6.0}),
        ("disagreement", "perception", {"separation": 0.7}),
        ("no_road", "road", BLIND),
        ("no_road", "road", {"unmarked": 1.0, "seen_confidence": 0.5, "second_confidence": 0.0}),
        ("unmarked", "road", {"unmarked": 1.0, "seen_confidence": 0.9, "second_confidence": 0.0}),
        ("unmarked", "road", {"unmarked": 1.0, "seen_confidence": 0.6}),
        ("low_confidence", "road", {"seen_confidence": 0.6}),
    ],
)
def test_causes_come_before_their_consequences(cause: str, part: str, changes: Features) -> None:
    assert finding(**changes) == (cause, part)


def test_the_estimator_that_is_behind_is_named() -> None:
    late = analyse(FINE | {"estimator_age": 0.12}, SETTINGS, ages_s={"cv": 0.03, "cnn": 0.12})
    assert late == ("lost_estimator", "cnn")


@pytest.mark.parametrize(
    ("doubted", "part"),
    [
        (("yaw_rate_radps",), "yaw rate"),
        (("road_wheel_angle_rad", "speed_mps"), "wheel angle, speed"),
        ((), "vehicle"),
    ],
)
def test_the_measurements_in_doubt_are_named(doubted: tuple[str, ...], part: str) -> None:
    found = analyse(FINE | {"state_doubt": 0.5}, SETTINGS, ages_s=AGES_S, doubted=doubted)
    assert found == ("doubted_state", part)


def test_a_standing_image_of_a_standing_car_is_not_frozen() -> None:
    assert finding(frozen=5.0, speed=0.0) == NOTHING


def test_only_symptoms_are_explained_by_something_else() -> None:
    dark = Finding("dark", "camera")
    assert traced_cause("low_confidence", dark) == "dark"
    assert traced_cause("lead_close", dark) == "lead_close"
    assert traced_cause("low_confidence", NOTHING) == "low_confidence"


@given(st.fixed_dictionaries({n: st.none() | st.floats(allow_nan=True) for n in FINE}))
def test_every_combination_of_numbers_has_a_finding(x: Features) -> None:
    assert analyse(x, SETTINGS, ages_s=AGES_S).cause in {"", *(s.cause for s in SUSPECTS)}
