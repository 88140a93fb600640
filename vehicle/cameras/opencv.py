"""Cameras through OpenCV: V4L2 devices and GStreamer pipelines."""

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
from pydantic import Field, field_validator

from trepid.types import Positive
from vehicle.cameras.device import Capture, Device, DeviceSettings
from vehicle.cameras.source import SourceContext

DEVICES = Path("/dev")
Control = Literal[
    "auto_exposure",
    "exposure",
    "gain",
    "brightness",
    "contrast",
    "saturation",
    "sharpness",
    "gamma",
    "auto_wb",
    "wb_temperature",
    "autofocus",
    "focus",
    "zoom",
]
Pixels = Annotated[int, Field(ge=16)]


class V4l2Settings(DeviceSettings):
    """Block ``v4l2`` of ``config/camera_source.yaml``."""

    device: Annotated[int, Field(ge=0)] | Annotated[str, Field(min_length=1)] = 0
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    rate_hz: Positive | None = None
    fourcc: Annotated[str, Field(min_length=4, max_length=4)] | None = None
    controls: dict[Control, float] = Field(default_factory=dict)

    @property
    def path(self) -> Path:
        """The device file: ``/dev/video<n>`` of an index."""
        return DEVICES / f"video{self.device}" if isinstance(self.device, int) else Path(self.device)

    @property
    def properties(self) -> list[tuple[str, int, float]]:
        """Name, property of OpenCV and value to set, in the order in which drivers need them."""
        wanted: list[tuple[str, int, float | None]] = [
            ("fourcc", cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self.fourcc) if self.fourcc else None),
            ("width_px", cv2.CAP_PROP_FRAME_WIDTH, self.width_px),
            ("height_px", cv2.CAP_PROP_FRAME_HEIGHT, self.height_px),
            ("rate_hz", cv2.CAP_PROP_FPS, self.rate_hz),
            *(
                (name, getattr(cv2, f"CAP_PROP_{name.upper()}"), value)
                for name, value in self.controls.items()
            ),
        ]
        return [(name, number, value) for name, number, value in wanted if value is not None]


class GstreamerSettings(DeviceSettings):
    """Block ``gstreamer`` of ``config/camera_source.yaml``."""

    pipeline: str

    @field_validator("pipeline")
    @classmethod
    def _ends_in_the_program(cls, pipeline: str) -> str:
        if "appsink" not in pipeline:
            raise ValueError(
                "must end in an appsink, such as '… ! videoconvert ! appsink drop=true max-buffers=1'"
            )
        return pipeline


class V4l2Camera(Device):
    """A camera of the kernel: USB and most built-in ones."""

    Settings = V4l2Settings

    def __init__(self, settings: V4l2Settings, drive: SourceContext) -> None:
        opener = partial(open_v4l2, settings)
        super().__init__(opener, settings, now_s=drive.now_s, kernel_stamps=True)


class GstreamerCamera(Device):
    """A pipeline of GStreamer, for cameras with drivers of their own and for streams."""

    Settings = GstreamerSettings

    def __init__(self, settings: GstreamerSettings, drive: SourceContext) -> None:
        opener = partial(open_gstreamer, settings)
        super().__init__(opener, settings, now_s=drive.now_s, kernel_stamps=False)


def open_v4l2(settings: V4l2Settings, capture_of: Any = cv2.VideoCapture) -> Capture:
    """The device with its settings. Raises OSError with the reason and the remedy.

    ``capture_of``: constructor of an OpenCV capture from a name and a back end.
    """
    path = settings.path
    if not path.exists():
        present = ", ".join(sorted(str(one) for one in DEVICES.glob("video*"))) or "none"
        raise OSError(f"{path}: no such device; present: {present}; plug the camera in or set device")
    if not os.access(path, os.R_OK | os.W_OK):
        raise OSError(f"{path}: no permission; add this user to the group video")
    capture = capture_of(os.path.realpath(path), cv2.CAP_V4L2)  # a link leads elsewhere after plugging in
    if not capture.isOpened():
        capture.release()
        raise OSError(f"{path}: cannot be opened as a camera; it may be in use, or no capture device")
    for name, number, value in settings.properties:
        if not capture.set(number, value):
            capture.release()
            raise OSError(
                f"{path}: the driver refuses {name} = {value:g}; `v4l2-ctl --list-ctrls-menus` lists all"
            )
    return capture


def open_gstreamer(settings: GstreamerSettings, capture_of: Any = cv2.VideoCapture) -> Capture:
    """The running pipeline. Raises OSError with the reason and the remedy."""
    if not cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER):
        raise OSError(
            "this OpenCV is built without GStreamer, as all wheels of PyPI are; install one that has it (Debian:"
            " python3-opencv), or use the source v4l2"
        )
    capture = capture_of(settings.pipeline, cv2.CAP_GSTREAMER)
    if not capture.isOpened():
        capture.release()
        raise OSError("the pipeline does not start; try it with gst-launch-1.0 and autovideosink for appsink")
    return capture
