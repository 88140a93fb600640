"""Features: closed forms, and an absent value is either calm, with a rule elsewhere, or worse than the worst."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from supervisor_rig import ESTIMATE, STATE, STATISTICS

from supervisor.inputs.consistency import Steadiness
from supervisor.inputs.validation import validate
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from supervisor.situation.features import BEYOND, first_root, rating_features
from supervisor.situation.world_state import WorldState, WorldStateObserver
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import ImageStatistics, LeadVehicle, SteeringEstimate, VehicleState

RULES = FearRules.load(CONFIG_DIR / "fear.yaml")
SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
CV = replace(ESTIMATE, marked=True)
CNN = replace(ESTIMATE, estimator="cnn", lanes_detected=0, lane_width_m=None, marked=None)
AGE_S = 0.03


def observe(
    cv: SteeringEstimate = CV,
    cnn: SteeringEstimate = CNN,
    state: VehicleState = STATE,
    statistics: ImageStatistics = STATISTICS,
    lead: LeadVehicle | None = None,
) -> WorldState:
    s = SETTINGS
    observer = WorldStateObserver(s.validation, s.fusion, s.follow, s.giving_way, s.sight, VEHICLE)
    return observer.step(RULES, {"cv": cv, "cnn": cnn}, statistics, lead, state, now_s=AGE_S)


def rate(*rated: tuple[float | None, float]) -> dict[str, float | None]:
    """The features by one name of estimators of these confidences and jitters; None: a broken one."""
    seen = {f"e{i}": replace(CV, confidence=math.nan if c is None else c) for i, (c, _) in enumerate(rated)}
    checked = [
        validate(name, one, now_s=AGE_S, settings=SETTINGS.validation, wheelbase_m=1.75)
        for name, one in seen.items()
    ]
    steady = {f"e{i}": Steadiness(jitter_m, 2 * jitter_m) for i, (_, jitter_m) in enumerate(rated)}
    return rating_features("cv", checked, steady)


CONFIDENCES, JITTERS = st.floats(0.0, 1.0), st.floats(0.0, 1.0)


@given(c=CONFIDENCES, jitter_m=JITTERS, blind_m=JITTERS)
def test_an_estimator_that_sees_nothing_changes_nothing_of_the_one_it_is_rated_with(c, jitter_m, blind_m):
    alone = rate((max(c, 0.1), jitter_m))
    assert (
        rate((max(c, 0.1), jitter_m), (0.0, blind_m))
        == rate((0.0, blind_m), (max(c, 0.1), jitter_m))
        == alone
    )


@given(rated=st.lists(st.tuples(CONFIDENCES, JITTERS), min_size=1, max_size=4), order=st.randoms())
def test_estimators_rated_by_one_name_count_by_their_confidence_in_any_order(rated, order):
    found = rate(*rated)
    assert found["cv_confidence"] == max(c for c, _ in rated)
    own = [jitter_m for c, jitter_m in rated if c == found["cv_confidence"]]
    assert max(own) <= (found["cv_jitter"] or 0.0) <= max(jitter_m for _, jitter_m in rated) + 1e-12
    assert found["cv_path_jitter"] == pytest.approx(2 * (found["cv_jitter"] or 0.0))
    order.shuffle(rated)
    if len({c for c, _ in rated}) == len(rated):
        assert rate(*rated) == found


@given(c=CONFIDENCES, first_m=JITTERS, second_m=JITTERS, more_m=JITTERS)
def test_a_greater_jitter_of_any_of_them_is_never_a_lesser_one_of_their_name(c, first_m, second_m, more_m):
    before = rate((0.9, first_m), (0.9 * c, second_m))["cv_jitter"] or 0.0
    for rated in (
        ((0.9, first_m + more_m), (0.9 * c, second_m)),
        ((0.9, first_m), (0.9 * c, second_m + more_m)),
    ):
        assert (rate(*rated)["cv_jitter"] or 0.0) >= before - 1e-12


def test_half_as_sure_an_estimator_counts_with_half_the_jitter_that_it_has_more():
    assert rate((0.8, 0.1), (0.4, 0.5))["cv_jitter"] == pytest.approx(0.1 + 0.5 * 0.4)
    assert rate((0.8, 0.1), (0.8, 0.5))["cv_jitter"] == pytest.approx(0.5)


def test_a_broken_one_of_them_is_a_missing_input_of_their_name():
    assert set(rate((0.9, 0.1), (None, 0.1)).values()) == {None}


def arcs_beside_cv(arcs: SteeringEstimate) -> WorldState:
    """A world of cv, cnn, and arcs, which the rules rate as cv."""
    s = SETTINGS
    observer = WorldStateObserver(s.validation, s.fusion, s.follow, s.giving_way, s.sight, VEHICLE)
    seen = {"cv": CV, "cnn": CNN, "arcs": replace(arcs, estimator="arcs")}
    return observer.step(RULES, seen, STATISTICS, None, STATE, now_s=AGE_S)


def test_the_fear_of_cv_and_cnn_is_the_same_beside_a_blind_estimator_rated_as_cv():
    blind = replace(CV, confidence=0.0, lanes_detected=0, **dict.fromkeys(lane(0, 0), None))  # type: ignore[arg-type]
    without, beside = observe(), arcs_beside_cv(blind)
    assert beside.features["cv_confidence"] == without.features["cv_confidence"] == 0.9
    assert RULES.evaluate(beside.features) == RULES.evaluate(without.features)


def test_an_estimator_rated_as_cv_that_sees_another_lane_raises_fear():
    apart = arcs_beside_cv(replace(CV, **lane(0.8, 0.0)))
    assert apart.features["cv_confidence"] == 0.9
    assert (apart.features["disagreement"] or 0.0) > 0.5
    assert RULES.evaluate(apart.features).fear > RULES.evaluate(observe().features).fear


def test_the_trust_in_each_of_two_estimators_rated_as_cv_is_that_of_its_own_jitter():
    s = SETTINGS
    observer = WorldStateObserver(s.validation, s.fusion, s.follow, s.giving_way, s.sight, VEHICLE)
    for frame in range(30):
        t_s = 0.04 * frame
        shaking = lane(0.6 * (-1) ** frame, 0.0)
        seen = {
            "cv": replace(CV, t_s=t_s),
            "arcs": replace(CV, estimator="arcs", t_s=t_s, confidence=0.3, **shaking),
        }
        state = replace(STATE, t_s=t_s)
        world = observer.step(RULES, seen, replace(STATISTICS, t_s=t_s), None, state, now_s=t_s + 0.01)
    assert world.trust["cv"] == 1.0 and world.trust["arcs"] < 0.5


def lane(offset_m: float, heading_rad: float, curvature_1pm: float = 0.0) -> dict[str, float]:
    return {
        "lateral_offset_m": offset_m,
        "heading_error_rad": heading_rad,
        "curvature_1pm": curvature_1pm,
        "curvature_rate_1pm2": 0.0,
    }


@pytest.mark.parametrize("side", [1, -1])
def test_the_time_to_crossing_of_a_car_that_drifts_is_room_over_drift(side: int) -> None:
    drifting = lane(side * 0.1, side * 0.05)
    found = observe(replace(CV, **drifting), replace(CNN, **drifting)).features["crossing"]
    assert found == pytest.approx((3.4 / 2 - VEHICLE.track_m / 2 - 0.1) / (8.0 * 0.05), rel=0.02)


def test_a_car_that_turns_with_its_lane_never_crosses_and_a_car_that_drives_straight_on_soon_does() -> None:
    bend = lane(0.0, 0.0, 0.02)
    seen = {"cv": replace(CV, **bend), "cnn": replace(CNN, **bend)}
    assert observe(**seen, state=replace(STATE, yaw_rate_radps=8.0 * 0.02)).features["crossing"] == BEYOND
    room_m = 3.4 / 2 - VEHICLE.track_m / 2
    straight_on = observe(**seen).features["crossing"]
    assert straight_on == pytest.approx(math.sqrt(2 * room_m / (0.02 * 8.0**2)), rel=0.01)


@pytest.mark.parametrize(
    ("room", "drift", "bend"), [(1.0, 0.5, 0.0), (1.0, 0.5, 1e-7), (0.6, -0.2, 0.8), (2.0, 1.0, -0.2)]
)
def test_the_root_solves_its_equation_and_nothing_before_does(room: float, drift: float, bend: float) -> None:
    t = first_root(room, drift, bend)
    assert drift * t + bend * t**2 / 2 == pytest.approx(room)
    assert all(drift * s + bend * s**2 / 2 < room for s in (0.0, 0.3 * t, 0.7 * t, 0.99 * t))


def test_a_car_that_turns_back_in_time_does_not_cross() -> None:
    assert first_root(1.0, 0.5, -0.5) == BEYOND
    assert first_root(-0.1, 0.0, 0.0) == 0.0


def test_a_remembered_lane_keeps_its_confidence_and_has_sight_0() -> None:
    blind = replace(CNN, confidence=0.0, **dict.fromkeys(lane(0, 0), None))  # type: ignore[arg-type]
    measured = observe(replace(CV, lanes_detected=0), blind).features
    assert (measured["lane_confidence"], measured["seen_confidence"]) == (0.9, 0.0)
    assert observe(CV, blind).features["seen_confidence"] == 0.9


@pytest.mark.parametrize(("marked", "unmarked"), [(True, 0.0), (False, 1.0), (None, 0.0)])
def test_a_road_detected_by_its_edges_is_unmarked(marked: bool | None, unmarked: float) -> None:
    assert observe(replace(CV, marked=marked)).features["unmarked"] == unmarked


def test_the_second_confidence_is_the_lesser_one() -> None:
    assert observe(cnn=replace(CNN, confidence=0.6)).features["second_confidence"] == pytest.approx(0.6)


def test_a_network_has_little_trust_on_a_white_image_at_any_confidence() -> None:
    white = replace(STATISTICS, over_exposed=0.9, brightness=0.98, contrast=0.02)
    world = observe(replace(CV, confidence=0.3), replace(CNN, confidence=0.99), statistics=white)
    assert world.trust["cnn"] < 0.1 and world.trust["cv"] == 1.0
    assert world.features["lane_confidence"] == pytest.approx(0.3)
    assert world.fused.trust[0] > 0.8


@pytest.mark.parametrize("exposure", [0.25, 1.0, 1.6])
def test_the_relative_contrast_does_not_depend_on_the_exposure(exposure: float) -> None:
    dim = replace(STATISTICS, brightness=0.5 * exposure, contrast=0.12 * exposure)
    assert observe(statistics=dim).features["relative_contrast"] == pytest.approx(0.24)
    assert observe(statistics=replace(STATISTICS, brightness=0.0)).features["relative_contrast"] == 0.0
    lost = replace(STATISTICS, brightness=math.nan)
    assert math.isnan(observe(statistics=lost).features["relative_contrast"] or 0.0)


def test_a_flat_image_raises_fear_with_its_flatness_only_where_the_network_wanders() -> None:
    calm = calmest(RULES)
    flat = [
        RULES.evaluate(calm | {"relative_contrast": c, "cnn_path_jitter": 0.15})
        for c in (0.3, 0.24, 0.2, 0.1)
    ]
    assert [r.fear for r in flat] == sorted({r.fear for r in flat}) and flat[0].fear == 0.0
    assert {r.cause for r in flat[1:]} == {"weak_edges"}
    assert RULES.evaluate(calm | {"relative_contrast": 0.1, "cnn_path_jitter": 0.05}).fear == 0.0


def test_between_edges_a_network_that_wanders_leaves_the_car_walking_pace() -> None:
    """Between lines and with sure masks the speed raises fear less; so does a network that hardly wanders."""
    road = calmest(RULES) | {"unmarked": 1.0, "segments_support": 0.0, "cnn_path_jitter": 0.22}

    def fear(speed_mps: float, **changes: float) -> float:
        return RULES.evaluate(road | changes | {"speed": speed_mps}).fear

    rising = [fear(speed_mps) for speed_mps in (1.0, 2.0, 3.0, 4.5)]
    assert rising == sorted(set(rising)) and rising[0] == pytest.approx(0.75) and rising[-1] > 0.9
    assert RULES.speed_factor(rising[1]) * 8.0 < 3.0
    lined, masked, calm = {"unmarked": 0.0}, {"segments_support": 1.0}, {"cnn_path_jitter": 0.1}
    assert max(fear(4.5, **change) for change in (lined, masked, calm)) <= 0.75


def leader(**changes: float) -> LeadVehicle:
    seen = LeadVehicle(t_s=AGE_S, distance_m=20.0, lateral_m=0.0, speed_mps=0.0, confidence=1.0)
    return replace(seen, **changes)


@pytest.mark.parametrize("lead_mps", [0.0, 3.0, 7.9])
def test_braking_with_the_deceleration_of_the_leader_ends_at_its_bumper(lead_mps: float) -> None:
    decel_mps2 = observe(lead=leader(speed_mps=lead_mps)).features["lead_deceleration"]
    assert decel_mps2 is not None
    speed_mps, gap_m, dt_s = STATE.speed_mps, 20.0, 1e-3
    while speed_mps > lead_mps:
        speed_mps -= decel_mps2 * dt_s
        gap_m -= (speed_mps - lead_mps) * dt_s
    assert gap_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("lead", [None, leader(speed_mps=8.0), leader(speed_mps=20.0)])
def test_a_gap_that_does_not_close_needs_no_deceleration(lead: LeadVehicle | None) -> None:
    assert observe(lead=lead).features["lead_deceleration"] == 0.0


def test_an_unsure_vehicle_ahead_counts_by_its_confidence_and_a_broken_one_is_lost() -> None:
    sure, half = (observe(lead=leader(confidence=c)).features["lead_deceleration"] for c in (1.0, 0.5))
    assert half == pytest.approx(sure / 2)
    assert observe(lead=leader(confidence=math.nan)).features["lead_deceleration"] is None


def test_a_vehicle_that_is_touched_is_beyond_every_deceleration() -> None:
    assert observe(lead=leader(distance_m=0.0)).features["lead_deceleration"] == BEYOND
