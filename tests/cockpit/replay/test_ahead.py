"""The estimators of a replay run in a process of their own, whose end and whose errors reach the starter."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cockpit.replay.ahead import estimate_ahead
from trepid.config import ROOT, InputError


@pytest.fixture
def started_processes(monkeypatch: pytest.MonkeyPatch) -> "list[subprocess.Popen[bytes]]":
    """The processes that were started."""
    processes: list[subprocess.Popen[bytes]] = []

    class NotedProcess(subprocess.Popen[bytes]):
        def __init__(self, *words: Any, **settings: Any) -> None:
            super().__init__(*words, **settings)
            processes.append(self)

    monkeypatch.setattr(subprocess, "Popen", NotedProcess)
    return processes


def test_without_estimators_there_is_no_process(
    tmp_path: Path, started_processes: "list[subprocess.Popen[bytes]]"
) -> None:
    with estimate_ahead(tmp_path / "drive.mcap", [], ()) as ahead:
        assert next(ahead, "the end") == "the end"
    assert not started_processes


def test_what_the_process_cannot_read_is_an_input_error_of_the_starter(tmp_path: Path) -> None:
    absent = tmp_path / "drive.mcap"
    with estimate_ahead(absent, ["cv"], ()) as ahead, pytest.raises(InputError, match=str(absent)):
        next(ahead)


def test_a_process_that_is_killed_is_reported(
    tmp_path: Path, started_processes: "list[subprocess.Popen[bytes]]"
) -> None:
    with estimate_ahead(tmp_path / "drive.mcap", ["cv"], ()) as ahead:
        started_processes[0].kill()
        with pytest.raises(InputError, match="ended too early, with exit code -9"):
            next(ahead)


def test_the_process_ends_with_the_use_of_its_outputs(
    tmp_path: Path, started_processes: "list[subprocess.Popen[bytes]]"
) -> None:
    with estimate_ahead(tmp_path / "drive.mcap", ["cv"], ()):
        pass
    assert [process.returncode for process in started_processes] == [-signal.SIGKILL]


def test_the_process_ends_quietly_when_its_starter_has_ended(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "cockpit.replay.ahead", str(tmp_path / "drive.mcap"), "cv"]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 0
