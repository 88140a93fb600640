"""What a waiting car names: the condition that holds it, and what would end it."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE
from supervisor_rig import ESTIMATE, LATENCY_S, SETTINGS, STATE, STATISTICS, Drive

from supervisor.modes.waits import READY
from supervisor.rules.verify import load_verified
from supervisor.supervisor import Supervisor
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Decision, LeadVehicle, Losses, Mode, Stop
from trepid.scale import scaled_message

UNSURE = replace(ESTIMATE, confidence=0.1)
DIM = replace(STATISTICS, brightness=0.02)
HALTED = LeadVehicle(t_s=0.0, distance_m=2.7, lateral_m=0.0, speed_mps=0.0, confidence=0.9)
SILENT: dict[str, Any] = dict.fromkeys(("cv", "cnn", "statistics"))


def first(drive: Drive, **messages: Any) -> str:
    return drive.last(0.2, **messages).waits_for


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        (SILENT, "starting: waits for frames of the camera (none so far)"),
        ({"cnn": None}, "starting: waits for the estimate of cnn (none so far)"),
        ({"cnn": replace(ESTIMATE, confidence=7.0)}, "starting: waits for the estimate of cnn (not valid)"),
        ({"state": None}, "starting: waits for the state of the vehicle (none so far)"),
        (
            {"state": replace(STATE, yaw_rate_radps=math.nan)},
            "starting: waits for the state of the vehicle (not valid)",
        ),
        (
            {"cv": UNSURE, "cnn": UNSURE},
            "starting: waits for a lane with a confidence of at least 0.2 (now cv 0.10, cnn 0.10)",
        ),
        (
            {"statistics": None},
            "starting: waits for 2.0 s of fear of at most 0.62 (now 1.00: no image statistics)",
        ),
        ({"statistics": DIM}, "starting: waits for 2.0 s of fear of at most 0.62 (now 0.75: dark image)"),
        (
            {"state": replace(STATE, road_wheel_angle_rad=None, doubted=("road_wheel_angle_rad",))},
            "starting: waits for 2.0 s of fear of at most 0.62 (now 1.00: doubted measurement (wheel angle))",
        ),
        (
            {"state": replace(STATE, driver_override=True)},
            "starting: waits for the driver to let go",
        ),
    ],
)
def test_a_standing_car_names_the_first_condition_that_keeps_it_from_driving(
    messages: dict[str, Any], words: str
) -> None:
    assert first(Drive(), **messages) == words


def test_a_healthy_car_counts_down_to_its_start_and_then_waits_for_nothing() -> None:
    drive = Drive()
    said = [drive.frame().waits_for for _ in range(60)]
    left_s = [float(re.search(r"drives after ([0-9.]+) s more", words)[1]) for words in said if words]  # type: ignore[index]
    assert left_s == sorted(left_s, reverse=True) and left_s[0] == SETTINGS.modes.reengage_after_s
    assert said[-1] == ""


def test_the_age_of_a_silent_estimator_grows_in_the_words() -> None:
    drive = Drive()
    drive.last(0.4, cnn=ESTIMATE, statistics=DIM)
    words = drive.last(3.08, cnn=None, statistics=DIM).waits_for
    assert words == f"starting: waits for the estimate of cnn (none for {3.08 + LATENCY_S:.1f} s)"


def test_a_standing_car_without_a_speed_that_holds_names_the_speed() -> None:
    drive = Drive(speed_mps=None)  # type: ignore[arg-type]
    words = first(drive, state=replace(STATE, doubted=("speed_mps",)))
    assert words == "starting: waits for the state of the vehicle (speed doubted)"


def test_a_stop_for_a_measurement_keeps_the_name_of_it() -> None:
    drive = Drive.under_way()
    doubted = replace(STATE, road_wheel_angle_rad=None, doubted=("road_wheel_angle_rad",))
    stopping = drive.last(2.0, state=doubted)
    assert (stopping.cause, stopping.part) == ("doubted_state", "wheel angle")
    assert stopping.waits_for == "stopping: doubted measurement (wheel angle); waits for standstill"
    again = drive.last(0.2)
    assert (again.cause, again.part) == ("doubted_state", "wheel angle")


def test_a_car_that_starts_on_the_move_waits_for_standstill_or_a_driver() -> None:
    assert first(Drive(speed_mps=8.0)) == "starting: waits for standstill, or for a driver who hands over"


DRIVEN = replace(STATE, driver_override=True)


def test_a_driver_on_the_move_is_told_what_the_car_waits_for_and_when_it_is_ready() -> None:
    drive = Drive(speed_mps=8.0)
    unsure = "starting: waits for a lane with a confidence of at least 0.2 (now cv 0.10, cnn 0.10)"
    assert first(drive, cv=UNSURE, cnn=UNSURE, state=DRIVEN) == unsure
    said = [drive.frame(state=DRIVEN).waits_for for _ in range(80)]
    left_s = [float(words.split()[4]) for words in said if " takes over after " in words]
    assert left_s == sorted(left_s, reverse=True) and left_s[0] == SETTINGS.modes.reengage_after_s
    assert said[-1] == READY


@pytest.mark.parametrize("driven_s", np.arange(0.2, 4.0, 0.4))
def test_a_moving_car_says_that_it_is_ready_exactly_when_it_takes_over(driven_s: float) -> None:
    drive = Drive(speed_mps=8.0)
    drive.last(0.5, statistics=DIM, state=DRIVEN)
    ready = drive.last(driven_s, state=DRIVEN).waits_for == READY
    assert (drive.frame().mode is not Mode.STOP) == ready


@pytest.mark.parametrize("lost", ["cv", "cnn"])
def test_a_stop_for_a_lost_estimator_names_it_and_is_final_also_when_it_is_back(lost: str) -> None:
    drive = Drive.under_way()
    words = f"stopping: late or lost estimator ({lost}); waits for a restart of the drive"
    assert drive.last(0.6, **{lost: None}).waits_for == words
    drive.speed_mps = 0.0
    assert drive.last(4.0).waits_for == words.replace("stopping", "stopped")


def test_an_emergency_stop_is_named_as_such() -> None:
    drive = Drive.under_way()
    assert (
        drive.last(0.9, **SILENT).waits_for
        == "emergency stop: no new image; waits for a restart of the drive"
    )


def test_a_stop_for_fear_waits_for_standstill_and_then_for_less_fear() -> None:
    drive = Drive.under_way()
    blind = {"statistics": DIM, "cv": replace(ESTIMATE, confidence=0.2), "cnn": UNSURE}
    stopping = drive.last(0.8, **blind)
    assert (stopping.mode, stopping.waits_for) == (Mode.STOP, "stopping: dark image; waits for standstill")
    drive.speed_mps = 0.0
    waits = drive.last(0.2, **blind).waits_for
    assert waits.startswith("stopped: dark image; waits for 2.0 s of fear of at most 0.62 (now ")


def test_a_car_behind_a_standing_vehicle_names_the_gap_and_waits_for_it_to_drive_on() -> None:
    drive = Drive.under_way()
    drive.speed_mps = 0.0
    words = drive.last(2.0, lead=HALTED).waits_for
    assert words == "stopped behind a vehicle, 2.7 m; waits for it to drive on"


def test_the_gap_is_that_of_a_small_car_in_its_own_world() -> None:
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    small = vehicle.model_copy(update={"lane_width_m": 0.1 * vehicle.lane_width_m})
    drive = Drive(Supervisor(load_verified(CONFIG_DIR / "fear.yaml"), SETTINGS, small))
    seen = scaled_message(ESTIMATE, 0.1)
    assert drive.last(2.4, cv=seen, cnn=seen).waits_for == ""
    words = drive.last(2.0, cv=seen, cnn=seen, lead=scaled_message(HALTED, 0.1)).waits_for
    assert words == "stopped behind a vehicle, 0.3 m; waits for it to drive on"


def test_a_car_that_brakes_for_late_messages_names_their_senders() -> None:
    drive = Drive.under_way()
    late = [drive.frame(cv=None) for _ in range(6)]
    braking = next(d for d in late if d.stop is Stop.COMFORT and d.mode is not Mode.STOP)
    assert braking.waits_for == "brakes: late or lost estimator; waits for 3 messages in time of cv"


def test_senders_are_named_in_one_order_so_that_a_replay_repeats_the_words() -> None:
    drive = Drive.under_way()
    late = [drive.frame(cv=None, cnn=None, statistics=None) for _ in range(8)]
    named = {d.waits_for.partition(" in time of ")[2] for d in late} - {""}
    assert "cnn, cv, statistics" in named
    assert all(words.split(", ") == sorted(words.split(", ")) for words in named)


def test_a_lost_process_is_what_a_standing_car_waits_for() -> None:
    drive = Drive()
    drive.last(0.2)
    get = drive.latest.get
    decision = drive.supervisor.step(
        {"cv": get("cv"), "cnn": get("cnn")},
        get("statistics"),
        None,
        get("state"),
        now_s=drive.now_s,
        losses=Losses(t_s=0.0, stop=("vehicle",), slow=()),
    )
    assert decision.waits_for == "starting: waits for the process that is lost"


@given(
    st.lists(
        st.fixed_dictionaries(
            {},
            optional={
                "cv": st.sampled_from([None, UNSURE, ESTIMATE]),
                "cnn": st.sampled_from([None, UNSURE, ESTIMATE]),
                "statistics": st.sampled_from([None, DIM, STATISTICS]),
                "lead": st.sampled_from([HALTED, None]),
                "state": st.sampled_from([None, STATE, replace(STATE, driver_override=True)]),
            },
        ),
        min_size=1,
        max_size=40,
    ),
    st.sampled_from([0.0, 8.0]),
)
def test_a_car_that_may_not_drive_always_says_why_and_one_that_may_says_nothing(
    frames: list[dict[str, Any]], speed_mps: float
) -> None:
    drive = Drive(speed_mps=speed_mps)
    for messages in frames:
        decision: Decision = drive.frame(**messages)
        assert bool(decision.waits_for) == (decision.speed_cap_mps < SHUTTLE.standstill_mps)
