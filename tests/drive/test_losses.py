"""The report of lost processes, without processes."""

from types import SimpleNamespace

import pytest

from drive.losses import LossReport
from trepid.messages import Diagnostic, Health, Losses
from trepid.processes.settings import Loss, ProcessSpec


class Drive:
    """A launcher at 100 s and one process, horn, whose loss slows the car."""

    def __init__(self, *, heartbeat: bool) -> None:
        spec = ProcessSpec("horn", "horn", heartbeat=heartbeat, loss=Loss.SLOW)
        self.now_s = 100.0
        self.child = SimpleNamespace(spec=spec, alive=True, started_s=10.0)
        self.beats: dict[str, Diagnostic] = {}
        self.sent: list[Losses] = []
        bus = SimpleNamespace(publisher=lambda _: self.sent.append)
        self.report = LossReport(bus, lambda: self.now_s, SimpleNamespace(children={"horn": self.child}))

    def lose(self) -> None:
        self.child.alive = False
        self.report.lose("horn")

    def start_again(self) -> None:
        self.child.alive, self.child.started_s = True, self.now_s

    def beat(self) -> None:
        self.beats["horn"] = Diagnostic(
            t_s=self.now_s, process="horn", health=Health.OK, message="", values=()
        )

    def slow(self, after_s: float) -> bool:
        """True when the launcher reports, ``after_s`` later, that the car is to be slow."""
        self.now_s += after_s
        self.report.publish(self.beats)
        return bool(self.sent and self.sent[-1].slow)


def test_the_car_is_slow_until_the_next_heartbeat_of_the_lost_process() -> None:
    drive = Drive(heartbeat=True)
    drive.beat()
    assert not drive.slow(after_s=0.1)
    drive.lose()
    assert drive.slow(after_s=0.1)
    drive.start_again()
    assert drive.slow(after_s=30.0)
    drive.beat()
    assert not drive.slow(after_s=0.1)


def test_without_heartbeats_the_car_is_slow_until_the_lost_process_has_run_for_a_second() -> None:
    drive = Drive(heartbeat=False)
    drive.lose()
    assert drive.slow(after_s=30.0)
    drive.start_again()
    assert drive.slow(after_s=0.9)
    assert not drive.slow(after_s=0.2)


@pytest.mark.parametrize("heartbeat", [False, True])
def test_the_car_stays_slow_while_the_process_does_not_run(heartbeat: bool) -> None:
    drive = Drive(heartbeat=heartbeat)
    drive.lose()
    drive.start_again()
    drive.child.alive = False
    assert drive.slow(after_s=30.0)


def test_the_awaited_processes_are_repeated_until_the_drive_begins() -> None:
    drive = Drive(heartbeat=True)
    drive.report.wait_for(["horn"])
    for _ in range(3):
        drive.slow(after_s=1.0)
    assert [report.awaited for report in drive.sent] == [("horn",)] * 3
    drive.report.wait_for(())
    drive.slow(after_s=0.01)  # at once
    drive.slow(after_s=1.0)  # for one that did not hear it
    assert [report.awaited for report in drive.sent[3:]] == [(), ()]
    drive.report.begin()
    drive.slow(after_s=9.0)
    assert len(drive.sent) == 5
