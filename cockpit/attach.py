"""Attach to a running drive and read the launcher's report of all processes."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trepid.bus import open_bus
from trepid.clock import epoch_clock
from trepid.config import use_car
from trepid.messages import Diagnostic, Health
from trepid.processes.register import PROCESS, Running
from trepid.processes.settings import LAUNCHER
from trepid.security import OBSERVER, session_settings
from trepid.topics import DIAGNOSTICS

PATIENCE_S = 3.0  # the launcher reports once a second
LATE_S = 2.5  # an older heartbeat: the process is silent


@dataclass(frozen=True, slots=True)
class State:
    """One process of a drive, as `trepid status --json` prints it, and what is wrong with it."""

    row: dict[str, Any]
    problem: str  # "" when the process is well


def report_of(drive: Running, *, patience_s: float = PATIENCE_S) -> Diagnostic | None:
    """The next report of the launcher; None when it sends none in time. Raises InputError for missing keys."""
    use_car(Path(drive.car) if drive.car else None)  # whose security settings hold
    clock = epoch_clock(drive.clock_offset_ns)
    further = session_settings(OBSERVER, connect=drive.endpoint)
    deadline_s = time.monotonic() + patience_s
    with open_bus(drive.vehicle_name, clock, connect=drive.endpoint, further=further) as bus:
        heard = bus.stream(DIAGNOSTICS)
        while time.monotonic() < deadline_s:
            bus.wait(timeout_s=0.05)
            for message, _ in heard.drain():
                if message.process == LAUNCHER:
                    return message
    return None


def states(report: Diagnostic) -> list[State]:
    """The processes of a report, in the order of the drive."""
    rows = [json.loads(value) for name, value in report.values if name.startswith(PROCESS)]
    return [_judge_row(row) for row in rows]


def _judge_row(row: dict[str, Any]) -> State:
    """``row`` without the fields that only judge it, and its problem."""
    health, beats = row.pop("health"), row.pop("heartbeat")
    problem = ""
    if not row["alive"]:
        problem = "is not running"
    elif beats and row["age_s"] is None:
        problem = "has not reported yet"
    elif beats and row["age_s"] > LATE_S:
        problem = f"has been silent for {row['age_s']:.1f} s"
    elif health in (str(Health.WARN), str(Health.ERROR)):
        problem = f"reports {health}"
    return State(row, problem)
