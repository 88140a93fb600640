"""What the launcher prints about a drive, without processes."""

from types import SimpleNamespace
from typing import Any

from drive.launcher import telling


def test_an_address_is_printed_once_and_not_before_its_process_listens() -> None:
    said: list[str] = []
    shown: list[float] = []
    show = telling(
        lambda _log, _fleet, elapsed_s: shown.append(elapsed_s), said.append, {"page": "live page: p"}
    )
    log: Any = SimpleNamespace(diagnostics={"camera": None})
    fleet: Any = SimpleNamespace()
    show(log, fleet, 1.0)
    assert said == []
    log.diagnostics["page"] = None
    show(log, fleet, 2.0)
    show(log, fleet, 3.0)
    assert (said, shown) == (["live page: p"], [1.0, 2.0, 3.0])
