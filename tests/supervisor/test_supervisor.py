"""The supervisor's step: causes of stops and of slow-downs; a broken input never lowers fear."""

import math
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from supervisor_rig import ESTIMATE, FRAME_S, LATENCY_S, SETTINGS, STATE, STATISTICS, Drive

from supervisor.rules.inference import FearRules
from supervisor.rules.sentence import parse_rule
from supervisor.supervisor import Supervisor, SupervisorSettings, build
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import (
    Decision,
    LeadVehicle,
    Mode,
    SteeringEstimate,
    Stop,
)
from trepid.processes.lateness import RECOVERED

NO_LANE = replace(
    ESTIMATE,
    lateral_offset_m=None,
    heading_error_rad=None,
    curvature_1pm=None,
    curvature_rate_1pm2=None,
    road_wheel_angle_rad=None,
    confidence=0.0,
    lanes_detected=0,
    lane_width_m=None,
    reason="no line",
)
LEAD = LeadVehicle(t_s=0.0, distance_m=20.0, lateral_m=0.2, speed_mps=5.0, confidence=0.9)
NOBODY = LeadVehicle(t_s=0.0, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)


def test_on_a_clean_road_fear_is_0_and_the_car_drives_at_full_speed() -> None:
    decision = Drive.under_way().frame()
    assert (decision.mode, decision.stop, decision.level, decision.cause) == (
        Mode.KEEP,
        Stop.NONE,
        "very_low",
        "none",
    )
    assert (decision.speed_factor, decision.speed_cap_mps) == (1, SETTINGS.cruise_speed_mps)
    assert decision.path_source == "cv+cnn"
    assert decision.lateral_offset_m == pytest.approx(ESTIMATE.lateral_offset_m, abs=0.01)
    assert sum(decision.trust) == pytest.approx(1)


def test_the_first_mode_is_stop_and_two_healthy_seconds_at_standstill_lead_to_drive() -> None:
    drive = Drive()
    assert drive.last(1.9).mode is Mode.STOP
    started = drive.last(0.2)
    assert started.mode is not Mode.STOP
    assert started.speed_factor < 0.1
    assert drive.last(5.0).speed_factor == 1


def test_a_supervisor_restarted_in_motion_stops_the_car_until_standstill() -> None:
    drive = Drive(speed_mps=8.0)
    assert {drive.frame().mode for _ in range(200)} == {Mode.STOP}
    assert drive.frame().speed_cap_mps == 0
    drive.speed_mps = 0.0
    assert drive.last(2.2).mode is not Mode.STOP


def test_without_any_message_the_mode_is_stop_and_fear_is_1() -> None:
    supervisor = build()
    for now_s in (0.0, 5.0, 60.0):
        decision = supervisor.step({"cv": None, "cnn": None}, None, None, None, now_s=now_s)
        assert (decision.mode, decision.stop, decision.fear) == (Mode.STOP, Stop.COMFORT, 1)
        assert (decision.t_s, decision.lateral_offset_m, decision.path_source) == (None, None, "none")


@pytest.mark.parametrize("lost", ["cv", "cnn"])
def test_a_lost_estimator_stops_the_car_on_the_path_of_the_other_for_good(lost: str) -> None:
    drive = Drive.under_way()
    stopping = drive.last(0.6, **{lost: None})
    assert (stopping.mode, stopping.stop, stopping.cause) == (Mode.STOP, Stop.COMFORT, "lost_estimator")
    assert stopping.fear == 1
    assert stopping.lateral_offset_m is not None
    assert stopping.sources == (({"cv", "cnn"} - {lost}).pop(),)
    drive.speed_mps = 0.0
    assert drive.last(10.0).mode is Mode.STOP  # it is back, but a lost process ends the run


@pytest.mark.parametrize(("blind", "confidence"), [("cv", 0.9), ("cnn", 0.7)])
def test_an_estimator_without_a_lane_slows_the_car_without_stopping_it(blind: str, confidence: float) -> None:
    other = {"cv", "cnn"} - {blind}
    seen = {blind: NO_LANE, other.pop(): replace(ESTIMATE, confidence=confidence)}
    decision = Drive.under_way().last(5.0, **seen)
    assert (decision.mode, decision.cause) == (Mode.CAUTION, "low_confidence")
    assert 0.5 < decision.speed_factor < 1
    assert blind not in decision.sources


