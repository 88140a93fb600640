"""The end of a drive of a real car: the car stands before the processes end, whatever ends the drive."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from can_bus_rig import bus_options
from outer_world_rig import OuterWorld, RealDrive, outer_world
from process_rig import alive, until

from trepid.config import CAR

pytestmark = pytest.mark.processes
FASTEST_MPS2 = 4.2  # UN R157 allows 4; the car of the test follows with a lag


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[OuterWorld]:
    """A car at the other end of a CAN bus."""
    options = bus_options()
    monkeypatch.setenv(CAR, str(tmp_path / "mycar"))
    with outer_world(tmp_path / "mycar", options) as found:
        yield found


def driving(world: OuterWorld, *words: str) -> RealDrive:
    """A drive at more than 3 m/s."""
    drive = RealDrive(world.folder, *words)
    if not until(lambda: world.moves_at(3.0) or drive.popen.poll() is not None, patience_s=90):
        drive.close()
    if not world.moves_at(3.0):
        out, err = drive.popen.communicate(timeout=60)
        pytest.fail(f"the car did not reach 3 m/s: {out}{err}")
    return drive


def stopped_in_its_lane(world: OuterWorld) -> None:
    """The car stands; it was braked within the limits, and its wheels stayed in the lane."""
    assert until(world.stands, patience_s=20)
    last = world.seen[-1]
    assert last.departures == last.interventions == 0
    assert min(truth.longitudinal_accel_mps2 for truth in world.seen) > -FASTEST_MPS2
    assert max(abs(truth.lateral_offset_m) for truth in world.seen) < 0.4


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name
)
def test_a_signal_stops_the_car_before_any_process_ends(world: OuterWorld, number: signal.Signals) -> None:
    drive = driving(world)
    children = drive.children()
    drive.popen.send_signal(number)
    assert until(lambda: world.stands() or not all(map(alive, children)), patience_s=30)
    assert all(map(alive, children)) and world.stands()
    row = drive.row()
    hung_up = number is signal.SIGHUP  # an end without a driver at the terminal
    assert row["returncode"] == (1 if hung_up else 0), row["reasons"]
    assert ("stopped by SIGHUP" in row["reasons"]) == hung_up
    assert row["final_speed_mps"] is None or row["final_speed_mps"] < 0.1  # None: the last one came too late
    stopped_in_its_lane(world)
    assert not any(map(alive, children))


def test_the_car_stands_at_the_end_of_the_duration(world: OuterWorld) -> None:
    drive = driving(world, "--duration", "12")
    children = drive.children()
    assert until(lambda: world.stands() or not all(map(alive, children)), patience_s=40)
    assert world.stands()
    row = drive.row()
    assert (row["returncode"], row["reasons"]) == (0, [])
    stopped_in_its_lane(world)
    assert not any(map(alive, children))


def test_a_second_signal_stops_the_car_harder_and_still_before_the_end(world: OuterWorld) -> None:
    drive = driving(world)
    children = drive.children()
    drive.popen.send_signal(signal.SIGTERM)
    drive.popen.send_signal(signal.SIGINT)
    assert until(lambda: drive.popen.poll() is not None, patience_s=30)
    stopped_in_its_lane(world)
    assert min(truth.longitudinal_accel_mps2 for truth in world.seen) < -2.5
    assert not any(map(alive, children))


def test_the_limiter_stops_the_car_when_the_launcher_is_killed(world: OuterWorld) -> None:
    drive = driving(world)
    children = drive.children()
    os.kill(drive.popen.pid, signal.SIGKILL)
    assert until(lambda: world.stands() or not any(map(alive, children)), patience_s=20)
    assert world.stands()
    stopped_in_its_lane(world)
    assert until(lambda: not any(map(alive, children)), patience_s=5)
    drive.popen.communicate()
