"""`trepid status` reads the launcher's report of a running drive and names the culprit."""

import io
import json
import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from cockpit.attach import PROCESS, states
from cockpit.status_cli import table
from trepid.bus import free_endpoint, open_bus
from trepid.cli import app
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CAR, InputError, use_car
from trepid.messages import Diagnostic, Health
from trepid.processes.register import Running, register_drive, running, ticks
from trepid.security import LAUNCHER, OBSERVER, drive_endpoint, session_settings
from trepid.topics import DIAGNOSTICS
from vehicle.certificates import create

WELL = dict(
    name="cv", pid=7, alive=True, rate_hz=25.0, age_s=0.4, cpu_percent=9.0, restarts=0, message="",
    health="ok", heartbeat=True,
)  # fmt: skip


def report(*rows: dict[str, Any]) -> Diagnostic:
    values = tuple((f"{PROCESS}{row['name']}", json.dumps(row)) for row in rows)
    return Diagnostic(t_s=1.0, process=LAUNCHER, health=Health.OK, message="driving", values=values)


@pytest.fixture
def register(own_register: Path) -> None:
    pass


@contextmanager
def reporting(car: Path | None = None) -> Iterator[list[Diagnostic]]:
    """A launcher that publishes the reports in the list again and again, with the security settings of ``car``."""
    use_car(car)
    offset_ns, endpoint = epoch_offset_ns(), drive_endpoint(free_endpoint())
    secured = session_settings(LAUNCHER, publishes={}, listen=endpoint)
    drive = Running(
        pid=os.getpid(),
        started_ticks=ticks(os.getpid()) or 0,
        vehicle_name="car",
        endpoint=endpoint,
        clock_offset_ns=offset_ns,
        car=str(car) if car else None,
        what="circuit",
    )
    reports: list[Diagnostic] = []
    done = threading.Event()
    with (
        open_bus("car", epoch_clock(offset_ns), listen=endpoint, further=secured) as bus,
        register_drive(drive),
    ):
        send = bus.publisher(DIAGNOSTICS)

        def publish() -> None:
            while not done.wait(0.05):
                for message in reports:
                    send(message)

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            yield reports
        finally:
            done.set()
            thread.join()


@pytest.fixture
def launcher(register: None) -> Iterator[list[Diagnostic]]:
    with reporting() as reports:
        yield reports


@pytest.fixture
def secured_car(register: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A car with keys of its launcher and of observers."""
    monkeypatch.setenv(CAR, "")
    folder = tmp_path / "mycar"
    folder.mkdir()
    (folder / "security.yaml").write_text("keys: keys\n")
    create(folder / "keys", [LAUNCHER, OBSERVER, "cv"])
    return folder


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({}, ""),
        ({"alive": False}, "is not running"),
        ({"age_s": 4.0}, "has been silent for 4.0 s"),
        ({"age_s": None}, "has not reported yet"),
        ({"age_s": None, "heartbeat": False}, ""),
        ({"health": "warn"}, "reports warn"),
    ],
)
def test_a_process_is_judged_by_its_life_its_heartbeat_and_its_health(
    change: dict[str, Any], problem: str
) -> None:
    (state,) = states(report(WELL | change))
    assert state.problem == problem


def test_a_healthy_drive_is_shown_as_json_with_the_fields_of_the_design(launcher: list[Diagnostic]) -> None:
    launcher.append(report(WELL))
    done = CliRunner().invoke(app, ["status", "--json"], standalone_mode=False)
    assert done.return_value == 0
    fields = ("name", "pid", "alive", "rate_hz", "age_s", "cpu_percent", "restarts", "message")
    assert json.loads(done.stdout) == {name: WELL[name] for name in fields}


def test_the_culprit_is_named_and_the_exit_code_is_1(launcher: list[Diagnostic]) -> None:
    launcher.append(report(WELL, WELL | {"name": "cnn", "alive": False, "message": "killed by SIGKILL"}))
    done = CliRunner().invoke(app, ["status"], standalone_mode=False)
    assert done.return_value == 1
    assert done.stderr == "culprit: process cnn is not running: killed by SIGKILL\n"


def test_without_a_drive_one_line_says_so(register: None) -> None:
    with pytest.raises(
        InputError, match=r"^no drive runs on this machine for this user; `trepid drive` starts"
    ):
        CliRunner().invoke(app, ["status"], standalone_mode=False, catch_exceptions=False)


def test_a_launcher_that_does_not_report_is_named(
    launcher: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cockpit.attach.PATIENCE_S", 0.3)
    with pytest.raises(InputError, match="sent no report for"):
        CliRunner().invoke(app, ["status"], standalone_mode=False, catch_exceptions=False)


def test_a_drive_with_keys_is_shown_to_an_observer(
    secured_car: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with reporting(secured_car) as reports:
        assert running()[0].endpoint.startswith("tls/")
        reports.append(report(WELL))
        monkeypatch.setenv(CAR, "")  # status finds the keys by the register
        done = CliRunner().invoke(app, ["status", "--json"], standalone_mode=False)
    assert done.return_value == 0
    assert json.loads(done.stdout)["name"] == "cv"


@pytest.mark.parametrize("mode", [None, 0o644])
def test_without_a_private_key_of_the_observer_one_line_gives_the_remedy(
    secured_car: Path, mode: int | None
) -> None:
    key = secured_car / "keys" / "observer.key"
    if mode is None:
        key.unlink()
    else:
        key.chmod(mode)
    remedy = (
        "`trepid keys create .* --process observer` makes it" if mode is None else f"run `chmod 600 {key}`"
    )
    with reporting(secured_car), pytest.raises(InputError, match=remedy):
        CliRunner().invoke(app, ["status"], standalone_mode=False, catch_exceptions=False)


def test_a_certificate_of_another_authority_hears_nothing(
    secured_car: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cockpit.attach.PATIENCE_S", 1.0)
    create(tmp_path / "foreign", [OBSERVER])
    with reporting(secured_car) as reports:
        reports.append(report(WELL))
        for suffix in ("key", "crt"):
            shutil.copy(tmp_path / "foreign" / f"observer.{suffix}", secured_car / "keys")
        with pytest.raises(InputError):
            CliRunner().invoke(app, ["status"], standalone_mode=False, catch_exceptions=False)


def test_a_message_is_readable_in_80_columns() -> None:
    words = "starting: waits for 2.0 s of fear of at most 0.62 (now 0.81: low_confidence)"
    names = ("supervisor", "controller", "vehicle")
    rows = [WELL | {"name": name, "pid": 1234567, "cpu_percent": 100.0, "message": words} for name in names]
    console = Console(width=80, file=io.StringIO())
    console.print(table(states(report(*rows))))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert max(map(len, shown.splitlines())) <= 80
    at = shown.index("message")
    cells = [line[at:] for line in shown.splitlines()[1:]]
    assert " ".join(" ".join(cells).split()) == " ".join([words] * len(names))
    assert all(name in shown for name in names) and "100.0" in shown
