"""A CSI camera of a Raspberry Pi through picamera2, the Python side of libcamera.

The camera of a Pi 5 and of new systems on a Pi 4 gives no images through V4L2: ``/dev/video0`` is its raw sensor.
picamera2 comes with the system (``apt install python3-picamera2``), because it belongs to the libcamera there.
"""

from functools import partial
from importlib import import_module
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field

from trepid.types import Image, Positive
from vehicle.cameras.device import Capture, Device, DeviceSettings
from vehicle.cameras.source import SourceContext

FORMAT = "RGB888"  # of DRM, by its little-endian word: blue is the first byte of a pixel, as in OpenCV
STAMP = "SensorTimestamp"  # first line exposed [ns] since the start of the system
MS_PER_NS = 1e-6
BUFFERS = 3  # one is read, one waits, one is filled


class PicameraSettings(DeviceSettings):
    """Block ``picamera`` of ``config/camera_source.yaml``."""

    camera: Annotated[int, Field(ge=0)] = 0
    width_px: Annotated[int, Field(ge=16)] = 640
    height_px: Annotated[int, Field(ge=16)] = 480
    rate_hz: Positive = 30.0
    controls: dict[str, float | int | bool] = Field(default_factory=dict)


class PicameraCapture:
    """An open camera of picamera2 in the form of an OpenCV capture."""

    def __init__(self, camera: Any) -> None:
        self._camera = camera
        self._request: Any = None

    def grab(self) -> bool:
        """Wait for the next frame."""
        self._forget()
        self._request = self._camera.capture_request()
        return self._request is not None

    def retrieve(self) -> tuple[bool, Image]:
        """A copy of the grabbed frame, BGR (H, W, 3); its buffer returns to the camera."""
        image = np.array(self._request.make_array("main"), np.uint8)
        self._forget()
        return True, image

    def get(self, propId: int) -> float:
        """CAP_PROP_POS_MSEC: begin of the exposure of the grabbed frame [ms]; 0 for others, or without a stamp."""
        if propId != cv2.CAP_PROP_POS_MSEC:
            return 0.0
        return MS_PER_NS * float(self._request.get_metadata().get(STAMP, 0))

    def release(self) -> None:
        """Stop and close the camera."""
        self._forget()
        self._camera.stop()
        self._camera.close()

    def _forget(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            request.release()


class PicameraCamera(Device):
    """A CSI camera of a Raspberry Pi."""

    Settings = PicameraSettings

    def __init__(self, settings: PicameraSettings, drive: SourceContext) -> None:
        opener = partial(open_picamera, settings)
        super().__init__(opener, settings, now_s=drive.now_s, kernel_stamps=True)


def open_picamera(settings: PicameraSettings) -> Capture:
    """The running camera with its settings. Raises OSError with the reason and the remedy."""
    try:
        library = import_module("picamera2")
    except ModuleNotFoundError as error:
        raise OSError(
            f"Python finds no module {error.name}; `sudo apt install python3-picamera2`, in an environment with"
            " --system-site-packages"
        ) from error
    present = library.Picamera2.global_camera_info()
    if settings.camera >= len(present):
        names = ", ".join(str(one.get("Model", "?")) for one in present) or "none"
        raise OSError(
            f"no camera {settings.camera}; present: {names}; `rpicam-hello --list-cameras` lists them"
        )
    camera = library.Picamera2(settings.camera)
    try:
        period_us = round(1e6 / settings.rate_hz)
        camera.configure(
            camera.create_video_configuration(
                main={"size": (settings.width_px, settings.height_px), "format": FORMAT},
                controls={"FrameDurationLimits": (period_us, period_us), **settings.controls},
                buffer_count=BUFFERS,
            )
        )
        got = camera.camera_configuration()["main"]["size"]
        if tuple(got) != (settings.width_px, settings.height_px):
            raise OSError(
                f"the camera gives {got[0]}x{got[1]} px and not {settings.width_px}x{settings.height_px}; set these"
            )
        camera.start()
    except Exception:
        camera.close()
        raise
    return PicameraCapture(camera)
