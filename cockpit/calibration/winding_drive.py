"""Lens and mounting of a camera from an ordinary drive with bends: odometry against the motion of the ground.

The values are those of :mod:`perception.camera.ground_fit`, over many pairs of frames. Distortion is not measured;
that of the camera file is undone.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from perception.camera.odometry import DriveOptics
from perception.camera.road_lines import undistort
from perception.camera.uncertainty import TURN_SIGMA, WAY_SIGMA, turn_camera
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.images.files import decoded_image
from trepid.messages import VehicleState
from trepid.recording.reader import read_recording
from trepid.topics import CAMERA_COMPRESSED, VEHICLE_STATE
from trepid.types import Image

MIN_PAIRS, MAX_PAIRS = 50, 600
STALE_S = 0.1  # age of a vehicle state that is too old for a frame
MAX_DOUBT = 0.1  # of the focal length and the height
MAX_CHANGE = 0.5  # of their logarithms from those of the file, where the tracking begins


class DrivenFrame(NamedTuple):
    """A frame with the odometry at its capture; None where it is not known."""

    image: Image
    t_s: float
    speed_mps: float | None
    yaw_rate_radps: float | None


@dataclass(frozen=True)
class DriveMeasurement:
    """A camera that a drive has measured."""

    camera: Camera
    pairs: int  # of frames
    focal_doubt: float | None  # standard deviation over the value; None: the focal length is that of the file
    height_doubt: float


def recorded_frames(path: Path) -> Iterator[DrivenFrame]:
    """The frames of a recording with the newest vehicle state up to each. Raises InputError."""
    recorded = read_recording(path, CAMERA_COMPRESSED.key, VEHICLE_STATE.key)
    states = sorted((state for _, state in recorded.of(VEHICLE_STATE)), key=lambda state: state.t_s)
    if not states:
        raise InputError(f"{path}: holds no {VEHICLE_STATE.key}: speed and yaw rate are needed")
    number = 0
    for _, frame in recorded.of(CAMERA_COMPRESSED):
        image = decoded_image(frame.jpeg)
        if image is None:
            raise InputError(f"{path}: the frame of {frame.t_s:.3f} s cannot be decoded")
        while number + 1 < len(states) and states[number + 1].t_s <= frame.t_s:
            number += 1
        yield DrivenFrame(image, frame.t_s, *_motion(states[number], frame.t_s))


def _motion(state: VehicleState, t_s: float) -> tuple[float | None, float | None]:
    """Speed and yaw rate of ``state``; None where it is too old."""
    return (state.speed_mps, state.yaw_rate_radps) if abs(t_s - state.t_s) < STALE_S else (None, None)


def camera_by_driving(
    frames: Iterable[DrivenFrame], start: Camera, path: Path, *, lens_known: bool
) -> DriveMeasurement:
    """``start`` with the focal length, unless ``lens_known``, and the mounting that the frames measure.

    Raises InputError where the drive does not measure them.
    """
    optics = DriveOptics(start, pairs=MAX_PAIRS)
    for frame in frames:
        if optics.complete:
            break
        optics.step(undistort(frame.image, start), frame.t_s, frame.speed_mps, frame.yaw_rate_radps)
    found = optics.fit_optics()
    if found is None or optics.pairs < MIN_PAIRS:
        raise InputError(
            f"{path}: the ground is visible in {optics.pairs} pairs of frames, {MIN_PAIRS} expected: drive"
            " longer, by day, on a road with some texture"
        )
    focal_px = start.fx_px if lens_known else found.focal_px
    if focal_px is None:
        raise InputError(
            f"{path}: the drive hardly turns: bends measure the focal length, or a chessboard does beforehand"
        )
    focal_doubt = None if lens_known else math.hypot(found.focal_sigma, TURN_SIGMA)
    height_doubt = math.hypot(found.focal_height_sigma, WAY_SIGMA, focal_doubt or 0.0)
    height_m = found.focal_height_pxm / focal_px
    _check(path, "focal length", focal_px / start.fx_px, focal_doubt or 0.0)
    _check(path, "height", height_m / start.height_m, height_doubt)
    lens = start.model_copy(
        update={
            "fx_px": focal_px,
            "fy_px": focal_px * start.fy_px / start.fx_px,
            "height_m": height_m,
        }
    )
    return DriveMeasurement(turn_camera(found, lens, start), optics.pairs, focal_doubt, height_doubt)


def _check(path: Path, what: str, ratio: float, doubt: float) -> None:
    """Raise InputError for an uncertain value, or one far from that of the file."""
    if doubt > MAX_DOUBT:
        raise InputError(
            f"{path}: the {what} is uncertain by {100 * doubt:.0f} %, {100 * MAX_DOUBT:.0f} % allowed: drive"
            " longer, with more bends"
        )
    if abs(math.log(ratio)) > MAX_CHANGE:
        raise InputError(
            f"{path}: the {what} would be {ratio:.1f} times that of the camera file; name a nearer one with"
            " --camera"
        )
