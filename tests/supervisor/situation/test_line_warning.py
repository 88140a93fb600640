"""The warning before a wheel leaves the lane: closed forms, zones of ISO 17361, silence where nothing is known."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from supervisor_rig import ESTIMATE, FRAME_S, SETTINGS, STATE, Drive
from trace_rig import state, truth

from sim_harness.judging.margins import time_to_crossing_s
from sim_harness.judging.trace import Recorder
from supervisor.path.fusion import FusionResult, Path
from supervisor.situation.features import BEYOND
from supervisor.situation.line_warning import SIDES, Approach, LineWarning, approach, is_due
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, Motion
from trepid.config import CONFIG_DIR, load
from trepid.messages import Decision

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
LIMITS = SETTINGS.line_warning
CAR: dict[str, Any] = {"half_width_m": VEHICLE.track_m / 2, "wheelbase_m": VEHICLE.wheelbase_m}
WIDTH_M, SPEED_MPS = 3.3, 8.0
MOVING = Motion(SPEED_MPS, 0.0)
ROOM_M = WIDTH_M / 2 - VEHICLE.track_m / 2


def lane_at(offset_m: float, heading_rad: float = 0.0, curvature_1pm: float = 0.0) -> Lane:
    return Lane(offset_m, heading_rad, curvature_1pm, 0.0)


def world_of(
    lane: Lane | None,
    motion: Motion | None = MOVING,
    *,
    width_m: float | None = WIDTH_M,
    sources: tuple[str, ...] = ("cv",),
    measured: bool = True,
) -> Any:
    """What the supervisor knows of the lane, its width (None: not known) and the motion."""
    path = None if lane is None else Path(0.0, lane, 8.0, "cv", measured)
    fused = FusionResult(path, sources, (1.0,) * len(sources), None, 0.0, 0.0)
    cv = SimpleNamespace(width_m=width_m, confidence=0.9, measures_width=width_m is not None)
    return SimpleNamespace(fused=fused, motion=motion, estimates=[cv])


def warnings_of(lanes: list[Lane | None], *, motion: Motion | None = MOVING, **options: Any) -> list[str]:
    """The warnings frame by frame."""
    warning = LineWarning(options.pop("limits", LIMITS), VEHICLE)
    return [
        warning.step(world_of(lane, motion, **options), now_s=number * FRAME_S).line_warning
        for number, lane in enumerate(lanes)
    ]


@pytest.mark.parametrize("side", SIDES)
def test_a_car_that_drifts_on_a_straight_road_crosses_with_its_front_wheel_after_room_over_drift(side: str):
    sign, heading_rad = SIDES[side], 0.05
    lane = lane_at(sign * 0.2, sign * heading_rad)
    seen = approach(lane, WIDTH_M, Motion(SPEED_MPS, 0.0), side=sign, **CAR)
    front_m = ROOM_M - 0.2 - VEHICLE.wheelbase_m * heading_rad
    assert seen == pytest.approx((front_m / (SPEED_MPS * heading_rad), front_m, SPEED_MPS * heading_rad))
    assert approach(lane, WIDTH_M, Motion(SPEED_MPS, 0.0), side=-sign, **CAR).time_s == BEYOND


def test_the_time_is_that_by_which_the_simulator_judges_drives():
    rng, recorder = np.random.default_rng(1), Recorder()
    cases = rng.uniform((-0.5, -0.08, -0.02, -0.3), (0.5, 0.08, 0.02, 0.3), (400, 4)).tolist()
    for number, (offset_m, heading_rad, curvature_1pm, yaw_rate_radps) in enumerate(cases):
        place = dict(lateral_offset_m=offset_m, heading_error_rad=heading_rad, curvature_1pm=curvature_1pm)
        moving = replace(state(number, SPEED_MPS), yaw_rate_radps=yaw_rate_radps)
        recorder.add(truth(number, lane_width_m=WIDTH_M, **place), moving, None, None, {})
    judged_s = time_to_crossing_s(recorder.trace())
    found_s = [
        min(
            approach(lane_at(*case[:3]), WIDTH_M, Motion(SPEED_MPS, case[3]), side=side, **CAR).time_s
            for side in SIDES.values()
        )
        for case in cases
    ]
    soon = judged_s < 2.0
    assert soon.sum() > 100
    assert np.array(found_s)[soon] == pytest.approx(
        judged_s[soon], rel=0.1, abs=0.05
    )  # bend below the wheelbase
    assert (np.array(found_s)[judged_s > 2.5] > 2.0).all()


@given(room_m=st.floats(-0.3, 2.0), speed_mps=st.floats(0.05, 2.0), ahead_s=st.floats(0.3, 3.0))
def test_no_warning_begins_before_the_earliest_line_of_the_standard(
    room_m: float, speed_mps: float, ahead_s: float
):
    time_s = max(room_m, 0.0) / speed_mps
    if is_due(Approach(time_s, room_m, speed_mps), ahead_s):
        earliest_m = 0.75 if speed_mps <= 0.5 else min(1.5 * speed_mps, 1.5)
        assert room_m <= earliest_m + 1e-12 and time_s < ahead_s


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("drift_mps", [0.2, 0.5, 1.0])
def test_the_warning_comes_before_the_wheel_is_over_the_edge_and_within_the_latest_line(
    side: str, drift_mps: float
):
    sign, heading_rad = SIDES[side], drift_mps / SPEED_MPS
    start_m = ROOM_M - VEHICLE.wheelbase_m * heading_rad - 2.0 * drift_mps  # crosses after 2 s
    lanes = [lane_at(sign * (start_m + n * FRAME_S * drift_mps), sign * heading_rad) for n in range(80)]
    said = warnings_of(lanes)
    first_s = said.index(side) * FRAME_S
    assert {*said} == {"", side}
    assert 2.0 - LIMITS.ahead_s < first_s < 2.0 - LIMITS.ahead_s + LIMITS.confirm_s + 2.5 * FRAME_S


def test_a_car_that_keeps_its_lane_or_runs_along_its_edge_is_not_warned():
    assert {
        *warnings_of([lane_at(0.1 * math.sin(n / 10), 0.005 * math.cos(n / 10)) for n in range(100)])
    } == {""}
    assert {*warnings_of([lane_at(ROOM_M - 0.1)] * 50)} == {""}


def test_beyond_the_edge_a_car_is_warned_until_it_comes_back():
    out = [lane_at(ROOM_M + 0.2)] * 20
    back = [lane_at(ROOM_M + 0.2 - 0.02 * n, -0.06) for n in range(25)]
    said = warnings_of([*out, *back])
    assert set(said[5:20]) == {"left"} and said[-1] == ""


def test_one_false_lane_does_not_warn_and_a_warning_lasts_long_enough_to_be_noticed():
    calm, near = lane_at(0.0), lane_at(0.3, 0.12)
    assert {*warnings_of([calm, calm, near, calm, calm])} == {""}
    said = warnings_of([calm, *[near] * 5, *[calm] * 30])
    lasting_s = said.count("left") * FRAME_S
    assert LIMITS.hold_s <= lasting_s <= LIMITS.hold_s + 6 * FRAME_S


@pytest.mark.parametrize(
    "unknown",
    [
        {"motion": None},
        {"width_m": None},
        {"sources": ()},
        {"measured": False},
        {"motion": Motion(0.5 * LIMITS.from_mps, 0.0)},
        {"limits": LIMITS.model_copy(update={"enabled": False})},
    ],
    ids=["motion", "width", "a remembered lane", "an angle alone", "slow", "switched off"],
)
def test_without_lane_width_or_motion_and_when_slow_or_switched_off_there_is_no_warning(
    unknown: dict[str, Any],
):
    assert {*warnings_of([lane_at(0.5, 0.12)] * 20, **unknown)} == {""}
    assert {*warnings_of([None] * 20)} == {""}


def test_the_time_is_unknown_and_not_zero_where_nothing_is_known():
    warning = LineWarning(LIMITS, VEHICLE)
    assert warning.step(world_of(None), now_s=0.0) == ("", None)
    assert warning.step(world_of(lane_at(0.0)), now_s=0.1) == ("", None)


@pytest.mark.parametrize("override", [False, True], ids=["the car", "a driver"])
def test_the_decision_warns_in_manual_driving_too_and_a_warning_changes_nothing_else(override: bool):
    found: list[list[Decision]] = []
    for switched_on in (True, False):
        drive = Drive.under_way()
        if not switched_on:
            off = LIMITS.model_copy(update={"enabled": False})
            drive.supervisor._line_warning = LineWarning(off, VEHICLE)
        out = replace(ESTIMATE, lateral_offset_m=0.45, heading_error_rad=0.08)
        state = replace(STATE, driver_override=override)
        found.append([drive.frame(cv=out, cnn=out, state=state) for _ in range(15)])
    on, off = found
    assert on[-1].line_warning == "left" and 0.0 <= (on[-1].line_crossing_s or 0.0) < LIMITS.ahead_s
    assert {one.line_warning for one in off} == {""}
    assert [replace(one, line_warning="") for one in on] == off


def test_in_a_model_of_the_car_a_warning_comes_at_the_same_moment():
    """Lengths of the reference world are those of the car times its scale; times and angles are the same."""
    lane, motion, factor = lane_at(0.4, 0.08, 0.01), Motion(8.0, 0.1), 0.1
    small = Lane(lane.offset_m * factor, lane.heading_rad, lane.curvature_1pm / factor, 0.0)
    car = {name: value * factor for name, value in CAR.items()}
    for side in SIDES.values():
        real = approach(lane, WIDTH_M, motion, side=side, **CAR)
        model = approach(small, WIDTH_M * factor, Motion(0.8, 0.1), side=side, **car)
        assert model.time_s == pytest.approx(real.time_s) and model.room_m == pytest.approx(
            real.room_m * factor
        )
    assert np.isfinite(real.room_m)
