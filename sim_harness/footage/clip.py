"""A recorded drive: frames, times, speeds and yaw rates."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.integrate import cumulative_trapezoid

from cockpit.footage.sources import sources
from sim_harness.footage.visual_motion import yaw_changes_rad
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS
from trepid.loudness import note
from trepid.recording.csv_file import (
    MPS_PER_MPH,
    column_names,
    read_rows,
    refuse_halved_numbers,
    refuse_rounded_times,
    seconds_of_date,
)
from trepid.recording.interpolation import between
from trepid.recording.reader import read_recording
from trepid.topics import VEHICLE_STATE
from trepid.types import Array, Image

UDACITY_COLUMNS = 7  # center, left, right, steering, throttle, brake, speed [mph]; a header is optional
UDACITY_STAMP = re.compile(r"_(\d+)_(\d+)_(\d+)_(\d+)_(\d+)_(\d+)_(\d+)\.\w+$")
LEAST_TRACKED = 0.5  # least share of the frames with a measured yaw rate
SMOOTH_S = 0.2  # of the yaw rate
LEAST_FRAMES = 5
CRAWL_MPS = 0.01  # so that every frame has a time of its own, also at standstill


@dataclass(frozen=True)
class ClipFrames:
    """n frames in order."""

    name: str
    frames: Sequence[Image]  # undistorted, of the size of the camera
    t_s: Array  # from 0 on
    speed_mps: Array
    camera: Camera  # without distortion
    given_yaw_radps: Array | None = None  # + = to the left; None: measured in the images

    @property
    def station_m(self) -> Array:
        """Distance driven at each frame, from 0 on."""
        return np.asarray(cumulative_trapezoid(self.speed_mps, self.t_s, initial=0.0))

    @cached_property
    def yaw_rates_radps(self) -> Array:
        """Yaw rate of the recorded car at each frame, + = to the left, given or from the images (visual_motion).

        Raises InputError when too few corners can be tracked.
        """
        if self.given_yaw_radps is not None:
            return self.given_yaw_radps
        dt_s = np.diff(self.t_s)
        rates = yaw_changes_rad(self.frames, self.camera, np.diff(self.station_m)) / dt_s
        known = np.isfinite(rates)
        if known.mean() < LEAST_TRACKED:
            raise InputError(
                f"{self.name}: too few corners can be tracked to measure the yaw rate of the recorded car"
            )
        middles_s = (self.t_s[1:] + self.t_s[:-1]) / 2
        at_frames = np.interp(self.t_s, middles_s[known], rates[known])
        return _smooth(at_frames, max(1, round(SMOOTH_S / float(np.median(dt_s)))))


def load_drive(
    path: Path,
    camera: Camera,
    *,
    speed_mps: float | None = None,
    log: Path | None = None,
    scale: float = 1.0,
    skip: int = 0,
    most: int | None = None,
) -> ClipFrames:
    """The frames of a video, a recording or a folder (25 frames/s) from number ``skip`` on.

    At most ``most`` are read. The speed is ``speed_mps``, or that of ``log`` (see read_log) times ``scale``, for a
    ``camera`` of another scale of length; with both, the logged distance is driven at ``speed_mps``. Without either
    it is the recorded one. Raises InputError.
    """
    end = None if most is None else skip + most
    source = sources(path, drive_fps=NOMINAL_FPS)[0]
    shots = list(islice(source.shots(), skip, end))
    images = [shot.image for shot in shots]
    if len(images) < LEAST_FRAMES:
        raise InputError(
            f"{path}: {len(images)} frames from number {skip} on: at least {LEAST_FRAMES} expected"
        )
    sizes = {image.shape for image in images}
    if len(sizes) > 1:
        raise InputError(f"{path}: frames of different sizes: {', '.join(map(str, sorted(sizes)))}")
    camera = camera.resize(images[0].shape[1], images[0].shape[0])
    t_s = np.array([shot.t_s for shot in shots]) - shots[0].t_s
    speeds = np.full(len(images), speed_mps or math.nan)
    if speed_mps is None and log is None:
        speeds = recorded_speeds(path, np.array([shot.t_s for shot in shots]))
        part = _with_speed(path, t_s, speeds, skip)
        images, speeds, t_s = images[part], speeds[part], t_s[part] - t_s[part][0]
    if log is not None:
        t_s, speeds = (column[skip : skip + len(images)] for column in read_log(log))
        if len(t_s) < len(images):
            raise InputError(f"{log}: has {skip + len(t_s)} rows, but {path} has {skip + len(images)} frames")
        t_s, speeds = t_s - t_s[0], scale * speeds
        if speed_mps is not None:
            stations_m = cumulative_trapezoid(np.maximum(speeds, CRAWL_MPS), t_s, initial=0.0)
            t_s, speeds = stations_m / speed_mps, np.full(len(images), speed_mps)
    frames = [undistort(image, camera) for image in images]
    return ClipFrames(path.name, frames, t_s, speeds, camera.model_copy(update={"distortion": ()}))


def recorded_speeds(path: Path, t_s: Array) -> Array:
    """The measured speeds [m/s] of a recording at the times ``t_s``; NaN where none was measured around them.

    Raises InputError when there is none at all.
    """
    states = [state for _, state in read_recording(path, VEHICLE_STATE.key).of(VEHICLE_STATE)]
    measured = {state.t_s: state.speed_mps for state in states}
    at_s = np.array(sorted(measured))
    speeds = between(t_s, at_s, np.array([measured[t] for t in at_s], dtype=np.float64))  # None: NaN
    if not np.isfinite(speeds).any():
        raise InputError(f"{path}: states no speed of the vehicle: give --speed or --log")
    return speeds


def _with_speed(path: Path, t_s: Array, speeds: Array, skip: int) -> slice:
    """The frames from the first with a speed to the last; a note gives the number of the others.

    Raises InputError when there is a frame without a speed between them, or fewer than LEAST_FRAMES are left.
    """
    known = np.flatnonzero(np.isfinite(speeds))
    first, last = int(known[0]), int(known[-1])
    gaps = np.flatnonzero(np.diff(known) > 1)
    if len(gaps):
        before, after = known[gaps[0]], known[gaps[0] + 1]
        raise InputError(
            f"{path}: states no speed of the vehicle for {t_s[after] - t_s[before]:.1f} s"
            f" after frame {skip + before}: give --speed or --log, or choose frames by --skip and --frames"
        )
    if len(known) < LEAST_FRAMES:
        raise InputError(f"{path}: {len(known)} frames with a speed: at least {LEAST_FRAMES} expected")
    if len(known) < len(speeds):
        note(f"{path}: {len(speeds) - len(known)} frames at the ends have no speed and are left out")
    return slice(first, last + 1)


def read_log(path: Path) -> tuple[Array, Array]:
    """Times [s] and speeds [m/s], one row a frame. Raises InputError with the line of the first bad row.

    Either a CSV file with the columns ``t_s`` and ``speed_mps``, or a driving_log.csv of the Udacity
    behavioural-cloning simulator, with the times in the names of its images.
    """
    rows = read_rows(path)
    header = column_names(rows[0], ("t_s", "speed_mps"))
    if {"t_s", "speed_mps"} <= set(header):
        columns = header.index("t_s"), header.index("speed_mps")
        values = [_numbers(path, row.line, row.cells, columns) for row in rows[1:]]
    elif len(header) == UDACITY_COLUMNS or UDACITY_STAMP.search(header[0]):
        refuse_halved_numbers(path, rows, UDACITY_COLUMNS)
        rows = rows[1:] if header[0].lower() == "center" else rows
        values = [_udacity(path, row.line, row.cells) for row in rows]
    else:
        raise InputError(f"{path}:1:1: expected the columns t_s and speed_mps, or a Udacity driving_log.csv")
    refuse_rounded_times(path, "t_s", np.array([t_s for t_s, _ in values]))
    for n, (before, after) in enumerate(pairwise(values), start=2):
        if after[0] <= before[0]:
            raise InputError(f"{path}: time does not rise at row {n}: {after[0]} s")
    times, speeds = np.array(values, float).reshape(-1, 2).T
    return times, speeds


def _numbers(path: Path, line: int, row: list[str], columns: tuple[int, int]) -> tuple[float, float]:
    try:
        time, speed = (row[column] for column in columns)
        date_s = seconds_of_date(time.strip())
        t_s, speed_mps = float(time) if date_s is None else date_s, float(speed)
    except (ValueError, IndexError):
        t_s = speed_mps = math.nan
    if not (math.isfinite(t_s) and math.isfinite(speed_mps) and speed_mps >= 0.0):
        raise InputError(
            f"{path}:{line}:1: expected a time and a speed of at least 0, got {', '.join(row)!r}"
        )
    return t_s, speed_mps


def _udacity(path: Path, line: int, row: list[str]) -> tuple[float, float]:
    """center_2018_07_16_17_11_43_382.jpg,,,steering,throttle,brake,speed [mph]."""
    stamp = UDACITY_STAMP.search(row[0].strip())
    if stamp is None or len(row) != UDACITY_COLUMNS:
        raise InputError(f"{path}:{line}:1: expected 7 columns, the first an image named by its time")
    _, _, day, hour, minute, second, milli = map(int, stamp.groups())
    t_s = ((day * 24 + hour) * 60 + minute) * 60 + second + milli / 1000
    speed = _numbers(path, line, [str(t_s), row[6]], (0, 1))[1]
    return t_s, speed * MPS_PER_MPH


def undistort(image: Image, camera: Camera) -> Image:
    """``image`` of ``camera`` without the distortion of its lens."""
    if not any(camera.distortion):
        return image
    return cv2.undistort(image, camera.intrinsics, camera.lens).astype(np.uint8, copy=False)


def _smooth(values: Array, count: int) -> Array:
    """Mean over ``count`` neighbours; fewer at the ends."""
    kernel = np.ones(count)
    weights = np.convolve(np.ones_like(values), kernel, mode="same")
    return np.asarray(np.convolve(values, kernel, mode="same") / weights)
