"""The unit that `trepid service` writes is one that systemd accepts, and it keeps what exists."""

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest

from cockpit.service import write_units
from trepid.config import CAR, InputError


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, "")
    folder = tmp_path / "mycar"
    folder.mkdir()
    (folder / "drive.yaml").write_text("ready_timeout_s: 40\nstop_timeout_s: 7\n")
    return folder


def test_the_unit_waits_for_readiness_has_a_watchdog_and_leaves_time_to_stop(
    car: Path, tmp_path: Path
) -> None:
    (path,) = write_units(car, tmp_path)
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(path)
    service = unit["Service"]
    assert path.name == "trepid-mycar.service"
    assert (service["Type"], service["NotifyAccess"], service["Restart"]) == ("notify", "main", "no")
    page = unit["Unit"]["Documentation"].removeprefix("file://")
    assert "systemd" in Path(page).read_text(encoding="utf-8")
    assert service["ExecStart"].endswith(f"-m trepid drive --car {car} --no-dashboard")
    assert float(service["WatchdogSec"]) > 0
    assert (float(service["TimeoutStartSec"]), float(service["TimeoutStopSec"])) == (70, 22)
    assert (
        service["KillMode"] == "process"
    )  # the processes of a killed launcher bring the car to a standstill


def test_a_wrong_setting_of_the_drive_is_one_line_with_its_place(car: Path, tmp_path: Path) -> None:
    (car / "drive.yaml").write_text("ready_timeout_s: soon\n")
    with pytest.raises(InputError, match=r"drive\.yaml:1:1: ready_timeout_s: "):
        write_units(car, tmp_path)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
@pytest.mark.parametrize("user", [False, True])
def test_systemd_finds_no_fault_in_the_unit(car: Path, tmp_path: Path, user: bool) -> None:
    (path,) = write_units(car, tmp_path, user=user)
    scope = ["--user"] if user else []
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *scope, str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert [line for line in done.stderr.splitlines() if path.name in line] == []


def test_a_unit_that_somebody_has_edited_is_kept(car: Path, tmp_path: Path) -> None:
    (path,) = write_units(car, tmp_path)
    write_units(car, tmp_path)
    path.write_text("edited")
    with pytest.raises(
        InputError, match=r"exists with another content and is kept; remove it, or give --out$"
    ):
        write_units(car, tmp_path)
    assert path.read_text() == "edited"


def test_the_folder_of_units_is_made_and_a_file_in_its_place_is_named(car: Path, tmp_path: Path) -> None:
    (path,) = write_units(car, tmp_path / "systemd" / "user", user=True)
    assert path.is_file()
    with pytest.raises(InputError, match=r"trepid-mycar\.service: cannot be written: "):
        write_units(car, car / "drive.yaml")
