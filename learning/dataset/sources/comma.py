"""Segments of comma2k19: ``video.hevc``, the times of its frames and the CAN of the car.

Schafer and others, A Commute in Data: The comma2k19 Dataset (2018). A segment is a folder with
``global_pose/frame_times`` and ``processed_log/CAN/{speed,steering_angle}/{t,value}`` as arrays of NumPy, with or
without ``.npy``; files with ``__`` for ``/`` and without ``processed_log`` are read too. A folder of numbered
segments is one route. The angle is that of the steering wheel [deg], positive to the left.
"""

import math
from pathlib import Path

import numpy as np

from learning.dataset.sources.log import Log, SteeringUnit
from trepid.config import InputError
from trepid.images.files import IMAGE_SUFFIXES, natural_order
from trepid.recording.interpolation import between
from trepid.types import Array, Column

TIMES = "global_pose/frame_times"
SPEED, ANGLE, GYRO = "processed_log/CAN/speed", "processed_log/CAN/steering_angle", "processed_log/IMU/gyro"
VIDEOS = ("video.hevc", "video.mp4")


def is_comma(path: Path) -> bool:
    """Whether ``path`` is a segment or a route of comma2k19."""
    return path.is_dir() and bool(_segments(path))


def read_comma(path: Path) -> Log:
    """The frames of a segment, or of all segments of a route. Raises InputError."""
    parts = [_segment(segment) for segment in _segments(path)]
    image = [
        name if segment == path else f"{segment.name}/{name}"
        for segment, (names, *_) in zip(_segments(path), parts, strict=True)
        for name in names
    ]
    item, t_s, steering, speed_mps, yaw_rate = (
        np.concatenate([part[at] for part in parts]) for at in range(1, 6)
    )
    return Log(
        kind="comma2k19",
        path=path,
        root=path,
        files=tuple(file for segment in _segments(path) for file in _files(segment)),
        image=image,
        item=item.astype(np.int64),
        t_s=t_s,
        route=[path.name] * len(image),
        steering=steering,
        speed_mps=speed_mps,
        yaw_rate_radps=yaw_rate,
        why=[""] * len(image),
        unit=SteeringUnit.WHEEL,
        left_positive=True,
    )


def _segments(path: Path) -> list[Path]:
    if _array(path, TIMES) is not None:
        return [path]
    numbered = [folder for folder in path.iterdir() if folder.name.isdecimal() and folder.is_dir()]
    return [folder for folder in natural_order(numbered) if _array(folder, TIMES) is not None]


def _array(segment: Path, name: str) -> Path | None:
    flat = name.removeprefix("processed_log/").replace("/", "__")
    places = (segment / name, segment / f"{name}.npy", segment / f"{flat}.npy", segment / flat)
    return next((place for place in places if place.is_file()), None)


def _files(segment: Path) -> list[Path]:
    names = (TIMES, *(f"{quantity}/{part}" for quantity in (SPEED, ANGLE, GYRO) for part in ("t", "value")))
    return [path for name in names if (path := _array(segment, name)) is not None]


def _load_array(segment: Path, name: str) -> Array:
    path = _array(segment, name)
    if path is None:
        raise InputError(f"{segment}: no {name} (nor {name}.npy): not a whole segment of comma2k19")
    try:
        return np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise InputError(f"{path}: no array of numbers of NumPy: {error}") from error


def _series(segment: Path, quantity: str, width: int = 1) -> tuple[Column, Array]:
    """Times (n,) and values (n, width) of a quantity. Raises InputError."""
    t_s, values = _times(segment, f"{quantity}/t"), _load_array(segment, f"{quantity}/value")
    if values.size != width * len(t_s) or values.shape[:1] != t_s.shape:
        raise InputError(
            f"{segment}: {quantity}: values of shape {values.shape} for {len(t_s)} times;"
            f" expected {len(t_s)} × {width}"
        )
    return t_s, values.reshape(len(t_s), width)


def _times(segment: Path, name: str) -> Column:
    t_s = _load_array(segment, name)
    if t_s.ndim != 1 or not np.isfinite(t_s).all():
        raise InputError(f"{segment}: {name}: expected a column of times, got the shape {t_s.shape}")
    return t_s


def _segment(segment: Path) -> tuple[list[str], Column, Column, Column, Column, Column]:
    """Names of the images, their numbers, times, steering-wheel angle [rad], speed, yaw rate."""
    t_s = _times(segment, TIMES)
    names, numbers = _images(segment, len(t_s))
    (angle_s, angle_deg), (speed_s, speed_mps) = _series(segment, ANGLE), _series(segment, SPEED)
    yaw = np.full(len(t_s), math.nan)
    if _array(segment, f"{GYRO}/t") is not None:  # z down
        then_s, rates = _series(segment, GYRO, width=3)
        yaw = between(t_s, then_s, -rates[:, 2])
    angle_rad = np.radians(between(t_s, angle_s, angle_deg[:, 0]))
    return names, numbers, t_s, angle_rad, between(t_s, speed_s, speed_mps[:, 0]), yaw


def _images(segment: Path, count: int) -> tuple[list[str], Column]:
    video = next((name for name in VIDEOS if (segment / name).is_file()), None)
    if video is not None:
        return [video] * count, np.arange(count, dtype=np.float64)
    folder = segment / "frames"
    found = (
        natural_order(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        if folder.is_dir()
        else []
    )
    if not found:
        raise InputError(
            f"{segment}: no {VIDEOS[0]} and no folder frames: a segment without images cannot be learned"
        )
    if len(found) != count:
        raise InputError(f"{folder}: {len(found)} images, but {count} frame times")
    return [f"frames/{path.name}" for path in found], np.full(count, -1.0)
