"""The scores of a drive of a real car."""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import pytest
from message_rig import decision

from drive.tally import Tally
from sim_harness.judging.metrics import Metrics
from trepid.messages import Decision, Mode, VehicleState

STATE = VehicleState(
    t_s=0.0, speed_mps=5.0, road_wheel_angle_rad=None, yaw_rate_radps=None, driver_override=False
)
KEEP, STARTING = decision(), decision(mode=Mode.STOP, cause="starting")
DARK = decision(mode=Mode.STOP, cause="dark")


def test_a_drive_of_a_real_car_has_the_fields_of_a_simulated_one_in_their_order() -> None:
    assert [*Tally().row()] == [*(field.name for field in fields(Metrics)), "realtime_factor", "trace_sha256"]


def tally_drive(*steps: tuple[VehicleState, Decision | None]) -> dict[str, Any]:
    """Row and notes of a drive with a state every half second."""
    tally = Tally()
    for n, (state, newest) in enumerate(steps):
        tally.add(replace(state, t_s=100.0 + 0.5 * n), SimpleNamespace(decision=newest))  # type: ignore[arg-type]
    verdict = tally.verdict([], elapsed_s=1.0)
    return {"status": verdict.status, "notes": verdict.notes, **verdict.scores}


@pytest.mark.parametrize(
    ("person", "note"),
    [
        (replace(STATE, stop_pressed=True), "a person stopped the car at 20.0 s"),
        (replace(STATE, driver_override=True), "a person took over at 20.0 s"),
    ],
)
def test_a_person_who_ends_the_driving_counts_once_as_an_intervention_of_six_seconds(
    person: VehicleState, note: str
) -> None:
    row = tally_drive(*[(STATE, KEEP)] * 40, *[(person, STARTING)] * 81)
    assert (row["interventions"], row["notes"]) == (1, (note,))
    assert row["autonomy_percent"] == pytest.approx(100 * (1 - 6 / 60))


def test_a_person_who_has_the_car_before_it_drives_by_itself_does_not_count() -> None:
    row = tally_drive(*[(replace(STATE, driver_override=True), STARTING)] * 9, *[(STATE, KEEP)] * 9)
    assert (row["interventions"], row["notes"]) == (0, ())


@pytest.mark.parametrize(
    ("steps", "status"),
    [
        ([(STATE, KEEP)] * 9, "passed"),
        ([(replace(STATE, speed_mps=None), KEEP)] * 9, "passed"),
        ([(replace(STATE, speed_mps=0.0), KEEP)] * 9, "not driven"),
        ([(replace(STATE, speed_mps=None), STARTING)] * 9, "not driven"),
        ([(replace(STATE, driver_override=True), STARTING)] * 9, "not driven"),
        ([(STATE, None)] * 9, "not driven"),
    ],
)
def test_a_drive_passes_only_where_the_car_moved_by_itself(
    steps: list[tuple[VehicleState, Decision | None]], status: str
) -> None:
    row = tally_drive(*steps)
    assert row["status"] == status
    assert (row["autonomy_percent"] is None) == (status == "not driven")


def test_the_row_names_the_cause_of_the_last_stop_but_not_the_start() -> None:
    assert tally_drive(*[(STATE, STARTING)] * 3)["stop_cause"] == "starting"
    assert tally_drive(*[(STATE, STARTING)] * 3, *[(STATE, KEEP)] * 3)["stop_cause"] is None
    assert tally_drive(*[(STATE, KEEP)] * 3, *[(STATE, DARK)] * 3, (STATE, KEEP))["stop_cause"] == "dark"
