"""Live drives with real processes: driving, stopping at the loss of any process, ending all processes."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from process_rig import alive, until

from trepid.config import ROOT
from trepid.recording.reader import read_recording
from trepid.topics import VEHICLE_STATE

PROCESSES = ("vehicle", "camera", "cv", "cnn", "lead", "supervisor", "controller", "recorder", "page")
# A quarter of the kilometre: painting all of it takes a second.
SHORT_ROAD = ("--scenario", "straight", "--set", "segments=[{length_m: 250}]", "--set", "distance_m=200")
STARVED_MS = 90.0  # three times the duration on two idle cores; with its tail no frame is fresh
LATE_MS = 40.0  # a period of the camera; on two idle cores one frame in a hundred takes half of it
STALLED_MS = 250.0  # six frames; half a second of silence is a lost process, for which a stop is final
pytestmark = pytest.mark.processes


class LiveDrive:
    """A `trepid drive --json` that runs during the test."""

    started: ClassVar[list["LiveDrive"]] = []

    def __init__(self, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "trepid", "drive", "--json", *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.started.append(self)

    def reaches(self, speed_mps: float) -> bool:
        """Read the status lines until the car drives at ``speed_mps``: False if it stopped for good before.

        Skips where frames take so long on this machine that the car rightly stands.
        """
        assert self.popen.stderr is not None
        lines = []
        for line in self.popen.stderr:
            lines.append(line)
            found = re.search(r"speed +([0-9.]+) m/s", line)
            if found and float(found[1]) >= speed_mps:
                return True
            if "STOP" in line and " starting: " not in line:
                self.popen.send_signal(signal.SIGINT)
                break
        out, err = self.popen.communicate(timeout=90)
        latency = json.loads(out)["latency_ms"]["frame_to_command"] if out.startswith("{") else None
        frame_to_command = latency or {}
        if frame_to_command.get("p50", 0.0) > STARVED_MS:
            pytest.skip(f"frames take {frame_to_command['p50']:.0f} ms to the command on this machine")
        if frame_to_command.get("max", 0.0) > STALLED_MS:
            return False
        pytest.fail(f"the drive ended before {speed_mps} m/s: {''.join(lines[-5:])} {out} {err}")

    def pids(self) -> dict[str, int]:
        """Process ids by name, from the command lines of the children."""
        pids = {}
        for path in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
                arguments = (path / "cmdline").read_text().split("\0")
            except (FileNotFoundError, ProcessLookupError):
                continue  # it ended during the search
            if parent == self.popen.pid and "-m" in arguments:
                pids[json.loads(arguments[3])["name"]] = int(path.name)
        return pids

    def result(self, *, patience_s: float = 40) -> tuple[int, dict]:
        out, err = self.popen.communicate(timeout=patience_s)
        assert "Traceback" not in err
        return self.popen.returncode, json.loads(out)


@pytest.fixture(autouse=True)
def _ends_what_a_test_left() -> Iterator[None]:
    yield
    while LiveDrive.started:
        drive = LiveDrive.started.pop()
        if drive.popen.poll() is None:
            drive.popen.send_signal(signal.SIGINT)
            drive.popen.communicate(timeout=20)


def driving(speed_mps: float, *arguments: str) -> LiveDrive:
    """A drive that has come to ``speed_mps``; another is tried where this machine stalled its processes."""
    for _ in range(4):
        drive = LiveDrive(*arguments)
        if drive.reaches(speed_mps):
            return drive
    pytest.skip("this machine stalls processes for so long that the car rightly stops for good")


def all_gone(pids: list[int], *, patience_s: float) -> bool:
    return until(lambda: not any(map(alive, pids)), patience_s=patience_s)


@pytest.mark.smoke
def test_a_short_drive_keeps_the_lane_with_every_process_alive() -> None:
    returncode, row = LiveDrive("--duration", "12").result()
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 20
    assert set(row["processes"]) == set(PROCESSES)
    assert all(process["restarts"] == 0 for process in row["processes"].values())
    assert row["latency_ms"]["frame_to_command"]["p50"] > 0


def drive_with_harm(harm: signal.Signals, name: str) -> tuple[int, int, dict]:
    """A drive of which one process is harmed: that process's id, the exit code and the row of the drive."""
    drive = driving(2.0, *SHORT_ROAD)
    pids = drive.pids()
    os.kill(pids[name], harm)
    returncode, row = drive.result()
    assert all_gone(list(pids.values()), patience_s=2)
    return pids[name], returncode, row


@pytest.mark.parametrize("name", ["camera", "cv", "cnn", "supervisor", "controller"])
def test_the_car_stops_when_a_process_is_killed(name: str) -> None:
    pid, returncode, row = drive_with_harm(signal.SIGKILL, name)
    assert returncode == 1 and names_the_kill(row, name, pid)
    assert row["final_speed_mps"] < 0.05
    assert any("the car stopped" in why for why in row["reasons"])


def names_the_kill(row: dict, name: str, pid: int) -> bool:
    """Whether the row of a drive gives one killed process as a reason, this one, and no harm to the car."""
    (killed,) = [why for why in row["reasons"] if "killed" in why]
    unharmed = row["departures"] == row["interventions"] == 0
    return unharmed and killed.startswith(f"process {name} (pid {pid}) was killed by SIGKILL")


