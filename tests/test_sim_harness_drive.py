"""The main job with real processes: it drives, it stops when any process is lost, it leaves nothing behind."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from trepid.config import ROOT

PROCESSES = ("vehicle", "camera", "cv", "cnn", "lead", "supervisor", "controller")
# A quarter of the kilometre: painting all of it takes a second.
SHORT_ROAD = ("--scenario", "straight", "--set", "segments=[{length_m: 250}]", "--set", "distance_m=200")
STARVED_MS = 90.0  # three times what two idle cores take; with its tail no frame is fresh
pytestmark = pytest.mark.processes


class LiveDrive:
    """A `trepid drive --json` that runs beside the test."""

    def __init__(self, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "trepid", "drive", "--json", *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def wait_for_speed(self, speed_mps: float) -> None:
        """Read the status lines until the car drives at ``speed_mps``."""
        assert self.popen.stderr is not None
        for line in self.popen.stderr:
            found = re.search(r"speed +([0-9.]+) m/s", line)
            if found and float(found[1]) >= speed_mps:
                return
        out, err = self.popen.communicate()
        if (median_ms := starved_ms(out)) is not None:
            pytest.skip(
                f"frames take {median_ms:.0f} ms to the command on this machine: the car rightly stands"
            )
        pytest.fail(f"the drive ended before {speed_mps} m/s: {out} {err}")

    def pids(self) -> dict[str, int]:
        """Process ids by name, from the command lines of the children."""
        pids = {}
        for path in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
                arguments = (path / "cmdline").read_text().split("\0")
            except (FileNotFoundError, ProcessLookupError):
                continue  # it ended while we looked
            if parent == self.popen.pid and "-m" in arguments:
                pids[json.loads(arguments[3])["name"]] = int(path.name)
        return pids

    def result(self, *, patience_s: float = 40) -> tuple[int, dict]:
        out, err = self.popen.communicate(timeout=patience_s)
        assert "Traceback" not in err
        return self.popen.returncode, json.loads(out)


def starved_ms(out: str) -> float | None:
    """Median from frame to command of a drive that never got going on too slow a machine; None of others."""
    if not out.startswith("{"):
        return None
    result = json.loads(out)
    median_ms = result["latency_ms"]["frame_to_command"]["p50"]
    return median_ms if result["duration_s"] > 60 and median_ms > STARVED_MS else None


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def all_gone(pids: list[int], *, patience_s: float) -> bool:
    deadline_s = time.monotonic() + patience_s
    while any(map(running, pids)) and time.monotonic() < deadline_s:
        time.sleep(0.02)
    return not any(map(running, pids))


def test_a_short_drive_keeps_the_lane_with_every_process_alive() -> None:
    returncode, row = LiveDrive("--duration", "12").result()
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 20
    assert set(row["processes"]) == set(PROCESSES)
    assert all(process["restarts"] == 0 for process in row["processes"].values())
    assert row["latency_ms"]["frame_to_command"]["p50"] > 0


def harmed(harm: signal.Signals, *names: str) -> Iterator[tuple[str, dict[str, int], int, dict]]:
    """Several drives at once, one process of each harmed: name, pids, exit code and row of every drive.

    At once because it is faster, and because drives on one machine must not touch each other.
    """
    drives = [LiveDrive(*SHORT_ROAD) for _ in names]
    pids = []
    for drive, name in zip(drives, names, strict=True):
        drive.wait_for_speed(2.0)
        pids.append(drive.pids())
        os.kill(pids[-1][name], harm)
    for drive, name, processes in zip(drives, names, pids, strict=True):
        yield name, processes, *drive.result()
        assert all_gone(list(processes.values()), patience_s=2)


@pytest.mark.parametrize("pair", [("vehicle", "camera"), ("cv", "cnn"), ("supervisor", "controller")])
def test_the_car_stops_when_a_process_is_killed_and_another_car_only_when_its_own_is(
    pair: tuple[str, str],
) -> None:
    for name, pids, returncode, row in harmed(signal.SIGKILL, *pair):
        assert returncode == 1
        (killed,) = [why for why in row["reasons"] if "killed" in why]
        assert killed.startswith(f"process {name} (pid {pids[name]}) was killed by SIGKILL")
        assert row["departures"] == row["interventions"] == 0
        if name != "vehicle":  # with the vehicle process the simulated car itself is gone
            assert row["final_speed_mps"] < 0.05
            assert any("the car stopped" in why for why in row["reasons"])


def test_the_car_stops_when_a_process_freezes() -> None:
    for name, _, returncode, row in harmed(signal.SIGSTOP, "cv", "supervisor"):
        assert returncode == 1
        assert any(f"process {name} was silent" in why for why in row["reasons"])
        assert row["departures"] == row["interventions"] == 0
        assert row["final_speed_mps"] < 0.05


def test_a_process_that_the_scenario_loses_stops_the_car_and_is_no_failure_of_the_drive() -> None:
    sooner = ("faults.0.from_s=5", "expect.must_stop_by_s=15", "duration_s=17")  # fault and stop 3 s earlier
    changes = (word for change in sooner for word in ("--set", change))
    returncode, row = LiveDrive("--scenario", "lost_cv", *changes).result(patience_s=70)
    assert (returncode, row["reasons"]) == (0, [])
    assert row["causes"]["lost_estimator"] > 1.0
    assert (row["final_speed_mps"], row["processes"]["cv"]["restarts"]) == (0.0, 0)


def test_a_driver_hands_over_a_live_car_at_speed() -> None:
    returncode, row = LiveDrive("--scenario", "leader_brakes", "--duration", "4").result(patience_s=60)
    assert (returncode, row["reasons"]) == (0, [])
    assert row["distance_m"] > 4 * 5.0
    assert "STOP" not in row["modes"] or row["modes"]["STOP"] < 0.2


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGHUP, signal.SIGKILL])
def test_no_process_outlives_the_launcher(ending: signal.Signals) -> None:
    drive = LiveDrive(*SHORT_ROAD)
    drive.wait_for_speed(0.0)
    pids = drive.pids()
    assert set(pids) == set(PROCESSES)
    os.kill(drive.popen.pid, ending)
    assert all_gone(list(pids.values()), patience_s=2)
    if ending != signal.SIGKILL:
        returncode, row = drive.result()
        assert returncode == 1
        assert f"stopped by {ending.name}" in row["reasons"]
    drive.popen.communicate(timeout=5)
