"""``trepid doctor``: each check judges what it measured, and a failed one says what to do."""

import json
import socket
import sys
from pathlib import Path

import pytest

from cockpit.car import checks, devices, machine
from cockpit.car import cli as doctor_cli
from cockpit.car.finding import Finding
from cockpit.car.init import Like, write_car
from trepid.cli import main
from trepid.config import CAR, ROOT, InputError
from trepid.processes.settings import load_processes
from vehicle.keys.certificates import create

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
    def intruder() -> None:
        raise InputError("package 'controller' is imported from elsewhere")

    monkeypatch.setattr(checks, "check_packages", intruder)
    assert not checks.packages().ok


def test_a_wrong_field_of_the_car_is_found_with_its_place(car: Path) -> None:
    edit(car / "limiter.yaml", "#standstill_mps: 0.05", "standstil_mps: 0.05")
    found = checks.configuration()
    assert not found.ok
    assert f"{car}/limiter.yaml:" in found.message
    assert "did you mean 'standstill_mps'?" in found.message


def test_every_wrong_file_counts(car: Path) -> None:
    edit(car / "vehicle.yaml", "#track_m: 1.40", "track_m: -1")
    edit(car / "camera.yaml", "#fx_px: 190.0", "fx_px: 0")
    edit(car / "fear.yaml", "rules:\n", "rules:\n  - if moon is high then fear is low\n")
    edit(car / "drive.yaml", "#silence_s: 3.0", "silence_s: [")
    faults = checks.configuration().message.split("; ")
    assert [any(fault.startswith(f"{car}/{name}:") for fault in faults) for name in FOUR] == [True] * 4


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


def test_a_silent_camera_and_a_silent_car_say_why() -> None:
    assert "unplugged" in devices.judged_camera("v4l2", [], None, "unplugged").message
    assert "bus-off" in devices.judged_actuator("can", False, "bus-off").message
    assert devices.judged_actuator("can", True, "").ok


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
