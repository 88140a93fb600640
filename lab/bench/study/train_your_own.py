"""The time of the commands of docs/train-your-own.md on a tub of FRAMES frames, which is driven in the simulator.

The driver follows the exact lane of the shipped circuit at 5 mph, as in :mod:`lab.bench.imitation`; the tub
has 20 frames a second, as donkeycar records.
"""

import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lab.bench.imitation.demonstrations import SPEED_MPS, drive_exactly
from learning.dataset.build import built_once
from learning.dataset.dataset import Split
from learning.dataset.export import write_as
from learning.rendered import need_torch
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import ROOT, InputError
from trepid.loudness import note

FRAMES, RATE_HZ = 3000, 20.0
COMMANDS = (
    "trepid dataset build drives mytub --lock-deg 25",
    "trepid train --data drives --model steer --out steer.onnx",
    "trepid evaluate steer.onnx --data drives --picture worst.png",
)
WHOLE = Split(by="time", seed=0, gap_s=0.0, shares={"train": 1.0, "validation": 0.0, "test": 0.0})


def bench_train_your_own(seed: int) -> dict[str, Any]:
    """Times of COMMANDS [min], and the errors on the test frames [deg]. Raises InputError when a command fails."""
    need_torch("bench study train-your-own")
    with TemporaryDirectory(prefix="trepid-tub-") as place:
        folder = Path(place)
        frames = write_drive(folder, FRAMES, seed)
        minutes = {}
        for command in COMMANDS:
            note(command)
            began_s = time.monotonic()
            run(command, folder)
            minutes[command] = (time.monotonic() - began_s) / 60
        row = json.loads(run("trepid evaluate steer.onnx --data drives --json", folder))
    baselines = {name: one["mae_deg"] for name, one in row["baselines"].items()}
    return {
        "time [min]": {**minutes, "together": sum(minutes.values())},
        "mean absolute error of the road wheel [deg]": {"steer": row["mae_deg"], **baselines},
        "frames": {"tub": frames, "tested": row["frames"]},
    }


def write_drive(folder: Path, frames: int, seed: int) -> int:
    """Drive ``frames`` frames and write them as the tub ``mytub`` in ``folder``; their number in the tub."""
    changes = {
        "speed_mps": str(SPEED_MPS),
        "camera.rate_hz": str(RATE_HZ),
        "start.speed_mps": str(SPEED_MPS),
        "distance_m": str(2 * frames / RATE_HZ * SPEED_MPS),  # the time ends the drive
        "duration_s": str(frames / RATE_HZ),
        "estimators": '["cv"]',
    }
    scenario = load_scenario("circuit", changes)
    with recording(folder / "drive.mcap", scenario) as witness:
        drive_exactly(scenario, seed=seed, witness=witness)
    made = built_once(folder / "driven", [folder / "drive.mcap"], WHOLE)
    (folder / "mytub").mkdir()
    return write_as("tub", made, ("train",), folder / "mytub")


def run(command: str, folder: Path) -> str:
    """What a command of Trepid prints, in ``folder``. Raises InputError when it fails."""
    words = [sys.executable, "-m", *shlex.split(command)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{command}: exit code {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout
