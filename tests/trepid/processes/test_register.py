"""The register lists the drives that run, and nothing that a killed launcher left."""

import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

import pytest

from trepid.config import InputError
from trepid.processes.register import Running, folder, register_drive, running, ticks


@pytest.fixture(autouse=True)
def _own_register(own_register: Path) -> None:
    pass


def drive(*, started_ticks: int | None = None) -> Running:
    started = ticks(os.getpid()) if started_ticks is None else started_ticks
    assert started is not None
    return Running(
        pid=os.getpid(),
        started_ticks=started,
        vehicle_name="car",
        endpoint="tcp/127.0.0.1:1",
        clock_offset_ns=0,
        car=None,
        what="circuit",
    )


def test_a_drive_is_listed_while_it_runs() -> None:
    with register_drive(drive()):
        assert running() == [drive()]
    assert running() == []


def test_a_drive_whose_number_belongs_to_a_later_process_is_not_listed_and_removed() -> None:
    with register_drive(drive(started_ticks=1)):
        assert running() == []
        assert list(folder().iterdir()) == []


def test_the_shell_of_a_user_finds_the_drive_of_a_service_of_the_system(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with ExitStack() as stack:
        with monkeypatch.context() as service:
            service.delenv("XDG_RUNTIME_DIR")
            stack.enter_context(register_drive(drive()))
        assert running() == [drive()]
    assert running() == []


def test_without_the_runtime_folder_a_drive_is_listed_in_the_one_for_temporary_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    with register_drive(drive()):
        assert running() == [drive()]
        assert folder().parent == Path(tempfile.gettempdir())


def test_entries_of_another_user_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    with register_drive(drive()):
        monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
        assert running() == []
        with pytest.raises(InputError, match=r"belongs to another user; set XDG_RUNTIME_DIR"):
            (Path(tempfile.gettempdir()) / f"trepid-{os.getuid()}").mkdir()
            folder()


def test_a_register_that_cannot_be_written_does_not_keep_a_car_from_driving(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with register_drive(drive()):
        assert running() == []
