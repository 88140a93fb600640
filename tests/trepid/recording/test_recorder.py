"""The recorder process: a disk that refuses the recording is reported once, and the process lives on."""

import os
import resource
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from process_rig import until
from vehicle_driver_rig import INPUT

from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import InputError
from trepid.messages import Diagnostic, Health, VehicleState
from trepid.processes.launch import Fleet
from trepid.processes.settings import LAUNCHER, Loss, ProcessSpec
from trepid.recording.node import free_path
from trepid.recording.notes import RULES, RULES_FROM_S
from trepid.recording.reader import read_recording
from trepid.recording.writer import BEGAN, Recording, check_free, check_recording
from trepid.topics import DIAGNOSTICS, DRIVER_INPUT, VEHICLE_STATE


class RecorderProcess:
    """A recorder process, and a bus that gives it states of a vehicle."""

    def __init__(self, fleet: Fleet, bus: Any, clock: Callable[[], float]) -> None:
        self.child = fleet.children["recorder"]
        self._heard, self._clock = bus.latest(DIAGNOSTICS), clock
        self._send, self._report = bus.publisher(VEHICLE_STATE), bus.publisher(DIAGNOSTICS)
        self._press = bus.publisher(DRIVER_INPUT)
        self.button: bool | None = None  # None: no driver

    def sends_until(self, condition: Callable[[Diagnostic], bool]) -> bool:
        """Publish states until the newest heartbeat fulfils the condition."""

        def holds() -> bool:
            state = VehicleState(
                t_s=self._clock(),
                speed_mps=self._clock() % 1.0,
                road_wheel_angle_rad=None,
                yaw_rate_radps=None,
                driver_override=False,
            )
            self._send(state)
            if self.button is not None:
                self._press(replace(INPUT, t_s=self._clock(), record=self.button))
            time.sleep(0.002)
            beat = self._heard.take()
            return beat is not None and beat.process == "recorder" and condition(beat)

        return until(holds, patience_s=120)

    def reports_start(self) -> float:
        """Publish the heartbeat of a launcher with the start of the drive; the time of this heartbeat."""
        now_s, began = self._clock(), ((BEGAN, "123000000000"),)
        self._report(Diagnostic(t_s=now_s, process=LAUNCHER, health=Health.OK, message="", values=began))
        return now_s

    def adopts(self, rules: str) -> None:
        """Publish the heartbeat of a supervisor that has adopted changed rules."""
        values = ((RULES_FROM_S, repr(self._clock())), (RULES, rules))
        beat = Diagnostic(
            t_s=self._clock(), process="supervisor", health=Health.WARN, message="", values=values
        )
        self._report(beat)


@pytest.fixture
def recorder() -> Iterator[Callable[[Path], Any]]:
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    clock = epoch_clock(offset_ns)
    with open_bus("car", clock, listen=endpoint) as bus:

        def fleet(path: Path, option: str = "record", **further: Any) -> Fleet:
            options = {option: str(path), **further}
            spec = ProcessSpec("recorder", "trepid.recording.node", options, loss=Loss.NOTHING)
            return Fleet((spec,), vehicle_name="car", endpoint=endpoint, clock_offset_ns=offset_ns)

        fleet.of = lambda running: RecorderProcess(running, bus, clock)  # type: ignore[attr-defined]
        yield fleet


