"""Features: closed forms, and an absent value is either calm, with a rule elsewhere, or worse than the worst."""

import math
from dataclasses import replace

import pytest
from supervisor_rig import ESTIMATE, STATE, STATISTICS

from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from supervisor.situation.features import BEYOND, first_root
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
