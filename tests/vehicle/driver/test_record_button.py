"""The record button of a game pad, over real processes: the pad, the driver process, the recorder."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from process_rig import until
from vehicle_driver_rig import SETTINGS, button

from drive.open_road import OpenRoad
from drive.plan import plan_processes
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CAR
from trepid.processes.launch import Fleet
from trepid.processes.settings import load_processes
from trepid.recording.reader import read_recording
from trepid.topics import DIAGNOSTICS, DRIVER_INPUT


@pytest.fixture
def pad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The writing end of the game pad of a car with nothing but a driver process and the recorder."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    end = os.open(path, os.O_RDWR)
    (tmp_path / "driver.yaml").write_text(f"device: {path}\n")
    others = ("vehicle", "camera", "cv", "cnn", "lead", "supervisor", "controller")
    (tmp_path / "processes.yaml").write_text(
        "processes:\n"
        + "".join(f"  {name}: null\n" for name in others)
        + "  driver: {module: vehicle.driver.node, publishes: [driver/input]}\n"
    )
    monkeypatch.setenv(CAR, str(tmp_path))
    yield end
    os.close(end)


def test_a_press_of_the_record_button_starts_a_recording_and_the_next_one_ends_it(
    pad: int, tmp_path: Path
) -> None:
    specs = plan_processes(load_processes(), OpenRoad())
    assert [spec.name for spec in specs] == ["recorder", "driver"]
    offset_ns, endpoint, folder = epoch_offset_ns(), free_endpoint(), tmp_path / "recordings"
    said = {}
    with (
        open_bus("car", epoch_clock(offset_ns), listen=endpoint) as bus,
        Fleet(
            specs,
            vehicle_name="car",
            endpoint=endpoint,
            clock_offset_ns=offset_ns,
            context={"record_folder": str(folder)},
        ),
    ):
        heard = bus.stream(DIAGNOSTICS)

        def says(words: str) -> bool:
            said.update({beat.process: beat.message for beat, _ in heard.drain()})
            return words in said.get("recorder", "")

        def hold(pressed: bool) -> None:
            os.write(pad, button(SETTINGS.gamepad.record_button, pressed))

        assert until(lambda: says("not recording") and "driver" in said, patience_s=30)
        hold(True)
        assert until(lambda: says(f"recording {folder}/drive-"), patience_s=30)
        hold(False)
        assert not until(lambda: says("not recording"), patience_s=0.5)
        hold(True)
        assert until(lambda: says("not recording; the last recording is"), patience_s=30)
    (file,) = folder.iterdir()
    recorded = read_recording(file, DRIVER_INPUT.key)
    assert recorded.complete
    assert len(recorded.of(DRIVER_INPUT)) > 10


def test_a_car_without_driver_input_has_no_recorder() -> None:
    assert "recorder" not in [spec.name for spec in plan_processes(load_processes(), OpenRoad())]
    assert "recorder" in [spec.name for spec in plan_processes(load_processes(), OpenRoad(), recorded=True)]
