"""The real-time class of a process."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from heartbeat_rig import RecordingBus

from trepid.messages import Health
from trepid.processes.process import READY, Assignment, Process
from trepid.processes.realtime import leave

STEPPED = [(Health.OK, READY), (Health.WARN, "no frames")]


def ready(option: int | None = None, *, realtime: int | None = None) -> list[tuple[Health, str]]:
    """Health and message of the heartbeats of a process with the ``option`` that becomes ready and steps."""
    options = {} if option is None else {"realtime": option}
    bus: Any = RecordingBus()
    assignment = Assignment(name="one", vehicle_name="v", connect="", clock_offset_ns=0, options=options)
    me = Process(assignment, bus, threading.Event())
    me.ready(realtime=realtime)
    me.count_step(Health.WARN, "no frames")
    return [(beat.health, beat.message) for beat in bus.sent]


@pytest.fixture
def class_changes(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, int]]:
    """Thread, class and priority of each change."""
    changes: list[tuple[int, int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda tid, policy, p: changes.append((tid, policy, p.sched_priority))
    )
    return changes


def test_every_heartbeat_of_a_ready_process_says_that_the_real_time_class_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    first, second, third = ready(10)
    refused = "no real-time class: Operation not permitted; it needs CAP_SYS_NICE or RLIMIT_RTPRIO, and Linux"
    assert first == (Health.OK, READY)
    assert second == (Health.WARN, refused)
    assert third == (Health.WARN, f"no frames; {refused}")


def test_every_thread_of_a_process_gets_the_class_of_its_option(
    class_changes: list[tuple[int, int, int]],
) -> None:
    assert ready(10) == STEPPED
    assert (os.getpid(), os.SCHED_RR, 10) in class_changes
    assert len(class_changes) == len([*Path("/proc/self/task").iterdir()])


def test_a_thread_that_has_ended_refuses_nothing_for_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    changed: list[int] = []

    def ended_or_changed(tid: int, *_: object) -> None:
        if tid == os.getpid():
            raise ProcessLookupError(3, "No such process")
        changed.append(tid)

    monkeypatch.setattr(os, "sched_setscheduler", ended_or_changed)
    other = threading.Event()
    thread = threading.Thread(target=other.wait)
    thread.start()
    try:
        assert ready(10) == STEPPED
    finally:
        other.set()
        thread.join()
    assert thread.native_id in changed


def test_the_priority_of_a_shared_process_counts_before_an_option(
    class_changes: list[tuple[int, int, int]],
) -> None:
    ready(10, realtime=20)
    assert {priority for _, _, priority in class_changes} == {20}


def test_without_a_priority_the_class_stays(class_changes: list[tuple[int, int, int]]) -> None:
    assert ready() == STEPPED
    assert class_changes == []


def test_a_thread_that_leaves_the_class_begins_processes_of_the_normal_one() -> None:
    policy = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
    found: list[int] = []

    def child() -> int:
        return int(subprocess.run(policy, capture_output=True, check=True).stdout)

    def work() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        except PermissionError:
            return
        found.append(child())
        leave()
        found.append(child())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    if not found:
        pytest.skip("this system permits no real-time class")
    assert found == [os.SCHED_RR, os.SCHED_OTHER]
