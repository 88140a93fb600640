"""The whole drive through a CAN bus: camera to ECU, over real processes and a bus between processes."""

import json
import os
import shutil
import signal
import time

import can
import can_rig
import pytest
from can_bus_rig import GROUP, bus_options
from process_rig import alive, until
from wire_drive_rig import WireDrive

pytestmark = pytest.mark.processes
VEHICLE = "  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state]}\n"
ECU = "  ecu: {module: sim_harness.counterparts.ecu, publishes: [sim/truth], restart: never, options: %s}\n"


@pytest.fixture
def bus():
    """Options of a bus of its own."""
    return bus_options()


@pytest.fixture
def can_car(tmp_path, bus):
    """A car on that bus, whose far end is the simulated ECU with the given options."""
    made = []

    def make(**options):
        shutil.copytree(can_rig.FOLDER, tmp_path / "car" / "can")
        wire = dict(interface="udp_multicast", channel=GROUP, options=bus, map="can/map.yaml")
        actuator = f"actuator: can\ncan: {json.dumps(wire)}\n"
        processes = VEHICLE + ECU % json.dumps(options)
        made.append(WireDrive(tmp_path / "car", actuator=actuator, processes=processes))
        return made[-1]

    yield make
    for drive in made:
        drive.close()


def test_the_main_job_drives_through_the_can_bus(can_car):
    returncode, row, _ = can_car().start(20).ended()
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 40
    assert {"vehicle", "ecu", "camera", "controller"} <= set(row["processes"])


def test_the_car_stops_when_the_ecu_reports_nothing_any_more(can_car):
    _, row, stations = can_car(mute_after_s=10).start(22).ended()
    assert row["causes"]["vehicle_state_lost"] > 1.0
    assert stations[-1] == stations[-2] > 1.0  # it stands
    assert row["departures"] == row["interventions"] == 0


def test_the_car_stops_while_wrong_counters_are_injected(can_car, bus):
    drive = can_car().start(30)
    drive.reach(3.0)
    foreign = can_rig.SHUTTLE.sender(can_rig.SHUTTLE.settings.commands[0])
    third = can.Bus(interface="udp_multicast", channel=GROUP, **bus)
    quantities, until_s = can_rig.command_quantities(can_rig.command(0.5, 1.5)), time.monotonic() + 8
    while time.monotonic() < until_s:
        for _ in range(20):
            data = foreign.frame(quantities)
        third.send(can.Message(arbitration_id=foreign.address, data=data, is_extended_id=False))
        time.sleep(0.003)
    drive.interrupt()
    third.shutdown()
    _, row, _ = drive.ended()
    assert row["final_speed_mps"] < 0.05
    assert row["departures"] == row["interventions"] == 0


def test_the_car_stops_when_the_can_process_is_killed(can_car):
    drive = can_car().start(30)
    drive.reach(3.0)
    pids = [drive.pid(name) for name in ("vehicle", "ecu")]
    os.kill(pids[0], signal.SIGKILL)
    returncode, row, _ = drive.ended()
    assert returncode == 1
    assert any("process vehicle" in why and "SIGKILL" in why for why in row["reasons"])
    assert any("the car stopped" in why for why in row["reasons"])
    assert row["departures"] == row["interventions"] == 0
    assert until(lambda: not any(map(alive, pids)), patience_s=2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "signal: STEER_ANGLE_CMD",
            "signal: STEER_ANGEL",
            "map.yaml:11:10: commands.0.signals.0.signal: STEERING_LTA",
        ),
        ("message: SPEED", "message: SPED", "the DBC has no message 'SPED'; did you mean 'SPEED'?"),
    ],
)
def test_a_map_that_does_not_fit_its_dbc_ends_the_start_with_one_line(can_car, old, new, message):
    car = can_car()
    path = car.folder / "can" / "map.yaml"
    path.write_text(path.read_text().replace(old, new, 1))
    assert message in car.start(10).read_refusal()
