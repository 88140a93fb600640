"""A drive of a car whose simulated far end is a process behind a wire."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trepid.config import ROOT

PLACE = re.compile(r" at +([0-9.]+) m .* speed +([0-9.]+) m/s")
STATION = re.compile(r" at +([0-9.]+) m ")

STALLED_MS = 250.0  # six frames
OVERLOAD = 3.0  # running programs per core; silences of 0.1 s are then usual


class WireDrive:
    """`trepid drive --json` with the car in ``folder``, which gets these two files."""

    def __init__(self, folder: Path, *, actuator: str, processes: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "actuator.yaml").write_text(actuator)
        (folder / "processes.yaml").write_text("processes:\n" + processes)
        self.folder = folder
        self.popen: subprocess.Popen[str] | None = None

    def start(self, duration_s):
        words = ["drive", "--json", "--car", str(self.folder), "--duration", str(duration_s)]
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "trepid", *words],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        return self

    def reach(self, speed_mps):
        """Read the status lines until the car has ``speed_mps``.

        Skips where this machine stalled the processes for so long that the car rightly stops for good.
        """
        for line in self.popen.stderr:
            found = PLACE.search(line)
            if found and float(found[2]) >= speed_mps:
                return
        out, _ = self.popen.communicate(timeout=20)
        frame_to_command = json.loads(out).get("latency_ms", {}).get("frame_to_command") or {}
        if frame_to_command.get("max", 0.0) > STALLED_MS:
            pytest.skip(f"a frame took {frame_to_command['max']:.0f} ms to the command on this machine")
        load = os.getloadavg()[0] / (os.cpu_count() or 1)
        if load > OVERLOAD:
            pytest.skip(f"this machine has {load:.1f} times the work that it can do")
        pytest.fail(f"the drive ended before {speed_mps} m/s: {out}")

    def pid(self, name):
        """Process id of a child of the drive."""
        for path in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
                text = (path / "cmdline").read_text()
            except (FileNotFoundError, ProcessLookupError):
                continue
            if parent == self.popen.pid and f'"name":"{name}"' in text:
                return int(path.name)
        raise AssertionError(name)

    def interrupt(self):
        self.popen.send_signal(signal.SIGINT)

    def ended(self):
        """Exit code, row, and the stations of the status lines that were left to read."""
        out, err = self.popen.communicate(timeout=60)
        assert "Traceback" not in err
        return self.popen.returncode, json.loads(out), [float(at) for at in STATION.findall(err)]

    def read_refusal(self):
        """The lines on standard error of a drive that does not start."""
        out, err = self.popen.communicate(timeout=40)
        assert (self.popen.returncode, out) == (2, "")
        assert "Traceback" not in err
        return err

    def close(self):
        if self.popen is not None and self.popen.poll() is None:
            self.interrupt()
            self.popen.communicate(timeout=20)