def test_a_full_disk_ends_the_recording_and_not_the_process(recorder: Any, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recorder(path) as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(lambda beat: beat.message == "")
        limit = path.stat().st_size + 2048
        resource.prlimit(recorded.child.popen.pid, resource.RLIMIT_FSIZE, (limit, limit))
        assert recorded.sends_until(lambda beat: "the recording ends here" in beat.message)
        assert recorded.sends_until(
            lambda beat: beat.health is Health.ERROR and "File too large" in beat.message
        )
        assert recorded.child.alive
        assert running.collect_exits() == []
    assert read_recording(path, VEHICLE_STATE.key).of(VEHICLE_STATE)


@pytest.fixture
def small_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A file system of 300 kB that holds the last minutes of drives; skips where it cannot be mounted."""
    place = tmp_path / "disk"
    place.mkdir()
    mounting = ["mount", "-t", "tmpfs", "-o", "size=300k", "none", str(place)]
    if shutil.which("mount") is None or subprocess.run(mounting, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a file system here")
    monkeypatch.setenv("XDG_STATE_HOME", str(place))
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_ends_the_last_minutes_once_and_not_the_process(
    recorder: Any, small_disk: Path, tmp_path: Path
) -> None:
    with recorder(tmp_path / "recordings", "record_folder", ring="a drive") as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(lambda beat: beat.message.startswith("not recording"))
        assert recorded.sends_until(lambda _: any(part.stat().st_size for part in small_disk.rglob("*.mcap")))
        left = os.statvfs(small_disk)
        (small_disk / "others").write_bytes(bytes(left.f_bavail * left.f_bsize))
        told: list[str] = []

        def is_refused(beat: Diagnostic) -> bool:
            told.append(beat.message)
            return told.count(told[-1]) > 2 and beat.health is Health.ERROR

        assert recorded.sends_until(is_refused)
        assert "the last minutes are not recorded any more" in told[-1] and "No space left" in told[-1]
        (small_disk / "others").unlink()
        assert recorded.sends_until(lambda beat: beat.message == told[-1]), (
            "the reason stays, and is no new one"
        )
        assert recorded.child.alive and running.collect_exits() == []
    (part,) = small_disk.rglob("*.mcap")
    assert read_recording(part, VEHICLE_STATE.key).of(VEHICLE_STATE)


def test_a_read_only_disk_is_reported_and_the_process_runs_on(
    recorder: Any, small_disk: Path, tmp_path: Path
) -> None:
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with recorder(tmp_path / "recordings", "record_folder", ring="a drive") as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(
            lambda beat: beat.health is Health.ERROR and "Read-only file system" in beat.message
        )
        recorded.button = True  # recordings by the button go to another disk
        assert recorded.sends_until(lambda _: bool(list((tmp_path / "recordings").glob("*.mcap"))))
        assert recorded.child.alive and running.collect_exits() == []


def test_the_recorder_notes_the_start_of_the_drive_that_the_launcher_reports(
    recorder: Any, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    with recorder(path) as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(lambda beat: beat.message == "")
        reported_s = recorded.reports_start()
        for _ in range(2):  # the recorder has heard what was published before its last heartbeat
            assert recorded.sends_until(lambda beat: beat.message == "" and beat.t_s > reported_s)
    found = read_recording(path, VEHICLE_STATE.key)
    assert found.began_s == 123.0
    assert found.of(VEHICLE_STATE)


def test_the_record_button_starts_and_ends_a_recording_each_time_in_a_file_of_its_own(
    recorder: Any, tmp_path: Path
) -> None:
    folder = tmp_path / "deep" / "recordings"
    with recorder(folder, "record_folder") as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(lambda beat: f"starts a recording in {folder}" in beat.message)
        assert not folder.exists()
        for count in (1, 2):
            recorded.button = True
            assert recorded.sends_until(lambda beat: beat.message.startswith("recording "))
            assert recorded.sends_until(lambda beat: beat.message.startswith("recording "))
            recorded.button = False
            assert recorded.sends_until(lambda beat: "not recording; the last recording is" in beat.message)
            files = sorted(folder.glob("drive-20*.mcap"))
            assert len(files) == count
            found = read_recording(files[-1], VEHICLE_STATE.key)
            assert found.complete
            assert found.of(VEHICLE_STATE)


def test_a_recording_by_the_button_keeps_the_rules_in_force_and_not_the_file_as_it_is_by_then(
    recorder: Any, tmp_path: Path
) -> None:
    folder, rules = tmp_path / "recordings", tmp_path / "fear.yaml"
    rules.write_text("rules of the start")
    with recorder(folder, "record_folder", rules=str(rules)) as running:
        recorded = recorder.of(running)
        assert recorded.sends_until(lambda beat: "not recording" in beat.message)
        rules.write_text("text that the supervisor refuses")
        for adopted in ("", "adopted rules"):
            if adopted:
                recorded.adopts(adopted)
                for _ in range(2):  # the recorder has heard what was published before its last heartbeat
                    assert recorded.sends_until(lambda beat: "not recording" in beat.message)
            recorded.button = True
            assert recorded.sends_until(lambda beat: beat.message.startswith("recording "))
            recorded.button = False
            assert recorded.sends_until(lambda beat: "not recording" in beat.message)
    kept = [read_recording(file).files["fear.yaml"] for file in sorted(folder.iterdir())]
    assert kept == [b"rules of the start", b"adopted rules"]


def test_a_folder_that_cannot_be_made_is_reported_until_the_button_is_pressed_again(
    recorder: Any, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    with recorder(tmp_path / "file" / "recordings", "record_folder") as running:
        recorded = recorder.of(running)
        recorded.button = True
        assert recorded.sends_until(
            lambda beat: beat.health is Health.ERROR and "recordings: cannot be made" in beat.message
        )
        recorded.button = False
        assert recorded.sends_until(lambda beat: beat.health is Health.OK)


def test_nothing_that_exists_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    path.write_text("precious")
    for refused in (check_free, Recording):
        with pytest.raises(InputError, match=r"drive\.mcap: exists already and is kept; give another name$"):
            refused(path)
    assert path.read_text() == "precious"


def test_after_a_restart_the_recorder_takes_the_next_name(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    assert free_path(path) == path
    path.touch()
    (tmp_path / "drive-2.mcap").touch()
    assert free_path(path) == tmp_path / "drive-3.mcap"


def test_a_name_by_which_no_verb_would_take_a_file_for_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"drive: a recording is an MCAP file: name it drive\.mcap$"):
        check_recording(tmp_path / "drive")
    check_recording(tmp_path / "drive.MCAP")


def test_a_name_that_is_too_long_is_refused_before_the_drive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.mcap: cannot be written: File name too long$"):
        check_recording(tmp_path / f"{'a' * 300}.mcap")


def test_a_recording_without_a_folder_is_refused_before_the_drive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such folder; `mkdir -p .*/missing` makes it$"):
        check_free(tmp_path / "missing" / "drive.mcap")
