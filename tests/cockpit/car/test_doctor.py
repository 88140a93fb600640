"""``trepid doctor``: each check judges what it measured, and a failed one says what to do."""

import json
import os
import re
import socket
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest
from driving_network_rig import write_network
from segment_rig import write_network_of_car

from cockpit.car import checks, devices, machine
from cockpit.car import cli as doctor_cli
from cockpit.car.checks import Finding
from cockpit.car.init import Like, write_car
from trepid import plugins
from trepid.cli import main
from trepid.config import CAR, ROOT, InputError
from trepid.messages import VehicleState
from trepid.processes.settings import ProcessSpec, load_processes
from vehicle.cameras.source import SourceContext
from vehicle.certificates import create

FOUR = ("vehicle.yaml", "camera.yaml", "fear.yaml", "drive.yaml")
NOW_S = 1_790_000_000.0


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_car(tmp_path / "mycar", Like.SIM)
    monkeypatch.setenv(CAR, str(tmp_path / "mycar"))
    return tmp_path / "mycar"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_the_packages_settings_models_and_endpoint_of_this_checkout_are_in_order() -> None:
    for check in (checks.packages, checks.configuration, checks.models, checks.endpoint):
        assert check().ok, check().message


def test_an_intruding_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def intruder(*, wholly: bool) -> None:
        raise InputError("package 'controller' is imported from elsewhere")

    monkeypatch.setattr(checks, "check_packages", intruder)
    assert not checks.packages().ok


def test_a_wrong_field_of_the_car_is_found_with_its_place(car: Path) -> None:
    edit(car / "limiter.yaml", "#max_step_s: 0.05", "max_stp_s: 0.05")
    found = checks.configuration()
    assert not found.ok
    assert f"{car}/limiter.yaml:" in found.message
    assert "did you mean 'max_step_s'?" in found.message


def test_every_wrong_file_counts(car: Path) -> None:
    edit(car / "vehicle.yaml", "#track_m: 1.40", "track_m: -1")
    edit(car / "camera.yaml", "#fx_px: 190.0", "fx_px: 0")
    edit(car / "fear.yaml", "rules:\n", "rules:\n  - if moon is high then fear is low\n")
    edit(car / "drive.yaml", "#silence_s: 3.0", "silence_s: [")
    faults = checks.configuration().message.split("; ")
    assert [any(fault.startswith(f"{car}/{name}:") for fault in faults) for name in FOUR] == [True] * 4


@pytest.mark.parametrize(
    ("name", "text", "place"),
    [
        ("drive.yaml", "silence_s: -1\n", ":1:1: silence_s: "),
        ("drive.yaml", "vehicle_name: a/b\n", ":1:1: vehicle_name: "),
        ("driver.yaml", "timeout_s: soon\n", ":1:1: timeout_s: "),
        ("lead.yaml", "detector: [a]\n", ":1:1: detector: "),
        ("ros.yaml", "domain: 300\n", ":1:1: domain: "),
    ],
)
def test_a_file_that_only_some_processes_read_counts_too(car: Path, name: str, text: str, place: str) -> None:
    (car / name).write_text(text)
    found = checks.configuration()
    assert not found.ok and f"{car}/{name}{place}" in found.message


def test_a_missing_network_of_a_process_is_found(car: Path) -> None:
    entry = "{module: perception.node, options: {estimator: mine, network: turn.onnx}}"
    (car / "processes.yaml").write_text(f"processes: {{mine: {entry}}}\n")
    found = checks.models()
    assert not found.ok and "turn.onnx" in found.message
    write_network(car / "turn.onnx")
    assert "mine starts (turn.onnx)" in checks.models().message


def garble_description(car: Path) -> None:
    edit(car / "networks" / "mine.yaml", "licence:", "lisence:")


def cut_network(car: Path) -> None:
    content = (car / "colours.onnx").read_bytes()
    (car / "colours.onnx").write_bytes(content[: len(content) // 2])


def rename_output(car: Path) -> None:
    edit(car / "networks" / "mine.yaml", "output: area", "output: road")


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (garble_description, r".*/networks/mine\.yaml:3:1: .*lisence.*did you mean 'licence'"),
        (cut_network, r".*/colours\.onnx: not an ONNX network, or cut off"),
        (rename_output, r".*/colours\.onnx: has no output 'road'; it has lines, area"),
        (lambda car: (car / "colours.onnx").unlink(), r".*/colours\.onnx: no such file"),
    ],
)
def test_a_damaged_network_of_segments_or_its_description_is_found_in_one_line(
    car: Path, damage: Callable[[Path], None], fault: str
) -> None:
    write_network_of_car(car)
    entry = "{module: perception.node, options: {estimator: segments}}"
    (car / "processes.yaml").write_text(f"processes: {{segments: {entry}}}\n")
    assert "segments starts" in checks.models().message
    damage(car)
    found = checks.models()
    assert not found.ok and re.match(fault, found.message) and "\n" not in found.message


