"""The monitor of a live drive, without processes."""

import itertools
import time
from types import SimpleNamespace

import pytest
from message_rig import decision

from drive.evaluation import closing_words
from drive.monitor import Monitor
from drive.open_road import OpenRoad
from sim_harness.live.course import ScenarioCourse
from sim_harness.scenarios.scenario import load_scenario
from trepid.bus import free_endpoint, open_bus
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Losses, VehicleState
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.launch import UnexpectedExit
from trepid.processes.register import END
from trepid.processes.settings import LAUNCHER, Loss, ProcessSpec
from trepid.topics import DECISION, DIAGNOSTICS, LOSSES, VEHICLE_STATE


def test_a_process_that_refuses_its_input_ends_the_drive_with_that_line():
    ended = UnexpectedExit("supervisor", 1, 2, "rules.yaml:3:5: no such cause")
    fleet = SimpleNamespace(
        children={"supervisor": SimpleNamespace(spec=ProcessSpec("supervisor", "supervisor.node"))},
        collect_exits=lambda: [ended],
        weigh=len,
    )
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    scenario = load_scenario("straight", check=False)
    with open_bus("car", time.monotonic, listen=free_endpoint()) as bus:
        course = ScenarioCourse(scenario)
        monitor = Monitor(bus, time.monotonic, fleet, course, ("cv",), settings, lambda *_: None)
        with pytest.raises(InputError, match=r"^process supervisor: rules\.yaml:3:5: no such cause$"):
            monitor.wait_until_ready([])


@pytest.mark.parametrize(
    ("speed_mps", "problems"), [(6.0, ["the car did not stop within 10 s after the end"]), (0.0, [])]
)
def test_a_real_car_that_moves_on_after_the_end_fails_the_drive(
    speed_mps: float, problems: list[str]
) -> None:
    fleet = SimpleNamespace(children={}, collect_exits=list, weigh=len)
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    clock = map(float, itertools.count()).__next__  # a second passes at every reading
    with open_bus("car", clock, listen=free_endpoint()) as bus:
        send, reports = bus.publisher(VEHICLE_STATE), bus.stream(DIAGNOSTICS)
        monitor = Monitor(bus, clock, fleet, OpenRoad(duration_s=5.0), (), settings, lambda *_: None)
        send(
            VehicleState(
                t_s=0.0,
                speed_mps=speed_mps,
                road_wheel_angle_rad=None,
                yaw_rate_radps=None,
                driver_override=False,
            )
        )
        monitor.watch([])
        row = monitor.row(0)
        ends = [dict(report.values)[END] for report, _ in reports.drain() if END in dict(report.values)]
    assert (row["status"], row["reasons"]) == ("failed" if problems else "not driven", problems)
    assert row["end"] == "its 5 s are over" and ends == [closing_words(row)]


def test_a_drive_begins_without_a_process_whose_loss_changes_nothing():
    spec = ProcessSpec("page", "cockpit.page.node", loss=Loss.NOTHING)
    child = SimpleNamespace(spec=spec, popen=SimpleNamespace(pid=1), alive=True, restarts=0)
    fleet = SimpleNamespace(children={"page": child}, collect_exits=list, weigh=len)
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    with open_bus("car", time.monotonic, listen=free_endpoint()) as bus:
        send = bus.publisher(DECISION)
        monitor = Monitor(bus, time.monotonic, fleet, OpenRoad(duration_s=5.0), (), settings, lambda *_: None)
        send(decision())
        assert monitor.wait_until_ready([])


@pytest.mark.parametrize("refused", [False, True])
def test_a_real_car_that_moves_before_the_start_is_stopped_before_its_processes_end(refused: bool) -> None:
    spec = ProcessSpec("page", "cockpit.page.node", loss=Loss.NOTHING)
    child = SimpleNamespace(spec=spec, popen=SimpleNamespace(pid=1), alive=True, restarts=0)
    exits: list[UnexpectedExit] = []
    fleet = SimpleNamespace(
        children={"page": child}, collect_exits=lambda: [exits.pop()] if exits else [], weigh=len
    )
    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    clock = itertools.count(step=0.1).__next__  # 0.1 s pass at every reading
    speeds_mps = [0.0, 2.0, 4.0, 6.0]
    signals: list[str] = []
    with open_bus("car", clock, listen=free_endpoint()) as bus:
        send, asked = bus.publisher(VEHICLE_STATE), bus.latest(LOSSES)
        stops: list[Losses | None] = []

        def drive_on(*_: object) -> None:
            stops.append(asked.take())
            if not speeds_mps:
                return
            send(
                VehicleState(
                    t_s=0.0,
                    speed_mps=speeds_mps.pop(),
                    road_wheel_angle_rad=None,
                    yaw_rate_radps=None,
                    driver_override=False,
                )
            )
            if len(speeds_mps) == 2:
                if refused:
                    exits.append(UnexpectedExit("page", 1, 2, "page.yaml:3:5: no such field"))
                else:
                    signals.append("stopped by SIGINT")

        monitor = Monitor(bus, clock, fleet, OpenRoad(duration_s=5.0), (), settings, drive_on)
        drive_on()
        if refused:
            with pytest.raises(InputError, match=r"page\.yaml:3:5"):
                monitor.wait_until_ready(signals)
        else:
            assert not monitor.wait_until_ready(signals)
            assert monitor.row(0)["reasons"] == ["stopped by SIGINT"]
    assert speeds_mps == []  # the monitor waited for the standstill
    assert any(losses is not None and LAUNCHER in losses.stop for losses in stops)