@pytest.mark.parametrize("name", ["cv", "supervisor"])
def test_the_car_stops_when_a_process_freezes(name: str) -> None:
    _, returncode, row = drive_with_harm(signal.SIGSTOP, name)
    assert returncode == 1
    assert any(f"process {name} was silent" in why for why in row["reasons"])
    assert row["departures"] == row["interventions"] == 0
    assert row["final_speed_mps"] < 0.05


def test_two_drives_on_one_machine_do_not_receive_each_others_messages() -> None:
    """One loses its vehicle, with which the simulated car itself is gone; the other drives on until a signal."""
    one, other = LiveDrive(*SHORT_ROAD), LiveDrive(*SHORT_ROAD)
    assert one.reaches(0.0)
    assert other.reaches(0.0)
    pids, others = one.pids(), other.pids()
    os.kill(pids["vehicle"], signal.SIGKILL)
    returncode, row = one.result()
    assert returncode == 1 and names_the_kill(row, "vehicle", pids["vehicle"])
    assert all_gone(list(pids.values()), patience_s=2)
    assert set(others) == set(PROCESSES) and all(map(alive, others.values()))
    os.kill(other.popen.pid, signal.SIGINT)
    assert all_gone(list(others.values()), patience_s=2)
    returncode, row = other.result()
    assert returncode == 1
    assert "stopped by SIGINT" in row["reasons"]
    assert not any("process" in why for why in row["reasons"])


SETTABLE_CLOCK = """
import pathlib, time
real_s, real_ns, by_s = time.time, time.time_ns, lambda: float(pathlib.Path({path!r}).read_text())
time.time = lambda: real_s() + by_s()
time.time_ns = lambda: real_ns() + int(1e9 * by_s())
"""


def test_a_wall_clock_that_is_set_forward_and_back_changes_neither_the_drive_nor_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_s, recording = tmp_path / "by_s", tmp_path / "drive.mcap"
    by_s.write_text("0.0")
    (tmp_path / "sitecustomize.py").write_text(SETTABLE_CLOCK.format(path=str(by_s)))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    began_s = time.time()
    drive = driving(2.0, *SHORT_ROAD, "--duration", "14", "--record", str(recording))
    by_s.write_text("3600.0")
    assert drive.reaches(4.0)
    by_s.write_text("-3600.0")
    _, row = drive.result()
    assert row["departures"] == row["interventions"] == 0
    assert all(process["restarts"] == 0 for process in row["processes"].values())
    recorded = read_recording(recording, VEHICLE_STATE.key)
    arrivals = np.array([(at_s, state.t_s, state.speed_mps) for at_s, state in recorded.of(VEHICLE_STATE)])
    assert recorded.complete and began_s < arrivals[0, 0] < arrivals[-1, 0] < time.time()
    assert (np.diff(arrivals[:, 1]) >= 0).all() and np.abs(arrivals[:, 0] - arrivals[:, 1]).max() < 1.0
    assert arrivals[-1, 2] > 2.0, "it drove on"


def test_a_process_that_the_scenario_loses_stops_the_car_and_is_no_failure_of_the_drive() -> None:
    returncode, row = LiveDrive("--scenario", "lost_cv", "--set", "duration_s=20").result(patience_s=70)
    assert (returncode, row["reasons"]) == (0, [])
    assert row["causes"]["lost_estimator"] > 1.0
    assert (row["final_speed_mps"], row["processes"]["cv"]["restarts"]) == (0.0, 0)


def test_a_drive_without_frames_names_them_in_its_status_line_and_in_its_summary() -> None:
    blind = "faults=[{kind: lost_process, process: camera, from_s: 0}]"
    drive = LiveDrive("--scenario", "straight", "--set", blind, "--set", "expect={}", "--duration", "6")
    out, err = drive.popen.communicate(timeout=70)
    begun = r"\w+ ?\w*: no new image; waits for a restart of the drive"  # the car had begun to move before
    waits = rf"(starting: waits for frames of the camera \((none so far|none for [0-9.]+ s)\)|{begun})"
    assert re.fullmatch(waits, json.loads(out)["waits_for"])
    assert re.search(rf"STOP  fear 1.00 very_high[^\n]*?  {waits}", err)


def test_a_driver_hands_over_a_live_car_at_speed() -> None:
    """The driver hands over at t = 0, whatever the inputs are; where they come late until then, the car waits."""
    for _ in range(4):
        returncode, row = LiveDrive("--scenario", "leader_brakes", "--duration", "4").result(patience_s=60)
        latency_ms = row["latency_ms"]["frame_to_command"]
        if returncode == 0 or (latency_ms is not None and latency_ms["p99"] < LATE_MS):
            break
    else:
        pytest.skip("frames come late to the command on this machine")
    assert (returncode, row["reasons"]) == (0, []), row["waits_for"]
    assert row["distance_m"] > 4 * 5.0
    assert "STOP" not in row["modes"] or row["modes"]["STOP"] < 0.2
