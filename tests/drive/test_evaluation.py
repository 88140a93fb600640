"""The summary of a live drive: what a car that did not drive waited for."""

import time
from types import SimpleNamespace
from typing import Any

import pytest
from message_rig import decision

from drive.evaluation import closing_words, evaluate
from drive.log import DriveLog
from drive.open_road import OpenRoad
from trepid.bus import free_endpoint, open_bus
from trepid.causes import NO_COMMAND
from trepid.messages import Diagnostic, Health, VehicleState
from trepid.topics import DECISION, DIAGNOSTICS, VEHICLE_STATE
from vehicle.driver.stop_button import STOPPED

WAITS = "starting: waits for the estimate of cnn (none for 3.1 s)"


def summary_of(*, waits_for: str, said: str = "", speed_mps: float = 0.0) -> dict[str, Any]:
    """The row of a drive of 2 s without simulator in which the vehicle process ``said`` this."""
    with open_bus("car", time.monotonic, listen=free_endpoint()) as bus:
        log = DriveLog(bus, time.monotonic, ())
        state, beat = bus.publisher(VEHICLE_STATE), bus.publisher(DIAGNOSTICS)
        bus.publisher(DECISION)(decision(waits_for=waits_for))
        beat(Diagnostic(t_s=0.0, process="vehicle", health=Health.WARN, message=said, values=()))
        for t_s in (0.0, 1.0, 2.0):
            state(
                VehicleState(
                    t_s=t_s,
                    speed_mps=speed_mps,
                    road_wheel_angle_rad=0.0,
                    yaw_rate_radps=0.0,
                    driver_override=False,
                )
            )
        log.receive(timeout_s=0.0)
        fleet: Any = SimpleNamespace(children={})
        return evaluate(log, fleet, OpenRoad(), seed=0, elapsed_s=2.0, problems=[], notes=["a note"])


@pytest.mark.parametrize(("said", "waits_for"), [("", WAITS), (STOPPED, STOPPED), (NO_COMMAND, NO_COMMAND)])
def test_a_car_that_did_not_drive_says_why_and_the_vehicle_process_comes_first(
    said: str, waits_for: str
) -> None:
    row = summary_of(waits_for=WAITS, said=said)
    *_, note, last = row["notes"]
    assert (row["waits_for"], note, last) == (waits_for, "a note", f"the car did not drive: {waits_for}")


def test_a_stop_of_the_limiter_is_a_note_with_its_time_and_one_by_the_button_is_not() -> None:
    stops = [
        one for one in summary_of(waits_for="", said=NO_COMMAND, speed_mps=5.0)["notes"] if "command" in one
    ]
    assert len(stops) == 1 and stops[0].startswith("at ") and stops[0].endswith(f" s {NO_COMMAND}")
    assert summary_of(waits_for="", said=STOPPED, speed_mps=5.0)["notes"] == ["a note"]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"status": "passed", "reasons": [], "notes": [], "end": "its 30 s are over"}, "its 30 s are over; passed"),
        ({"status": "failed", "reasons": ["cnn ended", "it left the lane"], "notes": [], "end": "cnn ended"},
         "failed: cnn ended; it left the lane"),
        ({"status": "not driven", "reasons": [], "notes": ["a", "it waits"], "end": "stopped by SIGINT"},
         "stopped by SIGINT; not driven: it waits"),
    ],
)  # fmt: skip
def test_the_closing_words_say_why_a_drive_ended_and_its_verdict_and_nothing_twice(
    row: dict[str, Any], words: str
) -> None:
    assert closing_words(row) == words


def test_only_a_car_that_drove_by_itself_has_no_such_note() -> None:
    assert summary_of(waits_for=WAITS, speed_mps=5.0)["notes"] == ["a note"]
    *_, note = summary_of(waits_for="")["notes"]
    assert note == "the car did not drive: nothing that Trepid knows kept it from driving"
