"""Frames of any source as working images: upright, of the size that ``config/camera.yaml`` describes.

This is the only place in which a live image is scaled. The intrinsics of ``camera.yaml`` belong to the working
image, so that scaling the image by (s_x, s_y) scales f_x, c_x by s_x and f_y, c_y by s_y against the lens.
"""

from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field

from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.images.jpeg import BUDGET_KB_PER_S
from trepid.messages import Frame
from trepid.types import Image, Positive

_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
_FLIPS = {"horizontal": 1, "vertical": 0}


class Mount(Settings):
    """Section ``mount`` of ``config/camera_source.yaml``: the image is mirrored, then turned."""

    mirror: Literal["none", "horizontal", "vertical"] = "none"
    rotate_deg: Literal[0, 90, 180, 270] = 0  # clockwise

    def upright(self, image: Image) -> Image:
        """The corrected image; 90 and 270 degrees exchange width and height. The values of the pixels are exact."""
        if self.mirror != "none":
            image = np.asarray(cv2.flip(image, _FLIPS[self.mirror]), np.uint8)
        if self.rotate_deg:
            image = np.asarray(cv2.rotate(image, _TURNS[self.rotate_deg]), np.uint8)
        return image


SAME_RATIO = 0.01  # tolerance of width over height


class WorkingSettings(Settings):
    """The fields of ``config/camera_source.yaml`` that hold for every source."""

    source: Annotated[str, Field(min_length=1)]
    mount: Mount = Mount()
    fit: Literal["refuse", "crop", "stretch"] = "refuse"
    rate_hz: Positive | None = None
    compressed_hz: Positive | None = None
    compressed_kb_per_s: Positive = BUDGET_KB_PER_S
    silence_s: Positive = 0.3


class Unfit(Exception):
    """A frame that cannot become a working image; the text gives the reason."""


class Working:
    """The step from the image of a source to the working image."""

    def __init__(self, settings: WorkingSettings, camera: Camera) -> None:
        """``camera``: describes the working image."""
        self._mount, self._fit = settings.mount, settings.fit
        self._size = camera.width_px, camera.height_px
        self.source_size: tuple[int, int] | None = None
        """Width and height [px] of the first image, before it is turned; None before it."""

    def step(self, frame: Frame) -> Frame:
        """The working image of ``frame``, with its time.

        Raises InputError when the first image has another aspect ratio than the camera and ``fit`` refuses it,
        and Unfit for a later image of another size than the first, or for an image of an unknown layout.
        """
        image = _bgr(frame.image)
        size = image.shape[1], image.shape[0]
        if self.source_size is not None and size != self.source_size:
            raise Unfit(
                "frames of {} x {} px refused: the camera began with {} x {}".format(*size, *self.source_size)
            )
        image = self._mount.upright(image)
        if self._fit == "crop":
            image = _crop(image, self._size[0] / self._size[1])
        elif self._fit == "refuse":
            self._check(image)
        self.source_size = size
        if (image.shape[1], image.shape[0]) != self._size:
            image = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        return Frame(t_s=frame.t_s, image=np.ascontiguousarray(image))

    def _check(self, image: Image) -> None:
        height_px, width_px = image.shape[:2]
        if abs(width_px / height_px / (self._size[0] / self._size[1]) - 1) > SAME_RATIO:
            wanted = "{} x {}".format(*self._size)
            raise InputError(
                f"the source gives {width_px} x {height_px} px upright, camera.yaml describes {wanted}: measure"
                " this camera (trepid camera calibrate), or set fit: crop or fit: stretch in camera_source.yaml"
            )


def _bgr(image: Image) -> Image:
    """A copy or view of shape (height, width, 3). Raises Unfit for another layout."""
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or 0 in image.shape:
        raise Unfit(f"an image of {image.dtype} with shape {image.shape} refused: uint8 grey or BGR expected")
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels == 3:
        return image
    if channels not in (1, 4):
        raise Unfit(f"an image of {channels} channels refused: 1, 3 or 4 expected")
    code = cv2.COLOR_GRAY2BGR if channels == 1 else cv2.COLOR_BGRA2BGR
    return np.asarray(cv2.cvtColor(image, code), np.uint8)


def _crop(image: Image, ratio: float) -> Image:
    """The largest part of ``image`` with width over height ``ratio`` around its middle."""
    height_px, width_px = image.shape[:2]
    wide, high = min(width_px, round(height_px * ratio)), min(height_px, round(width_px / ratio))
    x, y = (width_px - wide) // 2, (height_px - high) // 2
    return image[y : y + high, x : x + wide]
