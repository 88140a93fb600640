"""A CSI camera through a stand-in for picamera2, which is on no machine but a Raspberry Pi."""

import sys
import threading
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest

from trepid.config import InputError
from vehicle.cameras.picamera import PicameraCamera, PicameraSettings, open_picamera
from vehicle.cameras.source import SourceContext


class Request:
    """A frame with its buffer."""

    def __init__(self, camera: "Camera", number: int) -> None:
        self._camera, self._number = camera, number

    def make_array(self, stream: str) -> np.ndarray:
        assert stream == "main"
        return np.full((48, 64, 3), (255, 0, self._number), np.uint8)

    def get_metadata(self) -> dict[str, int]:
        return {"SensorTimestamp": (100 + self._number) * 10_000_000}

    def release(self) -> None:
        self._camera.lent -= 1


class Camera:
    """picamera2.Picamera2 with three frames; then it hangs."""

    present: ClassVar[list[dict[str, str]]] = [{"Model": "imx708_wide"}]
    opened: ClassVar[list["Camera"]] = []
    size: ClassVar[tuple[int, int] | None] = None

    def __init__(self, number: int) -> None:
        self.number, self.log, self.lent, self.frames = number, [], 0, 0
        self.wanted: dict[str, Any] = {}
        self._closed = threading.Event()
        Camera.opened.append(self)

    @staticmethod
    def global_camera_info() -> list[dict[str, str]]:
        return Camera.present

    def create_video_configuration(self, **wanted: Any) -> dict[str, Any]:
        return wanted

    def configure(self, wanted: dict[str, Any]) -> None:
        self.wanted = wanted

    def camera_configuration(self) -> dict[str, Any]:
        return {"main": {"size": Camera.size or self.wanted["main"]["size"]}}

    def start(self) -> None:
        self.log.append("start")

    def stop(self) -> None:
        self.log.append("stop")

    def close(self) -> None:
        self.log.append("close")
        self._closed.set()

    def capture_request(self) -> Request | None:
        if self.frames == 3:
            self._closed.wait(2.0)
            return None
        self.frames, self.lent = self.frames + 1, self.lent + 1
        return Request(self, self.frames)


@pytest.fixture
def picamera2(monkeypatch: pytest.MonkeyPatch) -> type[Camera]:
    module = ModuleType("picamera2")
    module.Picamera2 = Camera  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "picamera2", module)
    monkeypatch.setattr(Camera, "opened", [])
    return Camera


SETTINGS = PicameraSettings(width_px=64, height_px=48, rate_hz=25, controls={"AeEnable": False})


def test_a_camera_is_asked_for_bgr_frames_of_the_size_at_the_rate(picamera2: type[Camera]) -> None:
    open_picamera(SETTINGS)
    (camera,) = picamera2.opened
    assert camera.wanted["main"] == {"size": (64, 48), "format": "RGB888"}
    assert camera.wanted["controls"] == {"FrameDurationLimits": (40_000, 40_000), "AeEnable": False}
    assert camera.log == ["start"]


def test_frames_keep_their_pixels_and_the_stamp_of_the_sensor_and_return_every_buffer(
    picamera2: type[Camera],
) -> None:
    capture = open_picamera(SETTINGS)
    for number in (1, 2, 3):
        assert capture.grab()
        assert capture.get(0) == pytest.approx(1000 + 10 * number)
        good, image = capture.retrieve()
        assert good and image.shape == (48, 64, 3) and tuple(image[0, 0]) == (255, 0, number)
        assert image.flags.owndata and picamera2.opened[0].lent == 0
    capture.release()
    assert picamera2.opened[0].log == ["start", "stop", "close"]


def test_a_skipped_frame_returns_its_buffer(picamera2: type[Camera]) -> None:
    capture = open_picamera(SETTINGS)
    assert capture.grab() and capture.grab()
    assert picamera2.opened[0].lent == 1


def test_the_source_delivers_the_frames(picamera2: type[Camera]) -> None:
    source = PicameraCamera(SETTINGS, SourceContext(bus=None, now_s=lambda: 50.0))
    frame = source.read(timeout_s=2.0)
    source.close()
    assert frame is not None and frame.image.shape == (48, 64, 3)


def test_without_the_library_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "picamera2", None)
    with pytest.raises(InputError, match="apt install python3-picamera2"):
        PicameraCamera(SETTINGS, SourceContext(bus=None, now_s=lambda: 0.0))


def test_a_camera_that_is_not_there_and_a_size_that_it_does_not_give_are_refused(
    picamera2: type[Camera], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OSError, match="no camera 1; present: imx708_wide"):
        open_picamera(PicameraSettings(camera=1))
    monkeypatch.setattr(Camera, "size", (64, 40))
    with pytest.raises(OSError, match="gives 64x40 px and not 64x48"):
        open_picamera(SETTINGS)
    assert picamera2.opened[-1].log == ["close"]
