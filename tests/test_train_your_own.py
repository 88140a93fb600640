"""The commands of docs/train-your-own.md, in their order, on a small tub."""

import json
from pathlib import Path

import pytest
from drive_rig import write_tub
from page_rig import checkout_like, console_blocks, run

pytest.importorskip("torch", reason="needs pip install 'trepid[train]'")
COMMANDS = [command for block in console_blocks("train-your-own.md") for command in block]
SHORT = " --set stages.0.epochs=4"  # instead of 60: the page trains on thousands of frames


@pytest.mark.processes
def test_three_commands_build_train_and_evaluate_and_the_network_answers_on_frames_and_drives(
    tmp_path: Path,
) -> None:
    verbs = ["dataset", "train", "evaluate", "estimate", "drive"]
    assert [command.split()[1] for command in COMMANDS] == verbs
    folder = checkout_like(tmp_path)
    write_tub(folder / "mytub", frames=300)
    for command in COMMANDS:
        done = run(command + (SHORT if command.startswith("trepid train") else ""), folder)
        unsure = command.startswith("trepid drive") and done.returncode == 1  # on the road of the simulator
        assert done.returncode == 0 or unsure, f"{command}: {done.stderr}"
    if unsure:
        assert "not driven" in done.stdout and "waits for a lane with a confidence" in done.stdout
    assert "process steer" in done.stdout
    assert {"steer.onnx", "steer.md", "worst.png", "seen"} <= {path.name for path in folder.iterdir()}
    judged = run("trepid evaluate steer.onnx --data drives --json", folder)
    row = json.loads(judged.stdout)
    assert row["mae_deg"] < row["baselines"]["always_straight"]["mae_deg"]
