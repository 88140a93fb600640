"""What the launcher prints about a drive and which signals end it, without processes."""

import signal
from types import SimpleNamespace
from typing import Any

import pytest

from drive.launcher import caught_signals, telling
from drive.open_road import OpenRoad
from trepid.processes.settings import Loss, ProcessSpec


def test_an_address_is_printed_once_and_not_before_its_process_listens_and_the_camera_gives_pictures() -> (
    None
):
    said: list[str] = []
    shown: list[float] = []
    show = telling(
        lambda _log, _fleet, elapsed_s: shown.append(elapsed_s), said.append, {"page": "live page: p"}
    )
    log: Any = SimpleNamespace(diagnostics={})
    specs = [
        ProcessSpec("camera"),
        ProcessSpec("page", loss=Loss.NOTHING),
        ProcessSpec("lamp", loss=Loss.NOTHING),
    ]
    fleet: Any = SimpleNamespace(children={spec.name: SimpleNamespace(spec=spec) for spec in specs})
    show(log, fleet, 1.0)
    log.diagnostics["page"] = None
    show(log, fleet, 2.0)
    assert said == []
    log.diagnostics["camera"] = None
    show(log, fleet, 3.0)
    show(log, fleet, 4.0)
    assert (said, shown) == (["live page: p"], [1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name
)
def test_a_signal_ends_a_drive_and_only_the_loss_of_the_terminal_fails_that_of_a_car(
    number: signal.Signals,
) -> None:
    with caught_signals() as caught:
        signal.raise_signal(number)
    assert caught == [f"stopped by {number.name}"]
    assert (caught[0] in OpenRoad().endings) is (number is not signal.SIGHUP)