SILENT = dict.fromkeys(("cv", "cnn", "statistics"))


def test_frames_that_stop_coming_first_brake_then_stop_then_brake_hard() -> None:
    drive = Drive.under_way()
    results = [drive.frame(**SILENT) for _ in range(20)]

    def first_s(stop: Stop, *modes: Mode) -> float:
        """Age of the newest frame at the first decision with ``stop`` in one of ``modes``."""
        return LATENCY_S + FRAME_S * next(
            n for n, d in enumerate(results, 1) if d.stop is stop and d.mode in modes
        )

    late_s = LATENCY_S + SETTINGS.validation.late.periods * FRAME_S
    assert first_s(Stop.COMFORT, Mode.KEEP, Mode.CAUTION) == pytest.approx(late_s, abs=FRAME_S)
    assert first_s(Stop.COMFORT, Mode.STOP) == pytest.approx(SETTINGS.modes.comfort_stop_age_s, abs=FRAME_S)
    assert first_s(Stop.EMERGENCY, Mode.STOP) == pytest.approx(
        SETTINGS.modes.emergency_stop_age_s, abs=FRAME_S
    )
    fears = [d.fear for d in results]
    assert fears == sorted(fears)
    assert results[-1].cause == "stale_data"
    drive.speed_mps = 0.0
    assert drive.last(10.0).stop is Stop.EMERGENCY  # final


@pytest.mark.parametrize(
    ("late", "cause"),
    [
        (("cv", "cnn", "statistics"), "stale_data"),
        (("cv", "statistics"), "lost_estimator"),
        (("cnn",), "lost_estimator"),
        (("statistics",), "image_statistics_lost"),
        (("lead",), "lead_lost"),
    ],
)
def test_a_late_message_brakes_until_some_come_in_time_without_a_change_of_the_mode(
    late: tuple[str, ...], cause: str
) -> None:
    drive = Drive.under_way()
    drive.last(1.0, lead=NOBODY)
    *_, before, braking = (drive.frame(**({"lead": NOBODY} | dict.fromkeys(late))) for _ in range(3))
    assert (before.mode, before.stop) == (Mode.KEEP, Stop.NONE)  # one frame may be missing
    assert (braking.mode, braking.stop, braking.cause) == (Mode.KEEP, Stop.COMFORT, cause)
    assert braking.speed_cap_mps == 0
    back = [drive.frame(lead=NOBODY) for _ in range(RECOVERED + 1)]
    assert [decision.mode for decision in back] == [Mode.KEEP] * (RECOVERED + 1)
    assert [decision.stop for decision in back] == [Stop.COMFORT] * RECOVERED + [Stop.NONE]


def test_a_repeated_image_brakes_until_a_new_one_comes() -> None:
    drive = Drive.under_way()
    frozen = replace(STATISTICS, frozen_s=2 * FRAME_S)
    braking = drive.frame(statistics=frozen)
    assert (braking.mode, braking.stop, braking.cause) == (Mode.KEEP, Stop.COMFORT, "frozen_camera")
    assert drive.frame().stop is Stop.NONE
    once = replace(STATISTICS, frozen_s=FRAME_S)
    assert drive.frame(statistics=once).stop is Stop.NONE  # a camera may double a frame


def test_late_messages_do_not_brake_a_standing_car() -> None:
    drive = Drive()
    assert drive.last(SETTINGS.modes.reengage_after_s + 0.2).mode is not Mode.STOP  # type: ignore[operator]
    assert drive.last(0.2, **SILENT).stop is Stop.NONE


def test_a_short_gap_in_the_frames_stops_the_car_but_does_not_end_the_run() -> None:
    drive = Drive.under_way()
    assert drive.last(0.32, cv=None, cnn=None, statistics=None).stop is Stop.COMFORT
    assert drive.last(5.0).mode is Mode.STOP  # latched while it moves
    drive.speed_mps = 0.0
    assert drive.last(2.2).mode is not Mode.STOP


def test_a_lost_vehicle_state_stops_the_car() -> None:
    stopping = Drive.under_way().last(0.3, state=None)
    assert (stopping.mode, stopping.cause, stopping.fear) == (Mode.STOP, "vehicle_state_lost", 1)
    assert stopping.lateral_offset_m is not None


