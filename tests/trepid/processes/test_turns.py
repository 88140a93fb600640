"""The loop of a process."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from trepid.messages import Health
from trepid.processes.turns import repeat


def stopped(priority: int | None) -> list[Any]:
    """Heartbeats of a process with the real-time ``priority`` that stops before its first turn."""
    beats: list[Any] = []
    me: Any = SimpleNamespace(
        options={"realtime": priority}, running=lambda: False, beat=lambda *state: beats.append(state)
    )
    repeat(me)
    return beats


def test_a_refused_real_time_class_is_reported_and_the_process_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    ((health, message),) = stopped(10)
    assert health is Health.WARN
    assert "no real-time class: Operation not permitted" in message


def test_every_thread_of_the_process_gets_the_real_time_class(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda tid, policy, p: given.append((tid, policy, p.sched_priority))
    )
    assert stopped(10) == []
    assert (os.getpid(), os.SCHED_RR, 10) in given
    assert len(given) == len([*Path("/proc/self/task").iterdir()])


def test_without_a_priority_the_class_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    assert stopped(None) == []
