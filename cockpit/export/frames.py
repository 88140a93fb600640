"""Driven frames: images with the steering and the speed at their capture, which tubs and LeRobot data sets hold."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cockpit.export.drive import Drive
from trepid.config import InputError
from trepid.topics import VEHICLE_STATE
from trepid.types import Image

USUAL_HZ = 10.0  # of a single image


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenFrame:
    """An image with a known road-wheel angle."""

    t_s: float  # of the capture
    image: Image  # (h, w, 3) BGR
    jpeg: bytes | None  # its bytes, where it was recorded as JPEG
    road_wheel_rad: float  # + = left
    speed_mps: float  # NaN: not known
    by_driver: bool = True  # False: a pilot drove
    episode: int = 0  # number of the piece without pauses, ascending from 0
    split: str = "train"  # of a data set; frames of a split follow each other


def rate_of(image_s: list[float]) -> float:
    """The usual rate of images captured at ``image_s`` [Hz]: 1 / the median of the positive intervals."""
    steps_s = np.diff(image_s)
    steps_s = steps_s[steps_s > 0]
    return float(1 / np.median(steps_s)) if len(steps_s) else USUAL_HZ


def of_drive(drive: Drive, done: Callable[[float], None]) -> Iterator[DrivenFrame]:
    """The recorded images that have a measured road-wheel angle; ``done`` is called with the share that is read.

    Raises InputError when the recording has no images, or none with an angle.
    """
    if not drive.image_s:
        raise InputError(f"{drive.path}: holds no camera image to export")
    found = 0
    for number, (t_s, image, jpeg) in enumerate(drive.images(), start=1):
        done(number / len(drive.image_s))
        state = drive.newest(VEHICLE_STATE, t_s)
        angle_rad = None if state is None else state.road_wheel_angle_rad
        if state is None or angle_rad is None or not math.isfinite(angle_rad):
            continue
        found += 1
        yield DrivenFrame(
            t_s=t_s,
            image=image,
            jpeg=jpeg,
            road_wheel_rad=angle_rad,
            speed_mps=math.nan if state.speed_mps is None else state.speed_mps,
            by_driver=bool(state.driver_override),
        )
    if not found:
        raise InputError(
            f"{drive.path}: no image has a measured road-wheel angle, so there is nothing to export"
        )