def test_lost_image_statistics_stop_the_car() -> None:
    stopping = Drive.under_way().last(0.6, statistics=None)
    assert (stopping.mode, stopping.cause) == (Mode.STOP, "image_statistics_lost")


def test_the_driver_takes_over_and_the_car_does_not_start_again_on_the_move() -> None:
    drive = Drive.under_way()
    assert drive.frame(state=replace(STATE, driver_override=True)).cause == "driver_override"
    assert drive.last(5.0).mode is Mode.STOP


DRIVEN = replace(STATE, driver_override=True)


def test_after_a_hand_over_at_speed_the_car_keeps_its_speed() -> None:
    drive = Drive(speed_mps=7.0)
    assert drive.last(3.0, state=DRIVEN).mode is Mode.STOP
    taken = drive.frame()
    assert (taken.mode, taken.stop) == (Mode.CAUTION, Stop.NONE)
    assert taken.speed_cap_mps == pytest.approx(7.0, rel=0.1)


@pytest.mark.parametrize(
    "before",
    [
        {"duration_s": 1.0},  # too short for the start condition
        {"duration_s": 3.0, "cv": None},  # an estimator has never answered
        {"duration_s": 3.0, "statistics": None},
    ],
)
def test_a_car_that_is_not_ready_stays_stopped_after_the_driver_releases_it(before: dict[str, Any]) -> None:
    drive = Drive(speed_mps=7.0)
    drive.last(**before, state=DRIVEN)
    assert drive.last(1.0).mode is Mode.STOP


def test_a_lost_lane_is_no_emergency_while_a_driver_drives() -> None:
    drive = Drive(speed_mps=7.0)
    decision = drive.last(2.0, cv=NO_LANE, cnn=NO_LANE, state=DRIVEN)
    assert (decision.mode, decision.stop) == (Mode.STOP, Stop.COMFORT)


def test_an_emergency_of_doubt_counts_from_the_moment_in_which_the_driver_lets_go() -> None:
    """Two unsure lanes that agree make the cause ``no_road`` and leave a path."""
    limit_s = SETTINGS.modes.emergency_after_s["no_road"]
    faint = dict.fromkeys(("cv", "cnn"), replace(ESTIMATE, confidence=0.3))
    drive = Drive(speed_mps=7.0)
    assert drive.last(5 * limit_s, **faint, state=DRIVEN).stop is Stop.COMFORT
    assert drive.last(limit_s - 0.1, **faint).stop is Stop.COMFORT
    assert drive.last(0.2, **faint).stop is Stop.EMERGENCY


DAZZLED = replace(STATISTICS, over_exposed=0.95, contrast=0.01, brightness=0.98)
UNSURE = replace(ESTIMATE, confidence=0.3)


def test_estimates_of_low_confidence_give_no_path_before_the_first_drive() -> None:
    drive = Drive(speed_mps=8.0)
    for _ in range(20):
        decision = drive.frame(cv=UNSURE, cnn=UNSURE, statistics=DAZZLED)
        assert (decision.mode, decision.lateral_offset_m, decision.path_t_s) == (Mode.STOP, None, None)
    drive = Drive.under_way()
    assert drive.frame(cv=UNSURE, cnn=UNSURE, statistics=DAZZLED).lateral_offset_m is not None


def test_at_full_fear_without_a_confident_estimate_the_car_soon_brakes_hard() -> None:
    drive = Drive.under_way()
    before = drive.last(SETTINGS.modes.guess_s - 0.1, cv=UNSURE, cnn=UNSURE, statistics=DAZZLED)
    assert (before.mode, before.stop) == (Mode.STOP, Stop.COMFORT)
    after = drive.last(0.3, cv=UNSURE, cnn=UNSURE, statistics=DAZZLED)
    assert after.stop is Stop.EMERGENCY
    sure = Drive.under_way()  # lines may be detected in a picture that raises fear
    assert sure.last(2.0, statistics=DAZZLED).stop is Stop.COMFORT


def test_a_single_bad_frame_slows_but_does_not_stop_the_car() -> None:
    drive = Drive.under_way()
    bad = drive.frame(cv=replace(ESTIMATE, lateral_offset_m=math.nan))
    assert (bad.fear, bad.mode, bad.speed_cap_mps) == (1, Mode.CAUTION, 0)
    after = drive.frame()
    assert after.mode is Mode.CAUTION
    assert drive.last(6.0).mode is Mode.KEEP


