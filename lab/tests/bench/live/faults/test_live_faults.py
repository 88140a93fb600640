"""One fault of real processes on each wire."""

import threading

import pytest

from lab.bench.live.faults.catalogue import CAN, FAULTS, SIM
from lab.bench.live.faults.flow import drive_faults

pytestmark = pytest.mark.processes


@pytest.mark.parametrize(("wire", "name"), [(SIM, "kill-controller"), (CAN, "kill-vehicle")])
def test_the_car_stops_in_its_lane_and_leaves_nothing_behind(wire: str, name: str) -> None:
    rows = drive_faults(wire, [(FAULTS[name], 0)], threading.Event())
    if not rows:
        pytest.skip("the car does not come to its speed on this machine")
    (row,) = rows
    assert row["braked_ms"] is not None
    assert row["stood_s"] is not None
    assert row["departures"] == 0
    assert not row["hung"]
    assert row["orphans"] == []
    assert row["exit_code"] == 1
    assert row["recording"] in ("complete", "cut short")
