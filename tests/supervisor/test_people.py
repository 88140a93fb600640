"""The supervisor among people: it slows, brakes hard, waits with a cause, and drives on."""

from dataclasses import replace
from typing import Any

import pytest
from supervisor_rig import FRAME_S, SETTINGS, Drive

from trepid.messages import Decision, Mode, RoadUsers, Stop

S = SETTINGS.giving_way
DETECTS = ("person", "cyclist", "animal")
NOBODY = RoadUsers(t_s=0.0, detects=DETECTS)


def person(x_m: float, y_m: float, *, y_mps: float = 0.0, kind: str = "person") -> RoadUsers:
    return RoadUsers(
        t_s=0.0,
        kinds=(kind,),
        x_m=(x_m,),
        y_m=(y_m,),
        x_mps=(0.0,),
        y_mps=(y_mps,),
        confidences=(0.9,),
        detects=DETECTS,
    )


def decide_on_users(road_users: RoadUsers | None, frames: int = 1) -> Decision:
    """The last of some decisions of a car at 8 m/s that sees these road users."""
    return Drive.under_way().last(frames * FRAME_S, road_users=road_users)


@pytest.mark.parametrize("kind", DETECTS)
def test_one_in_the_way_far_ahead_slows_the_car_and_is_the_cause(kind: str) -> None:
    decision = decide_on_users(person(24.0, 0.0, kind=kind))
    assert (decision.cause, decision.stop) == ("person", Stop.NONE)
    assert 5 < decision.speed_cap_mps < 8 and decision.road_user == kind
    assert decision.road_user_m == pytest.approx(24.0 - 2.2 - 8.0 * 0.03)


def test_one_that_steps_out_near_is_braked_for_hard_without_a_stop_of_the_mode() -> None:
    drive = Drive.under_way()
    near = drive.frame(road_users=person(13.0, 0.0))
    assert (near.stop, near.cause, near.speed_cap_mps) == (Stop.EMERGENCY, "person", 0.0)
    assert near.mode is not Mode.STOP and near.waits_for.startswith("brakes hard for a person, 11 m ahead")
    assert drive.frame(road_users=NOBODY).stop is Stop.NONE


def test_the_car_waits_with_a_cause_and_drives_on_when_the_way_is_free() -> None:
    drive = Drive.under_way()
    drive.speed_mps = 0.0
    waits = drive.last(5.0, road_users=person(4.0, 0.3))
    assert waits.speed_cap_mps == 0 and waits.mode is Mode.CAUTION and waits.cause == "person"
    assert waits.waits_for == "waits for a person, 2 m ahead; drives on when the way is free"
    assert drive.last(S.free_s / 2, road_users=NOBODY).speed_cap_mps == 0
    assert drive.last(S.free_s, road_users=NOBODY).speed_cap_mps > 0
    gone = drive.last(4.0, road_users=NOBODY)
    assert (gone.mode, gone.cause, gone.waits_for) == (Mode.KEEP, "none", "")


def test_a_bystander_slows_the_car_and_does_not_stop_it() -> None:
    decision = decide_on_users(person(6.0, -2.0), frames=50)
    assert decision.speed_cap_mps >= S.passing_mps and decision.waits_for == ""
    assert decision.speed_cap_mps < 4 and decision.cause == "person"


def test_people_far_from_the_lane_cost_nothing() -> None:
    assert (
        decide_on_users(person(20.0, 9.0)).speed_cap_mps
        == decide_on_users(NOBODY).speed_cap_mps
        == SETTINGS.cruise_speed_mps
    )


def test_a_car_without_a_detector_of_people_decides_as_if_it_saw_none() -> None:
    blind, seeing = Drive.under_way(), Drive.under_way()
    assert blind.frame() == seeing.frame(road_users=NOBODY)


def test_a_detector_that_falls_silent_stops_the_car_for_good_and_is_the_cause() -> None:
    drive = Drive.under_way()
    drive.frame(road_users=NOBODY)
    decision = drive.last(SETTINGS.validation.fresh_s + 0.04)
    assert decision.fear == 1 and decision.cause == "road_users_lost"
    decision = drive.last(1.0)
    assert (decision.mode, decision.cause) == (Mode.STOP, "road_users_lost")
    drive.speed_mps = 0.0
    assert drive.last(5.0, road_users=NOBODY).waits_for.endswith("waits for a restart of the drive")


@pytest.mark.parametrize("broken", [{"x_m": (float("nan"),)}, {"confidences": (2.0,)}, {"y_m": ()}])
def test_a_broken_message_is_not_a_free_road(broken: dict[str, Any]) -> None:
    assert decide_on_users(replace(person(30.0, 0.0), **broken)).fear == 1


def test_a_driver_is_not_braked_for() -> None:
    drive = Drive.under_way()
    overriding = replace(drive.latest["state"], driver_override=True)
    assert drive.frame(road_users=person(8.0, 0.0), state=overriding).stop is not Stop.EMERGENCY


def test_a_car_that_stops_for_another_cause_brakes_harder_for_a_person() -> None:
    drive = Drive.under_way()
    stopping = drive.last(0.4, cv=None, cnn=None)
    assert (stopping.mode, stopping.stop) == (Mode.STOP, Stop.COMFORT)
    assert drive.frame(cv=None, cnn=None, road_users=person(8.0, 0.0)).stop is Stop.EMERGENCY