def test_the_speed_factor_falls_at_once_and_rises_slowly() -> None:
    drive = Drive.under_way()
    fallen = drive.last(2.0, cv=NO_LANE).speed_factor
    assert fallen == pytest.approx(0.75)
    drive.speed_mps = fallen * SETTINGS.cruise_speed_mps
    assert 0 < drive.frame().speed_factor - fallen <= 0.25 * FRAME_S + 1e-9
    assert drive.last(0.5).speed_factor < 0.9


def test_after_one_bad_frame_the_present_speed_is_allowed_again_soon() -> None:
    drive = Drive.under_way()
    assert drive.frame(cv=NO_LANE, cnn=NO_LANE).speed_factor < 0.1
    drive.speed_mps = 7.2
    assert drive.last(0.5).speed_factor == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("frozen_s", [0.12, math.nan])
def test_a_lane_in_a_picture_that_may_be_frozen_is_not_driven(frozen_s: float) -> None:
    drive = Drive.under_way()
    decision = drive.last(0.2, statistics=replace(STATISTICS, frozen_s=frozen_s))
    assert decision.path_source == "memory" and decision.sources == ()


def test_a_car_that_moves_on_a_frozen_image_soon_brakes_hard() -> None:
    drive = Drive.under_way()
    frozen = replace(STATISTICS, frozen_s=1.0)
    assert drive.last(1.0, statistics=frozen).stop is Stop.COMFORT
    assert drive.last(0.6, statistics=frozen).stop is Stop.EMERGENCY


def test_a_frozen_picture_stops_a_moving_car_but_not_a_standing_one() -> None:
    drive = Drive.under_way()
    decision = drive.last(0.6, statistics=replace(STATISTICS, frozen_s=0.5))
    assert (decision.mode, decision.cause) == (Mode.STOP, "frozen_camera")
    standing = Drive()
    assert standing.last(3.0, statistics=replace(STATISTICS, frozen_s=3.0)).mode is not Mode.STOP


def test_two_contradicting_roads_raise_fear_and_the_path_follows_one_of_them() -> None:
    drive = Drive.under_way()
    left = replace(ESTIMATE, curvature_1pm=0.06, curvature_rate_1pm2=0.0)
    right = replace(ESTIMATE, curvature_1pm=-0.06, curvature_rate_1pm2=0.0)
    drive.last(0.4, cv=left, cnn=left)
    decision = drive.last(0.2, cv=right, cnn=left)
    assert decision.fear > 0.5
    assert decision.curvature_1pm == pytest.approx(0.06)
    assert decision.sources == ("cnn",)
    assert decision.disagreement_mps2 == pytest.approx(0.12 * 64)


def test_without_a_road_the_path_is_remembered_then_the_car_brakes_hard() -> None:
    drive = Drive.under_way()
    blind: dict[str, Any] = {"cv": NO_LANE, "cnn": NO_LANE}
    coasting = drive.last(0.8, **blind)
    assert (coasting.path_source, coasting.mode, coasting.stop) == ("memory", Mode.STOP, Stop.COMFORT)
    gone = drive.last(0.8, **blind)
    assert (gone.path_source, gone.curvature_1pm, gone.stop) == ("none", None, Stop.EMERGENCY)
    assert gone.cause == "no_road"


def test_without_a_road_the_path_follows_the_vehicle_ahead_until_a_road_is_detected_again() -> None:
    drive = Drive.under_way()
    drive.last(1.0, lead=LEAD)
    following = drive.last(1.5, cv=NO_LANE, cnn=NO_LANE, lead=LEAD)
    assert (following.mode, following.path_source, following.stop) == (Mode.FOLLOW, "lead", Stop.NONE)
    assert following.speed_factor * SETTINGS.cruise_speed_mps < 0.5 * SETTINGS.cruise_speed_mps
    assert following.speed_cap_mps == LEAD.speed_mps, (
        "fear does not let the last witness of the road get away"
    )
    hurried = drive.last(1.0, cv=NO_LANE, cnn=NO_LANE, lead=replace(LEAD, speed_mps=12.0))
    assert LEAD.speed_mps < hurried.speed_cap_mps < SETTINGS.cruise_speed_mps, "but it can stop on the trail"
    back = drive.last(1.0, lead=LEAD)
    assert (back.mode, back.path_source) == (Mode.CAUTION, "cv+cnn")


