"""What is asked of OpenCV for V4L2 devices and GStreamer pipelines."""

from pathlib import Path

import cv2
import pytest

from vehicle.cameras import opencv
from vehicle.cameras.opencv import GstreamerSettings, V4l2Settings, open_gstreamer, open_v4l2


class Capture:
    """An OpenCV capture that notes what is set; a driver may refuse properties."""

    def __init__(self, name: str, back_end: int, *, opened: bool = True, refused: int | None = None) -> None:
        self.name, self.back_end = name, back_end
        self._opened, self._refused = opened, refused
        self.wanted: list[tuple[int, float]] = []
        self.released = False

    def isOpened(self) -> bool:
        return self._opened

    def set(self, number: int, value: float) -> bool:
        self.wanted.append((number, value))
        return number != self._refused

    def release(self) -> None:
        self.released = True


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    for number in (0, 2):
        (tmp_path / f"video{number}").touch()
    return tmp_path


def test_the_format_is_set_before_the_size_and_the_controls_after_it(devices: Path) -> None:
    settings = V4l2Settings(
        device=2, fourcc="MJPG", width_px=1280, height_px=720, rate_hz=30, controls={"exposure": 150}
    )
    capture = open_v4l2(settings, Capture)
    assert isinstance(capture, Capture)
    assert (capture.name, capture.back_end) == (str(devices / "video2"), cv2.CAP_V4L2)
    assert capture.wanted == [
        (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG")),
        (cv2.CAP_PROP_FRAME_WIDTH, 1280),
        (cv2.CAP_PROP_FRAME_HEIGHT, 720),
        (cv2.CAP_PROP_FPS, 30),
        (cv2.CAP_PROP_EXPOSURE, 150),
    ]


def test_a_link_is_followed_at_every_opening(devices: Path) -> None:
    link = devices / "by-id"
    link.symlink_to(devices / "video0")
    settings = V4l2Settings(device=str(link))
    assert open_v4l2(settings, Capture).name == str(devices / "video0")
    link.unlink()
    link.symlink_to(devices / "video2")  # plugged in again, under another number
    assert open_v4l2(settings, Capture).name == str(devices / "video2")


def test_a_missing_device_is_named_beside_those_that_are_present(devices: Path) -> None:
    with pytest.raises(
        OSError, match=r"video1: no such device; present: .*video0, .*video2; plug the camera in"
    ):
        open_v4l2(V4l2Settings(device=1), Capture)


def test_a_refused_control_is_named_and_the_device_released(devices: Path) -> None:
    captures: list[Capture] = []

    def capture_of(name: str, back_end: int) -> Capture:
        captures.append(Capture(name, back_end, refused=cv2.CAP_PROP_FOCUS))
        return captures[-1]

    with pytest.raises(OSError, match="the driver refuses focus = 3"):
        open_v4l2(V4l2Settings(controls={"focus": 3}), capture_of)
    assert captures[0].released


def test_a_file_that_is_no_capture_device_is_refused(devices: Path) -> None:
    with pytest.raises(OSError, match="cannot be opened as a camera"):
        open_v4l2(V4l2Settings())  # by OpenCV itself: the file is empty


def test_a_pipeline_needs_an_opencv_with_gstreamer(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = GstreamerSettings(pipeline="videotestsrc ! videoconvert ! appsink")
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: False)
    with pytest.raises(OSError, match="built without GStreamer"):
        open_gstreamer(settings, Capture)
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    capture = open_gstreamer(settings, Capture)
    assert isinstance(capture, Capture) and (capture.name, capture.back_end) == (
        settings.pipeline,
        cv2.CAP_GSTREAMER,
    )
    with pytest.raises(OSError, match="does not start"):
        open_gstreamer(settings, lambda name, back_end: Capture(name, back_end, opened=False))