def test_damaged_weights_are_found(car: Path) -> None:
    folder = car / "perception" / "weights"
    folder.mkdir(parents=True)
    for suffix in (".onnx", ".json"):
        shipped = (ROOT / "perception" / "weights" / "steer_net").with_suffix(suffix).read_bytes()
        (folder / f"steer_net{suffix}").write_bytes(shipped)
    assert checks.models().ok
    damaged = bytearray((folder / "steer_net.onnx").read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (folder / "steer_net.onnx").write_bytes(damaged)
    found = checks.models()
    assert not found.ok
    assert "sha256 differs" in found.message


def test_a_private_key_of_any_process_that_others_may_read_is_found(car: Path) -> None:
    (car / "security.yaml").write_text("keys: keys\n")
    create(car / "keys", ["launcher", *(spec.name for spec in load_processes())])
    assert checks.endpoint().ok
    (car / "keys" / "controller.key").chmod(0o644)
    found = checks.endpoint()
    assert not found.ok
    assert "controller.key: others may read this private key" in found.message


def test_an_endpoint_in_use_is_found(car: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        (car / "security.yaml").write_text(f"listen: 127.0.0.1:{port}\n")
        found = checks.endpoint()
    assert not found.ok
    assert f"127.0.0.1:{port}" in found.message
    assert checks.endpoint().ok


def test_missing_keys_are_found(car: Path) -> None:
    (car / "security.yaml").write_text("keys: keys\n")
    found = checks.endpoint()
    assert not found.ok
    assert "trepid keys create" in found.message


@pytest.mark.parametrize(
    ("source", "step_s", "epoch_s", "synchronised", "ok"),
    [
        ("tsc", 0.0, NOW_S, True, True),
        ("tsc", 0.0, NOW_S, False, True),
        ("tsc", 0.0, NOW_S, None, True),
        ("hpet", 0.0, NOW_S, True, False),
        ("tsc", 0.5, NOW_S, True, False),
        ("tsc", -0.5, NOW_S, True, False),
        ("tsc", 0.0, 86_400.0, True, False),
    ],
)
def test_a_slow_a_stepping_and_an_unset_clock_fail(
    source: str, step_s: float, epoch_s: float, synchronised: bool | None, ok: bool
) -> None:
    found = machine.judged_clock(source, step_s, epoch_s, synchronised)
    assert found.ok == ok
    assert found.remedy or synchronised is not False


@pytest.mark.parametrize(
    ("count", "load", "ok", "advised"),
    [(2, 0.5, True, False), (1, 0.0, False, True), (2, 1.5, True, True), (2, 2.5, False, True)],
)
def test_too_few_and_loaded_cores_fail(count: int, load: float, ok: bool, advised: bool) -> None:
    found = machine.judged_cores(count, load)
    assert (found.ok, bool(found.remedy)) == (ok, advised)


@pytest.mark.parametrize(
    ("free", "speed_mbps", "ok"),
    [(9e9, 100.0, True), (9e9, 5.0, False), (1e6, None, False), (1e9, 50.0, False)],
)
def test_a_full_and_a_slow_disk_fail(free: float, speed_mbps: float | None, ok: bool) -> None:
    assert machine.judged_disk(Path(), int(free), speed_mbps).ok == ok


def test_the_disk_of_the_last_minutes_is_measured_without_making_their_folder(
    car: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    found = machine.ring()
    assert found.check == "ring" and str(tmp_path) in found.message
    assert not (tmp_path / "state").exists()
    (car / "drive.yaml").write_text("ring: {max_mb: 1e9}\n")
    found = machine.ring()
    assert (found.ok, found.remedy) == (False, "free 1000000.0 GB, or record to another disk")
    (car / "drive.yaml").write_text("ring: {max_mb: 0}\n")
    assert machine.ring().ok
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/no/state")
    (car / "drive.yaml").write_text("")
    assert not machine.ring().ok


def test_the_disk_is_measured_and_nothing_stays_there(tmp_path: Path) -> None:
    assert "MB/s" in machine.disk(tmp_path).message or not machine.disk(tmp_path).ok
    assert list(tmp_path.iterdir()) == []
    assert not machine.disk(tmp_path / "missing").ok


def test_the_clock_of_this_machine_is_measured() -> None:
    assert machine.clock().check == "clock"
    assert "unknown" in machine.clock().message or machine.CLOCK_SOURCE.is_file()


def test_a_missing_real_time_permission_is_advice() -> None:
    assert machine.judged_real_time(permitted=False).ok
    assert machine.judged_real_time(permitted=False).remedy


def test_the_permission_has_to_reach_the_highest_priority_of_the_car(monkeypatch: pytest.MonkeyPatch) -> None:
    specs = [ProcessSpec("controller", options={"realtime": 20}), ProcessSpec("cv")]
    monkeypatch.setattr(machine, "load_processes", lambda: specs)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    for limit, permitted in ((10, False), (20, True)):
        monkeypatch.setattr(machine.resource, "getrlimit", lambda _, limit=limit: (limit, limit))
        assert machine.real_time() == machine.judged_real_time(permitted)


@pytest.mark.parametrize("healthy", [True, False])
def test_a_failed_check_gives_exit_code_1_and_json_has_its_fields(
    healthy: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = (Finding("a", True, "fine"), Finding("b", healthy, "half a lens", "wipe it"))
    monkeypatch.setattr(doctor_cli, "CHECKS", [lambda one=one: one for one in found])
    monkeypatch.setattr(sys, "argv", ["trepid", "doctor", "--json"])
    assert main() == (0 if healthy else 1)
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows[1] == {"check": "b", "ok": healthy, "message": "half a lens", "remedy": "wipe it"}
    monkeypatch.setattr(sys, "argv", ["trepid", "doctor"])
    main()
    assert "-> wipe it" in capsys.readouterr().out


def test_a_fault_that_stops_several_checks_is_said_once_by_the_first(car: Path) -> None:
    (car / "vehicle.yaml").write_text("wheelbase_m: -1\n")
    failed = [finding for finding in doctor_cli.findings() if "wheelbase_m" in finding.message]
    assert [finding.check for finding in failed] == ["configuration"]


def test_the_simulated_car_needs_neither_camera_nor_actuator() -> None:
    assert "simulated" in devices.camera().message
    assert "simulated" in devices.actuator().message
    assert devices.processes().ok


def test_a_program_that_does_not_exist_is_found(car: Path) -> None:
    (car / "processes.yaml").write_text("processes:\n  horn: {module: horn.node}\n")
    found = devices.processes()
    assert not found.ok
    assert f"{car}/processes.yaml:2:" in found.message


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("vehicle: null", "no process publishes vehicle/state"),
        ("cv: {together: camera}", ":1:18: process cv: together: camera: the shared process needs a name"),
        ("camera: {module: vehicle.cameras.node}", "the embedded detector is trained on drawn vehicles"),
        (
            "camera: null, vehicle: {module: vehicle.actuators.node}, cv: null, cnn: null, lead: null",
            "no process publishes an estimate of the lane",
        ),
    ],
)
def test_processes_that_make_no_drive_are_found(car: Path, text: str, problem: str) -> None:
    (car / "processes.yaml").write_text(f"processes: {{{text}}}\n")
    found = devices.processes()
    assert not found.ok and problem in found.message


@pytest.mark.parametrize("like", Like)
def test_the_processes_of_every_template_make_a_drive(
    like: Like, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_car(tmp_path / "car", like)
    monkeypatch.setenv(CAR, str(tmp_path / "car"))
    for check in (checks.configuration, checks.models, devices.processes):
        assert check().ok, check().message


@pytest.mark.parametrize(
    ("count", "period_s", "rate_hz", "ok"),
    [
        (50, 0.04, 25.0, True),
        (50, 0.04, None, True),
        (50, 0.04, 60.0, False),
        (10, 0.2, None, False),
        (1, 0, 1, False),
    ],
)
def test_a_camera_below_its_rate_fails(count: int, period_s: float, rate_hz: float | None, ok: bool) -> None:
    found = devices.judged_camera("v4l2", [k * period_s for k in range(count)], rate_hz, "")
    assert (found.ok, bool(found.remedy)) == (ok, not ok)


def with_camera(car: Path, source: str) -> None:
    (car / "processes.yaml").write_text("processes: {camera: {module: vehicle.cameras.node}}\n")
    (car / "camera_source.yaml").write_text(source)


def test_a_camera_gets_the_clock_of_a_drive(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stamps of a topic of ROS 2 are compared with it."""
    now_s: list[float] = []

    def build(drive: SourceContext) -> None:
        now_s.append(drive.now_s())
        raise InputError("no camera here")

    monkeypatch.setattr("vehicle.cameras.table.build", build)
    with_camera(car, "source: ros2\nros2: {key: 0/image/**, connect: tcp/127.0.0.1:7447}\n")
    assert "no camera here" in devices.camera().message
    assert now_s == [pytest.approx(time.time(), abs=60.0)]


BROKEN = """
from trepid.config import Settings

class Thermal:
    class Settings(Settings):
        pass

    def __init__(self, *_):
        raise OSError("no licence for the sensor")
"""


@pytest.fixture
def broken_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package whose camera and estimator cannot begin."""
    (tmp_path / "thermal_package.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(tmp_path)
    kinds = (plugins.Group.CAMERAS, plugins.Group.ESTIMATORS)
    points = {group: [EntryPoint("thermal", "thermal_package:Thermal", group)] for group in kinds}
    monkeypatch.setattr(plugins, "entry_points", lambda group: points.get(group, []))
    plugins.added_entry_points.cache_clear()
    yield
    plugins.added_entry_points.cache_clear()


def test_trouble_with_a_part_of_another_package_has_that_package_as_remedy(
    car: Path, broken_package: None
) -> None:
    with_camera(car, "source: thermal\nthermal: {}\n")
    camera = devices.camera()
    assert not camera.ok and "'thermal': cannot begin: OSError: no licence" in camera.message
    assert "the package thermal_package adds thermal" in camera.remedy and "v4l2" not in camera.remedy
    line = "processes: {thermal: {module: perception.node, options: {estimator: thermal}}}\n"
    (car / "processes.yaml").write_text(line)
    models = checks.models()
    assert not models.ok and "trepid.estimators 'thermal': cannot begin" in models.message
    assert "thermal_package" in models.remedy and "install Trepid" not in models.remedy


def test_a_topic_on_the_bus_of_a_drive_is_no_fault_before_the_drive(car: Path) -> None:
    with_camera(car, "source: ros2\nros2: {key: 0/image/**}\n")
    found = devices.camera()
    assert found.ok and "0/image/** is on the bus of a drive" in found.message
    with_camera(car, "source: ros2\nros2: {stamp: now}\n")
    assert not devices.camera().ok


def test_a_silent_camera_and_a_silent_car_say_why() -> None:
    assert "unplugged" in devices.judged_camera("v4l2", [], None, "unplugged").message
    assert "bus-off" in devices.judged_actuator("can", False, "bus-off").message
    assert devices.judged_actuator("can", True, "").ok


@pytest.mark.parametrize(
    ("speed_mps", "angle_rad", "ok"), [(None, 0.0, False), (0.0, None, False), (0.0, 0.0, True)]
)
def test_a_car_that_reports_no_speed_or_no_wheel_angle_is_found(
    car: Path,
    monkeypatch: pytest.MonkeyPatch,
    speed_mps: float | None,
    angle_rad: float | None,
    ok: bool,
) -> None:
    """Such as a servo board whose sensor is silent."""
    state = VehicleState(
        t_s=0.0,
        speed_mps=speed_mps,
        road_wheel_angle_rad=angle_rad,
        yaw_rate_radps=None,
        driver_override=False,
    )
    wire = SimpleNamespace(read=lambda *, now_s: state, close=lambda: None)
    monkeypatch.setattr("vehicle.actuators.table.build", lambda car: ("serial", wire))
    monkeypatch.setattr(devices, "REPORT_S", 0.05)
    (car / "processes.yaml").write_text("processes: {vehicle: {module: vehicle.actuators.node}}\n")
    (car / "actuator.yaml").write_text("actuator: serial\n")
    assert devices.actuator().ok == ok


def test_an_actuator_whose_device_is_missing_is_found(car: Path) -> None:
    (car / "processes.yaml").write_text(
        "processes:\n  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state]}\n"
    )
    (car / "actuator.yaml").write_text(
        "actuator: can\ncan: {interface: socketcan, channel: can77, map: map.yaml}\n"
    )
    found = devices.actuator()
    assert not found.ok
    assert found.remedy


@pytest.mark.parametrize(
    ("file", "field"),
    [
        ("limiter.yaml", "standstill_mps"),
        ("supervisor.yaml", "modes: {standstill_mps"),
        ("controller.yaml", "speed: {standstill_mps"),
        ("drive.yaml", "standstill_mps"),
    ],
)
def test_a_standstill_outside_the_vehicle_file_is_refused_with_its_new_place(
    car: Path, file: str, field: str
) -> None:
    (car / file).write_text(f"{field}: 0.02{'}' * field.count('{')}\n")
    found = checks.configuration()
    assert not found.ok
    assert f"{car / file}:1:" in found.message
    assert "is now standstill_mps of vehicle.yaml" in found.message