def test_a_lead_that_is_lost_while_following_stops_the_car() -> None:
    drive = Drive.under_way()
    blind: dict[str, Any] = {"cv": NO_LANE, "cnn": NO_LANE}
    assert drive.last(2.0, lead=LEAD, **blind).mode is Mode.FOLLOW
    assert drive.last(0.6, lead=None, **blind).mode is Mode.STOP


def test_a_comfort_stop_becomes_an_emergency_stop_for_a_vehicle_too_near_for_it() -> None:
    drive = Drive.under_way()
    blind: dict[str, Any] = {"cv": NO_LANE, "cnn": NO_LANE}
    assert drive.last(0.6, **blind).stop is Stop.COMFORT
    near = replace(LEAD, distance_m=15.0, speed_mps=3.0)
    assert drive.frame(lead=near, **blind).stop is Stop.COMFORT, "one frame may be a ghost"
    assert drive.last(0.16, lead=near, **blind).stop is Stop.EMERGENCY


def test_a_vehicle_too_near_for_a_comfort_stop_causes_no_stop_while_a_driver_drives() -> None:
    near = replace(LEAD, distance_m=6.0, speed_mps=3.0)
    driven = Drive.under_way().last(0.2, lead=near, state=replace(STATE, driver_override=True))
    assert driven.stop is Stop.COMFORT


def test_behind_a_lead_the_time_gap_is_kept_on_a_clean_road() -> None:
    drive = Drive.under_way()
    near = drive.frame(lead=replace(LEAD, distance_m=11.0, speed_mps=8.0))
    expected_mps = (11.0 - SETTINGS.follow.standstill_gap_m) / SETTINGS.follow.time_gap_s
    assert near.mode is Mode.KEEP
    assert near.speed_cap_mps == pytest.approx(expected_mps)


MESSAGES = {"cv": ESTIMATE, "statistics": STATISTICS, "lead": LEAD, "state": STATE}
FIELDS = [
    (sender, f.name)
    for sender, message in MESSAGES.items()
    for f in fields(message)
    if f.type in (float, float | None)
]
OPTIONAL = {f.name for message in MESSAGES.values() for f in fields(message) if f.type == float | None}


@settings(max_examples=150, deadline=None)
@example(("cv", "lane_width_m"), math.nan, 1.0, 0.5, 0.0, 2.0, 3.0)  # the narrower lane was the broken one
@given(
    st.sampled_from(FIELDS),
    st.sampled_from([math.nan, math.inf, -math.inf, None, 1e300]),
    st.floats(0, 1),
    st.floats(-0.8, 0.8),
    st.floats(-0.06, 0.06),
    st.sampled_from([2.0, 3.4, 6.0]),
    st.floats(1, 40),
)
def test_a_broken_number_in_any_field_never_lowers_fear_and_never_raises(
    place: tuple[str, str],
    broken: float | None,
    confidence: float,
    offset_m: float,
    curvature_1pm: float,
    width_m: float,
    distance_m: float,
) -> None:
    sender, name = place
    if broken is None and name not in OPTIONAL:
        broken = math.nan
    cv = replace(
        ESTIMATE,
        confidence=confidence,
        lateral_offset_m=offset_m,
        curvature_1pm=curvature_1pm,
        lane_width_m=width_m,
    )
    clean: dict[str, Any] = {**MESSAGES, "cv": cv, "lead": replace(LEAD, distance_m=distance_m)}

    def fear(messages: dict[str, Any]) -> float:
        estimates = {"cv": messages["cv"], "cnn": ESTIMATE}
        decision = build_once().step(
            estimates, messages["statistics"], messages["lead"], messages["state"], now_s=0.03
        )
        assert decision.lateral_offset_m is None or math.isfinite(decision.lateral_offset_m)
        assert math.isfinite(decision.speed_cap_mps)
        return decision.fear

    spoilt = {**clean, sender: replace(clean[sender], **{name: broken})}
    assert fear(spoilt) >= fear(clean) - 1e-12


RULES = FearRules.load(CONFIG_DIR / "fear.yaml")
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def build_once() -> Supervisor:
    """A fresh supervisor from rules that were read once."""
    return Supervisor(RULES, SETTINGS, VEHICLE)


