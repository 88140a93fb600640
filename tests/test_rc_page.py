"""The commands of docs/rc.md, from `init` to a drive of the RC car through a simulated board; both boards."""

import json
from pathlib import Path

import pytest
from page_rig import checkout_like, console_blocks, run

pytestmark = pytest.mark.processes
BLOCKS = console_blocks("rc.md")
SETS_UP = 3  # clone, make, activate
INIT, LOCKSTEP = BLOCKS[0][SETS_UP:]
STALLED_MS = 250.0  # six frames


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder like the checkout, with `trepid` on the path."""
    return checkout_like(tmp_path)


def test_the_page_begins_with_a_car_of_this_template() -> None:
    assert INIT.startswith("trepid init myrc --like rc-car")
    assert LOCKSTEP.startswith("trepid sim run circuit --car myrc")


@pytest.mark.parametrize("board", ["pca9685", "serial"])
def test_the_car_of_the_page_drives_its_circuit_through_a_board(work: Path, board: str) -> None:
    copy, bench, drive = BLOCKS[1]
    for command in (INIT, copy, bench.replace("pca9685", board)):
        done = run(command, work)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    done = run(f"{drive} --json", work)
    row = json.loads(done.stdout)
    latency = row["latency_ms"].get("frame_to_command") or {}
    if done.returncode and latency.get("max", 0.0) > STALLED_MS:
        pytest.skip(f"a frame took {latency['max']:.0f} ms to the command on this machine")
    assert (done.returncode, row["reasons"]) == (0, [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 10
    assert {"vehicle", "board", "cv", "arcs"} <= set(row["processes"])
    assert not {"cnn", "lead"} & set(row["processes"])
