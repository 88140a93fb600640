"""The whole drive of an RC car through the PCA9685 and through a serial servo board, over real processes."""

import array
import fcntl
import json
import os
import signal
import termios

import pytest
from process_rig import alive, until
from rc_rig import FILE
from vehicle_driver_rig import SETTINGS, axis, button
from wire_drive_rig import WireDrive

pytestmark = pytest.mark.processes
VEHICLE = "  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state]}\n"
CAR = "  car: {module: sim_harness.counterparts.%s, publishes: [sim/truth], restart: never}\n"
DRIVER = "  driver: {module: vehicle.driver.node, publishes: [driver/input]}\n"
STEERING = {**FILE["pca9685"]["steering"], "left_rad": 0.55, "right_rad": 0.55}
THROTTLE = {
    **FILE["pca9685"]["throttle"],
    "most_us": 1900.0,
    "speeds": [[0.0, 1530.0], [4.0, 1630.0], [12.0, 1850.0]],
}
COMMON = {"wait_s": 30.0, "yaw_rate": "modelled", "steering": STEERING, "throttle": THROTTLE}


def rc_drive(tmp_path, kind: str, *, further: str = "", **changed: object) -> WireDrive:
    """The shuttle of the default settings as an RC car on the wire ``kind``."""
    wire = {
        "pca9685": {"bus": f"unix:{tmp_path / 'i2c'}", "speed": "modelled", "speed_lag_s": 0.3},
        "serial": {"port": str(tmp_path / "tty"), "speed": "sensor"},
    }[kind]
    block = {**COMMON, **wire, **changed}
    module = {"pca9685": "pca9685", "serial": "servo_board"}[kind]
    return WireDrive(
        tmp_path / "car",
        actuator=f"actuator: {kind}\n{kind}: {json.dumps(block)}\n",
        processes=VEHICLE + CAR % module + further,
    )


@pytest.fixture
def running():
    """Drives that are ended with the test."""
    drives: list[WireDrive] = []
    yield drives
    for drive in drives:
        drive.close()


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("pca9685", {}),
        ("serial", {"protocol": "ascii"}),
        ("serial", {"protocol": "maestro", "speed": "modelled"}),
    ],
)
def test_the_main_job_drives_through_the_wire(tmp_path, running, kind, changed) -> None:
    running.append(rc_drive(tmp_path, kind, **changed))
    returncode, row, _ = running[0].start(20).ended()
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 30
    assert {"vehicle", "car", "camera", "controller"} <= set(row["processes"])


@pytest.mark.parametrize("kind", ["pca9685", "serial"])
def test_the_car_stops_when_the_actuator_process_is_killed(tmp_path, running, kind) -> None:
    running.append(rc_drive(tmp_path, kind))
    drive = running[0].start(40)
    drive.reach(3.0)
    pid = drive.pid("vehicle")
    os.kill(pid, signal.SIGKILL)
    returncode, row, _ = drive.ended()
    assert returncode == 1
    assert any("process vehicle" in why for why in row["reasons"])
    assert row["final_speed_mps"] < 0.1
    assert row["departures"] == 0
    assert until(lambda: not alive(pid), patience_s=2)


def test_a_released_dead_mans_switch_stops_the_car(tmp_path, running) -> None:
    pad = tmp_path / "js0"
    os.mkfifo(pad)
    end = os.open(pad, os.O_RDWR)
    drive = rc_drive(tmp_path, "serial", further=DRIVER)
    running.append(drive)
    (drive.folder / "driver.yaml").write_text(f"required: true\ndevice: {pad}\n")
    drive.start(40)
    held = SETTINGS.gamepad.dead_man_button
    os.write(end, axis(0, 0.0) + button(held, False))
    assert until(lambda: _read_out(end), patience_s=60)
    os.write(end, button(held, True))
    drive.reach(2.0)
    os.write(end, button(held, False))
    _, row, stations = drive.ended()
    os.close(end)
    assert row["final_speed_mps"] < 0.1
    assert stations[-1] == stations[-2] > 0.5
    assert row["departures"] == 0


def _read_out(end: int) -> bool:
    """The driver process has read what was written."""
    waiting = array.array("i", [0])
    fcntl.ioctl(end, termios.FIONREAD, waiting)
    return waiting[0] == 0