def test_the_mirror_image_of_a_drive_gives_the_mirror_image_of_every_path() -> None:
    def decisions(side: float) -> list[Decision]:
        supervisor, results = build_once(), []
        for n in range(-60, 105):  # then the trail of so odd a leader is no road any more
            t_s, turn = (
                FRAME_S * (n + 60),
                side if n >= 0 else 0.0,
            )  # a driver hands over after 60 calm frames
            cv = replace(
                ESTIMATE,
                t_s=t_s,
                lateral_offset_m=turn * 0.3 * math.sin(n / 9),
                heading_error_rad=turn * 0.02 * math.cos(n / 9),
                curvature_1pm=turn * 0.01 * math.sin(n / 20),
                curvature_rate_1pm2=turn * 0.0002,
                confidence=0.9 if n < 60 else 0.0,
            )
            if n >= 60:
                cv = replace(NO_LANE, t_s=t_s)
            cnn = replace(cv, confidence=0.7 * cv.confidence)
            rate = turn * 0.1 * math.sin(n / 20)
            state = replace(STATE, t_s=t_s, yaw_rate_radps=rate, driver_override=n < 0)
            lead = replace(LEAD, t_s=t_s, lateral_m=side * 0.5 * math.sin(n / 30)) if n >= 0 else None
            results.append(
                supervisor.step({"cv": cv, "cnn": cnn}, replace(STATISTICS, t_s=t_s), lead, state, now_s=t_s)
            )
        return results

    sources = set()
    for left, right in zip(decisions(1.0), decisions(-1.0), strict=True):
        assert (left.fear, left.mode, left.path_source) == (right.fear, right.mode, right.path_source)
        for name in ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2"):
            one, other = getattr(left, name), getattr(right, name)
            assert (one is None) == (other is None)
            assert one is None or one == pytest.approx(-other, abs=1e-9)
        sources.add(left.path_source)
    assert sources == {"cv+cnn", "memory", "lead"}


def test_a_single_estimate_gives_no_path_before_the_first_drive() -> None:
    drive = Drive(speed_mps=8.0)
    assert drive.last(0.5).path_source == "cv+cnn"
    assert drive.last(2.0, cv=NO_LANE).path_source == "none"
    assert drive.last(2.0, cnn=NO_LANE).path_source == "none"
    assert drive.last(0.5).path_source == "cv+cnn"


def test_a_wandering_network_on_a_doubtful_road_stops_the_car_and_keeps_it_stopped() -> None:
    drive = Drive.under_way()
    edges = replace(ESTIMATE, confidence=0.7, marked=False)
    for n in range(40):
        wandering = replace(ESTIMATE, lateral_offset_m=0.2 if n % 2 else -0.1, confidence=0.98)
        decision = drive.frame(cv=edges, cnn=wandering)
    assert (decision.mode, decision.cause) == (Mode.STOP, "odd_road")
    drive.speed_mps = 0.0
    assert drive.last(20.0, cv=edges).mode is Mode.STOP


WEAK_EDGES = replace(ESTIMATE, confidence=0.6, marked=False)


def test_lasting_doubt_about_edges_slows_the_car_although_the_network_agrees() -> None:
    decision = Drive.under_way().last(2.5, cv=WEAK_EDGES)
    assert (decision.mode, decision.cause) == (Mode.CAUTION, "weak_edges")
    assert decision.fear >= 0.7
    assert Drive.under_way().last(2.5, cv=replace(WEAK_EDGES, confidence=0.95)).fear < 0.5


@pytest.mark.parametrize("side", [1, -1])
def test_after_doubt_about_edges_the_network_leads(side: int) -> None:
    def led(edges: SteeringEstimate) -> float:
        drive = Drive.under_way()
        drive.last(2.5, cv=edges)
        for n in range(40):
            decision = drive.frame(cv=replace(edges, lateral_offset_m=side * 0.02 * n))
        assert decision.lateral_offset_m is not None
        return side * decision.lateral_offset_m

    assert led(WEAK_EDGES) < 0.2
    assert led(replace(WEAK_EDGES, confidence=0.97)) > 0.5


