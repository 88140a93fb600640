"""Recordings and car folders of former versions open in this one, as docs/compatibility.md promises."""

import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

import trepid
from cockpit.replay.rerun import rerun
from drive.check import check_car
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import load_scenario
from trepid.cli import app
from trepid.config import ROOT, using_car
from trepid.processes.settings import load_processes
from trepid.topics import COMMAND, DECISION

VERSIONS = sorted(path for path in (ROOT / "tests" / "kept").iterdir() if (path / "drive.mcap").is_file())


def test_something_of_this_version_is_kept() -> None:
    assert trepid.__version__ in {version.name for version in VERSIONS}


@pytest.mark.parametrize("version", VERSIONS, ids=lambda version: version.name)
def test_a_kept_recording_is_opened_explained_and_exported(version: Path, tmp_path: Path) -> None:
    drive = trepid.open_recording(version / "drive.mcap")
    table = drive.table(rate_hz=10)
    speeds = [speed for speed in table["speed_mps"] if speed is not None]
    assert len(speeds) > 20 and all(map(math.isfinite, speeds)) and max(speeds) > 1.0
    assert 0.0 <= drive.explain(at_s=2.0)["fear"] <= 1.0
    out = tmp_path / "drive.csv"
    assert CliRunner().invoke(app, ["export", str(version / "drive.mcap"), str(out)]).exit_code == 0
    assert len(out.read_text().splitlines()) > 20


@pytest.mark.parametrize("version", VERSIONS, ids=lambda version: version.name)
def test_the_nodes_of_today_run_on_a_kept_recording(version: Path) -> None:
    found = rerun(version / "drive.mcap", {"supervisor", "controller"})
    assert {DECISION.key, COMMAND.key} <= set(found.topics) and found.frames > 10


@pytest.mark.parametrize("version", VERSIONS, ids=lambda version: version.name)
def test_a_kept_car_folder_is_checked_as_before_a_drive_and_drives(version: Path) -> None:
    with using_car(version / "car"):
        check_car([spec for spec in load_processes() if spec.module != "perception.lead.node"])
        driven = run(load_scenario("straight", {"sight": "truth", "duration_s": "6"}), seed=0)
    assert driven.metrics.departures == 0 and driven.metrics.distance_m > 2.0
