"""The whole drive through a CAN bus: camera to ECU, over real processes and a bus between processes."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import can
import can_rig
import pytest
from process_rig import alive, until

from trepid.config import ROOT

pytestmark = pytest.mark.processes
GROUP = "239.74.163.2"
PLACE = re.compile(r" at +([0-9.]+) m .* speed +([0-9.]+) m/s")
STATION = re.compile(r" at +([0-9.]+) m ")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


class CanCar:
    """The folder of a car on a CAN bus of its own, whose far end is the simulated ECU."""

    def __init__(self, folder: Path, **options):
        self.folder, self.bus_options = folder, dict(port=free_port(), hop_limit=0)
        shutil.copytree(can_rig.FOLDER, folder / "can")
        (folder / "actuator.yaml").write_text(
            f"actuator: can\ncan:\n  interface: udp_multicast\n  channel: {GROUP}\n"
            f"  options: {json.dumps(self.bus_options)}\n  map: can/map.yaml\n"
        )
        (folder / "processes.yaml").write_text(
            "processes:\n"
            "  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state]}\n"
            "  ecu: {module: sim_harness.counterparts.ecu, publishes: [sim/truth], restart: never, "
            f"options: {json.dumps(options)}}}\n"
        )

    def drive(self, duration_s):
        words = ["drive", "--json", "--car", str(self.folder), "--duration", str(duration_s)]
        return subprocess.Popen(
            [sys.executable, "-m", "trepid", *words],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )


@pytest.fixture
def can_car(tmp_path):
    if (why := no_multicast()) is not None:
        pytest.skip(f"no multicast on this machine: {why}")
    return lambda **options: CanCar(tmp_path / "car", **options)


def no_multicast():
    try:
        can.Bus(interface="udp_multicast", channel=GROUP, port=free_port(), hop_limit=0).shutdown()
    except can.CanError as error:
        return error
    return None


@pytest.fixture
def driving():
    """Starts drives and ends what a test left."""
    started = []

    def start(car, duration_s):
        started.append(car.drive(duration_s))
        return started[-1]

    yield start
    for drive in started:
        if drive.poll() is None:
            drive.send_signal(signal.SIGINT)
            drive.communicate(timeout=20)


def reach(drive, speed_mps):
    """Read the status lines until the car has ``speed_mps``."""
    for line in drive.stderr:
        found = PLACE.search(line)
        if found and float(found[2]) >= speed_mps:
            return
    out, _ = drive.communicate(timeout=20)
    pytest.fail(f"the drive ended before {speed_mps} m/s: {out}")


def pid_of(drive, name):
    """Process id of a child of the drive."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
            text = (path / "cmdline").read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if parent == drive.pid and f'"name":"{name}"' in text:
            return int(path.name)
    raise AssertionError(name)


def ended(drive):
    """Exit code, row, and the stations of the status lines that were left to read."""
    out, err = drive.communicate(timeout=60)
    assert "Traceback" not in err
    return drive.returncode, json.loads(out), [float(at) for at in STATION.findall(err)]


def test_the_main_job_drives_through_the_can_bus(can_car, driving):
    returncode, row, _ = ended(driving(can_car(), 20))
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 40
    assert {"vehicle", "ecu", "camera", "controller"} <= set(row["processes"])


def test_the_car_stops_when_the_ecu_reports_nothing_any_more(can_car, driving):
    _, row, stations = ended(driving(can_car(mute_after_s=10), 22))
    assert row["causes"]["vehicle_state_lost"] > 1.0
    assert stations[-1] == stations[-2] > 1.0  # it stands
    assert row["departures"] == row["interventions"] == 0


def test_the_car_stops_while_wrong_counters_are_injected(can_car, driving):
    car = can_car()
    drive = driving(car, 30)
    reach(drive, 3.0)
    foreign = can_rig.SHUTTLE.sender(can_rig.SHUTTLE.settings.commands[0])
    third = can.Bus(interface="udp_multicast", channel=GROUP, **car.bus_options)
    quantities, until_s = can_rig.commanded(can_rig.command(0.5, 1.5)), time.monotonic() + 8
    while time.monotonic() < until_s:
        for _ in range(20):
            data = foreign.frame(quantities)
        third.send(can.Message(arbitration_id=foreign.address, data=data, is_extended_id=False))
        time.sleep(0.003)
    drive.send_signal(signal.SIGINT)
    third.shutdown()
    _, row, _ = ended(drive)
    assert row["final_speed_mps"] < 0.05
    assert row["departures"] == row["interventions"] == 0


def test_the_car_stops_when_the_can_process_is_killed(can_car, driving):
    drive = driving(can_car(), 30)
    reach(drive, 3.0)
    pids = [pid_of(drive, name) for name in ("vehicle", "ecu")]
    os.kill(pids[0], signal.SIGKILL)
    returncode, row, _ = ended(drive)
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
def test_a_map_that_does_not_fit_its_dbc_ends_the_start_with_one_line(can_car, driving, old, new, message):
    car = can_car()
    path = car.folder / "can" / "map.yaml"
    path.write_text(path.read_text().replace(old, new, 1))
    drive = driving(car, 10)
    out, err = drive.communicate(timeout=40)
    assert (drive.returncode, out) == (2, "")
    assert message in err
    assert "Traceback" not in err