def test_after_a_stop_for_a_doubtful_road_one_estimator_of_two_does_not_start_the_car() -> None:
    drive, weak = Drive.under_way(), replace(ESTIMATE, confidence=0.5, marked=False)
    assert drive.last(0.6, cv=weak, cnn=NO_LANE).mode is Mode.STOP
    drive.speed_mps = 0.0
    assert drive.last(10.0, cv=NO_LANE).mode is Mode.STOP
    assert drive.last(3.0).mode is not Mode.STOP


def test_a_wandering_network_does_not_stop_the_car_while_lines_are_confident() -> None:
    drive = Drive.under_way()
    for n in range(40):
        decision = drive.frame(cnn=replace(ESTIMATE, lateral_offset_m=0.2 if n % 2 else -0.1))
        assert decision.mode is not Mode.STOP


def test_the_same_messages_give_the_same_decisions() -> None:
    def results() -> list[Decision]:
        drive = Drive(supervisor=build_once())
        return [drive.frame(lead=LEAD, cv=NO_LANE if n % 7 == 0 else ESTIMATE) for n in range(60)]

    assert results() == results()


def test_rules_about_an_unknown_input_are_refused() -> None:
    file = RULES.file.model_copy(update={"inputs": {**RULES.inputs, "brightnes": RULES.inputs["brightness"]}})
    with pytest.raises(InputError, match="unknown input 'brightnes'; did you mean 'brightness'"):
        Supervisor(FearRules(file, RULES.rules), SETTINGS, VEHICLE)


def test_the_car_does_not_start_while_the_estimators_report_different_roads() -> None:
    aside = replace(ESTIMATE, lateral_offset_m=0.7, heading_error_rad=0.0)
    decision = Drive().last(6.0, cnn=aside)
    assert decision.fear <= SETTINGS.modes.reengage_max_fear
    assert (decision.mode, decision.cause) == (Mode.STOP, "starting")


def test_a_single_weak_estimate_of_an_unmarked_road_stops_the_car_soon() -> None:
    drive = Drive.under_way()
    weak = replace(ESTIMATE, confidence=0.5, marked=False)
    assert drive.last(0.3, cv=weak, cnn=NO_LANE).mode is Mode.CAUTION
    decision = drive.last(0.3, cv=weak, cnn=NO_LANE)
    assert (decision.mode, decision.stop, decision.cause) == (Mode.STOP, Stop.COMFORT, "no_road")
    assert drive.last(1.0, cv=weak, cnn=NO_LANE).stop is Stop.EMERGENCY


NAMED_CAUSES = list(SETTINGS.modes.causes)


def misspelt(lines: list[str], field: str, cause: str) -> tuple[int, str]:
    """Index of the line below ``field`` that names ``cause``, and the text with the name misspelt there."""
    first = next(i for i, line in enumerate(lines) if line.strip().startswith(f"{field}:"))
    at = next(i for i in range(first, len(lines)) if cause in lines[i])
    return at, "\n".join([*lines[:at], lines[at].replace(cause, f"{cause}x", 1), *lines[at + 1 :]])


@pytest.mark.parametrize(("path", "cause"), NAMED_CAUSES)
def test_a_misspelt_cause_in_the_settings_is_refused_at_its_place(
    tmp_path: Path, path: tuple[str | int, ...], cause: str
) -> None:
    text = (CONFIG_DIR / "supervisor.yaml").read_text(encoding="utf-8")
    line, wrong = misspelt(text.splitlines(), str(path[1]), cause)
    file = tmp_path / "supervisor.yaml"
    file.write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError) as error:
        build(settings=file)
    column = wrong.splitlines()[line].index(f"{cause}x") + 1
    assert str(error.value).startswith(f"{file}:{line + 1}:{column}: ")
    assert str(error.value).endswith(f"unknown cause '{cause}x'; did you mean '{cause}'?")


@pytest.mark.parametrize("cause", sorted({cause for _, cause in NAMED_CAUSES}))
def test_rules_without_a_cause_that_the_settings_name_are_refused_while_driving(
    tmp_path: Path, cause: str
) -> None:
    text = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    file = tmp_path / "fear.yaml"
    renamed = text.replace(f"because {cause}\n", "because demand\n").replace(f": {cause}\n", ": demand\n")
    file.write_text(renamed, encoding="utf-8")
    supervisor = build()
    refusal = rf"supervisor\.yaml:\d+:\d+: modes\..*: no rule gives the cause '{cause}'; "
    with pytest.raises(InputError, match=refusal):
        supervisor.adopt(FearRules.load(file))
    with pytest.raises(InputError, match=refusal):
        build(rules=file)
    supervisor.adopt(FearRules.load(CONFIG_DIR / "fear.yaml"))
    file.write_text(f"without: [{cause}]\n{renamed}", encoding="utf-8")
    supervisor.adopt(FearRules.load(file))


