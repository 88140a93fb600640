"""A launcher under systemd reports readiness, state, life and end over the socket of sd_notify(3)."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from drive.overview import Notifier


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The socket of a service manager."""
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(path))
        listening.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        yield listening


def receive(manager: socket.socket) -> list[str]:
    texts = []
    while True:
        try:
            texts.append(manager.recv(4096).decode())
        except BlockingIOError:
            return texts


def test_readiness_changes_of_state_and_the_end_are_reported_once(manager: socket.socket) -> None:
    notifier = Notifier()
    notifier.status("waiting for camera")
    notifier.status("waiting for camera")
    notifier.ready()
    notifier.status("driving")
    notifier.stopping()
    assert receive(manager) == ["STATUS=waiting for camera", "READY=1", "STATUS=driving", "STOPPING=1"]


def test_the_watchdog_is_fed_twice_in_its_time(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "4000000")
    now_s = [100.0]
    monkeypatch.setattr("drive.overview.time.monotonic", lambda: now_s[0])
    notifier = Notifier()
    for step_s in (0.0, 1.0, 0.9, 0.2):  # at 0, 1, 1.9 and 2.1 s
        now_s[0] += step_s
        notifier.alive()
    assert receive(manager) == ["WATCHDOG=1", "WATCHDOG=1"]


def test_without_a_watchdog_none_is_fed(manager: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WATCHDOG_USEC", raising=False)
    Notifier().alive()
    assert receive(manager) == []


def test_without_systemd_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    Notifier().ready()
