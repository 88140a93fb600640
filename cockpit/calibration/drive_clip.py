"""Pairs of frames spread over a clip of driving, with the distance between them, for calibration."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cockpit.calibration.height import Step
from cockpit.footage.sources import Clip, Source, Still, sources
from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS, decoded_image
from trepid.images.video import count_frames
from trepid.messages import CompressedFrame
from trepid.recording.reader import read_recording
from trepid.topics import CAMERA_COMPRESSED, VEHICLE_STATE
from trepid.types import Array, Image

MAX_STEPS = 40
MAX_FRAMES = 20_000  # of a folder or video: 13 min at 25 Hz
STALE_S = 0.5  # age of a speed that is too old for a frame
MIN_SPEED_MPS = 1.0  # slower, the distance between two frames is noise


def steps_of(path: Path, *, speed_mps: float | None = None) -> list[Step]:
    """Up to 40 frames of a video, a folder of images (25 a second) or a recording (.mcap), each with the next one.

    The distance between them is that at ``speed_mps`` or at the recorded speed. Raises InputError.
    """
    if path.suffix.lower() == ".mcap":
        return _recorded_steps(path, speed_mps)
    found = sources(path)
    first = found[0]
    count = min(count_frames(path) if isinstance(first, Clip) else len(found), MAX_FRAMES)
    wanted = _spread(count)
    images, t_s = _frames(found, {number for at in wanted for number in (at, at + 1)}, count)
    if len({image.shape for image in images.values()}) > 1:
        raise InputError(f"{path}: frames of different sizes")

    def way_m(at: int) -> float | None:
        return None if speed_mps is None or at + 1 not in t_s else speed_mps * (t_s[at + 1] - t_s[at])

    return [Step(images[at], images.get(at + 1), way_m(at)) for at in wanted if at in images]


def _spread(count: int) -> list[int]:
    """Indices of up to MAX_STEPS frames with a following one, evenly over ``count``."""
    return sorted(set(np.linspace(0, max(count - 2, 0), min(MAX_STEPS, count)).astype(int).tolist()))


def _frames(
    found: Sequence[Source], wanted: set[int], count: int
) -> tuple[dict[int, Image], dict[int, float]]:
    """The frames with the indices ``wanted``, and their times [s]."""
    first = found[0]
    if isinstance(first, Clip):
        shots = {shot.number: shot for shot in first.shots() if shot.number in wanted}
        return {at: shot.image for at, shot in shots.items()}, {at: shot.t_s for at, shot in shots.items()}
    stills = [one for one in found if isinstance(one, Still)]
    images = {number: stills[number].read() for number in sorted(wanted) if number < count}
    return images, {number: number / NOMINAL_FPS for number in images}


def _recorded_steps(path: Path, given_mps: float | None) -> list[Step]:
    """Frames of a recording in which the vehicle drives, at the recorded speeds unless one is given."""
    recorded = read_recording(path, CAMERA_COMPRESSED.key, VEHICLE_STATE.key)
    frames = [frame for _, frame in recorded.of(CAMERA_COMPRESSED)]
    if len(frames) < 2:
        raise InputError(f"{path}: {len(frames)} camera frames in this recording, at least 2 expected")
    states = [state for _, state in recorded.of(VEHICLE_STATE)]
    known = np.array([(s.t_s, s.speed_mps) for s in states if s.speed_mps is not None], float).reshape(-1, 2)
    driven: list[tuple[CompressedFrame, CompressedFrame, float | None]] = []
    for frame, following in pairwise(frames):
        speed_mps = _speed_at(frame.t_s, known) if given_mps is None else given_mps
        dt_s = following.t_s - frame.t_s
        if (speed_mps is None or speed_mps >= MIN_SPEED_MPS) and 0 < dt_s < STALE_S:
            driven.append((frame, following, None if speed_mps is None else speed_mps * dt_s))
    if not driven:
        raise InputError(f"{path}: the vehicle never drives {MIN_SPEED_MPS} m/s in this recording")
    chosen = sorted({*np.linspace(0, len(driven) - 1, MAX_STEPS).astype(int).tolist()})
    return [Step(_image(driven[at][0]), _image(driven[at][1]), driven[at][2]) for at in chosen]


def _speed_at(t_s: float, known: Array) -> float | None:
    """The speed [m/s] by the recorded (time, speed), shape (n, 2); None without one within ``STALE_S``."""
    times_s, speeds_mps = known.T
    if not len(known) or np.abs(times_s - t_s).min() > STALE_S:
        return None
    return float(np.interp(t_s, times_s, speeds_mps))


def _image(frame: CompressedFrame) -> Image:
    image = decoded_image(frame.jpeg)
    if image is None:
        raise InputError(f"the frame of {frame.t_s:.3f} s cannot be decoded")
    return image