def settings_with(tmp_path: Path, old: str, new: str) -> Path:
    text = (CONFIG_DIR / "supervisor.yaml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "supervisor.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    return file


def test_a_rating_by_a_name_without_rules_is_refused_at_its_place(tmp_path: Path) -> None:
    file = settings_with(tmp_path, "lane: cv ", "lane: cvv ")
    with pytest.raises(
        InputError, match=r"supervisor\.yaml:5:3: rated_as\.lane: .*'cvv'; did you mean 'cv'\?$"
    ):
        build(settings=file)


@pytest.mark.parametrize(
    ("old", "new", "warning"),
    [
        ("  lane: cv ", "  lanee: cv ", r":5:3: rated_as\.lanee: warning: .*; did you mean 'lane'\?"),
        ("    cnn: 0.7", "    cnnn: 0.7", r":\d+:5: fusion\.trust\.cnnn: warning: .*; did you mean 'cnn'\?"),
        ("    cnn: 0.7", "    cnn: 0.7\n    hough: 0.7", "^$"),
    ],
)
def test_a_near_miss_of_an_estimator_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, warning: str
) -> None:
    build(settings=settings_with(tmp_path, old, new))
    assert re.search(warning, capsys.readouterr().err)


def test_a_fault_may_be_final_without_a_rule() -> None:
    def with_modes(**changes: object) -> SupervisorSettings:
        return SETTINGS.model_copy(update={"modes": SETTINGS.modes.model_copy(update=changes)})

    Supervisor(RULES, with_modes(final_causes=("driver_override",)), VEHICLE)
    with pytest.raises(InputError, match="no rule gives the cause 'driver_override'"):
        Supervisor(RULES, with_modes(stop_after_s={"driver_override": 1.0}), VEHICLE)


def test_a_near_miss_of_a_cause_is_named_at_the_start(tmp_path: Path) -> None:
    text = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
    file = tmp_path / "fear.yaml"
    renamed = text.replace("because odd_road\n", "because odd_raod\n").replace(": odd_road\n", ": odd_raod\n")
    file.write_text(f"causes: {{odd_raod: misspelt}}\n{renamed}", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"stop_after_s\.odd_road: no rule gives .*; did you mean 'odd_raod'\?"
    ):
        build(rules=file)


def test_settings_may_name_a_cause_that_the_rules_declare() -> None:
    modes = SETTINGS.modes.model_copy(update={"stop_after_s": {"ice": 1.0}})
    settings_with_ice = SETTINGS.model_copy(update={"modes": modes})
    with pytest.raises(InputError, match=r"modes\.stop_after_s\.ice: unknown cause 'ice'"):
        Supervisor(RULES, settings_with_ice, VEHICLE)
    declared = RULES.file.model_copy(update={"causes": {"ice": "the road is slippery"}})
    with pytest.raises(InputError, match="no rule gives the cause 'ice'"):
        Supervisor(FearRules(declared, RULES.rules), settings_with_ice, VEHICLE)
    icy = parse_rule("if brightness is very_low then fear is high because ice", RULES.names)
    Supervisor(FearRules(declared, (*RULES.rules, icy)), settings_with_ice, VEHICLE)


@pytest.mark.parametrize("sender", ["cv", "cnn", "statistics", "lead", "state"])
def test_a_message_that_cannot_be_decoded_makes_its_input_broken(sender: str) -> None:
    drive = Drive.under_way()
    calm = drive.frame(lead=LEAD)
    drive.now_s += FRAME_S
    messages = {name: drive.latest[name] for name in ("statistics", "lead", "state")}
    estimates = {name: drive.latest[name] for name in ("cv", "cnn")}
    decision = drive.supervisor.step(estimates, *messages.values(), now_s=drive.now_s, malformed=[sender])
    assert calm.fear < 0.5 and decision.fear == 1
    assert decision.mode is Mode.CAUTION, "a single one slows the car and does not stop it"
    assert drive.frame(lead=LEAD).fear < 0.5
