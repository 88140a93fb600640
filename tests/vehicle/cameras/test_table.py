"""Which camera source the settings choose; every wrong one is refused in one line."""

from pathlib import Path

import pytest
from camera_source_rig import ManualClock, drive, folder_of, number_of

from trepid.config import CONFIG_DIR, InputError, use_car
from vehicle.cameras import table
from vehicle.cameras.files import ImageFolder
from vehicle.cameras.source import CameraSource


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TREPID_CAR", "")
    folder = tmp_path / "car"
    folder.mkdir()
    use_car(folder)
    return folder


def build_source(car: Path, text: str) -> CameraSource:
    (car / "camera_source.yaml").write_text(text)
    return table.build(drive(ManualClock()))[1]


def test_the_settings_choose_a_source_and_the_car_overrides_its_fields(car: Path) -> None:
    folder_of(car / "frames", 3)
    source = build_source(car, "source: folder\nfolder:\n  rate_hz: 10\n")  # the path is that of the default
    assert isinstance(source, ImageFolder)
    frame = source.read(timeout_s=0.0)
    assert frame is not None and number_of(frame.image) == 0


def test_the_default_settings_are_valid_for_every_source(car: Path) -> None:
    for name in table.OWN:
        (car / "camera_source.yaml").write_text(f"source: {name}\n")
        assert table.configured_source()[0] == name


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("source: videoo\n", 1, "unknown camera source 'videoo'; did you mean 'video'?"),
        ("source: v4l2\nv4l2:\n  device: 77\n", 3, "/dev/video77: no such device; present: "),
        ("source: v4l2\nv4l2:\n  device: -1\n", 3, "device"),
        ("source: v4l2\nv4l2:\n  devise: 1\n", 3, "did you mean 'device'?"),
        ("source: v4l2\nv4l2:\n  controls: {exposur: 3}\n", 3, "exposur"),
        ("source: gstreamer\ngstreamer:\n  pipeline: videotestsrc\n", 3, "appsink"),
        ("source: gstreamer\n", None, "without GStreamer"),
        ("source: video\nvideo:\n  path: /no/such.mp4\n", 3, "/no/such.mp4: no such file; set path"),
        ("source: folder\nfolder:\n  path: /no/such\n", 3, "/no/such: no such folder; set path"),
        ("source: mcap\nmcap:\n  path: /no/such.mcap\n", 3, "/no/such.mcap: cannot be read"),
        ("source: ros2\n", None, "needs the bus of a drive, or connect"),
        ("mount: {rotate_deg: 45}\n", 1, "mount.rotate_deg"),
        ("fit: squeeze\n", 1, "fit"),
        ("sauce: video\n", 1, "unknown field 'sauce'; did you mean 'source'?"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(
    car: Path, text: str, line: int | None, problem: str
) -> None:
    with pytest.raises(InputError) as error:
        build_source(car, text)
    message = str(error.value)
    file = CONFIG_DIR / "camera_source.yaml" if line is None else car / "camera_source.yaml"
    assert message.startswith(f"{file}:{'' if line is None else line}")
    assert problem in message and "\n" not in message


def test_another_package_adds_a_source(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Point:
        name, value = "thermal", "elsewhere:Thermal"

        def load(self) -> type:
            return ImageFolder

    monkeypatch.setattr("trepid.plugins.entry_points", lambda group: [Point()])
    table.plugins.added_entry_points.cache_clear()
    try:
        folder = folder_of(car / "frames", 1)
        source = build_source(car, f"source: thermal\nthermal:\n  path: {folder}\n")
        assert isinstance(source, ImageFolder)
        with pytest.raises(InputError, match="expected a block"):
            build_source(car, "source: thermal\n")
    finally:
        table.plugins.added_entry_points.cache_clear()
