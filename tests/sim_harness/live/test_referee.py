"""The monitor of a live drive, without processes."""

import time
from types import SimpleNamespace

import pytest

from sim_harness.live.referee import Assigned, DriveSettings, Referee
from sim_harness.scenarios.scenario import load_scenario
from trepid.bus import free_endpoint, open_bus
from trepid.config import CONFIG_DIR, InputError, load
from trepid.processes.launch import UnexpectedExit
from trepid.processes.settings import ProcessSpec


def test_a_process_that_refuses_its_input_ends_the_drive_with_that_line():
    ended = UnexpectedExit("supervisor", 1, 2, "rules.yaml:3:5: no such cause")
    fleet = SimpleNamespace(
        children={"supervisor": SimpleNamespace(spec=ProcessSpec("supervisor", "supervisor.node"))},
        collect_exits=lambda: [ended],
    )
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    scenario = load_scenario("straight", check=False)
    with open_bus("car", time.monotonic, listen=free_endpoint()) as bus:
        referee = Referee(
            bus, time.monotonic, fleet, Assigned(scenario, ("cv",), None, "x", ""), settings, lambda *_: None
        )
        with pytest.raises(InputError, match=r"^process supervisor: rules\.yaml:3:5: no such cause$"):
            referee.wait_until_ready([])
