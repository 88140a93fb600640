"""`trepid status` reads the launcher's report of a running drive and names the culprit."""

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cockpit.status.attach import PROCESS, states
from trepid.bus import free_endpoint, open_bus
from trepid.cli import app
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import InputError
from trepid.messages import Diagnostic, Health
from trepid.processes.register import Running, registered, ticks
from trepid.processes.settings import LAUNCHER
from trepid.topics import DIAGNOSTICS

WELL = dict(
    name="cv", pid=7, alive=True, rate_hz=25.0, age_s=0.4, cpu_percent=9.0, restarts=0, message="",
    health="ok", heartbeat=True,
)  # fmt: skip


def report(*rows: dict[str, Any]) -> Diagnostic:
    values = tuple((f"{PROCESS}{row['name']}", json.dumps(row)) for row in rows)
    return Diagnostic(t_s=1.0, process=LAUNCHER, health=Health.OK, message="driving", values=values)


@pytest.fixture
def register(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture
def launcher(register: None) -> Iterator[list[Diagnostic]]:
    """A launcher that publishes the reports in the list again and again."""
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    drive = Running(
        pid=os.getpid(),
        started_ticks=ticks(os.getpid()) or 0,
        vehicle_name="car",
        endpoint=endpoint,
        clock_offset_ns=offset_ns,
        car=None,
        what="circuit",
    )
    reports: list[Diagnostic] = []
    done = threading.Event()
    with open_bus("car", epoch_clock(offset_ns), listen=endpoint) as bus, registered(drive):
        send = bus.publisher(DIAGNOSTICS)

        def publish() -> None:
            while not done.wait(0.05):
                for message in reports:
                    send(message)

        thread = threading.Thread(target=publish)
        thread.start()
        yield reports
        done.set()
        thread.join()


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
    monkeypatch.setattr("cockpit.status.attach.PATIENCE_S", 0.3)
    with pytest.raises(InputError, match="sent no report for"):
        CliRunner().invoke(app, ["status"], standalone_mode=False, catch_exceptions=False)
