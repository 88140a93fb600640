"""Drives without labels, whose lanes an estimator or the network under training gives.

**A teacher** gives each frame its lane once, before the training; the lane counts where it is sure in the frame and
in its mirror image. `segments` has seen real streets; the terms of its training data hold for weights that it
taught. `cv` learned from no data, and its lanes are right where lines are plain, as on a motorway by day.

**The network itself** (self-training) gives each frame its lane before every epoch from the share ``after`` of the
epochs on; the lane counts where a road is visible in the image and in its mirror image.

In both cases the lane of the mirror image has to be the mirrored lane, and the frames before and after in the drive
have to have nearly the same one. Nearly: the road-wheel angle of the pure pursuit differs by at most ``agree_deg``.
The label is the mean of both images; the network learns it from augmented frames, as in FixMatch (Sohn et al.,
Simplifying Semi-Supervised Learning with Consistency and Confidence, NeurIPS 2020).
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cockpit.footage.api import cameras, check_estimator
from cockpit.footage.frames import FrameResult, Unread, results
from cockpit.footage.sources import Source
from learning.lane.scores import LabelledFrames, Prediction, PursuitTask
from perception.estimators import entry_of
from perception.lane.view import as_bgr
from perception.net.canonical import MIRRORED, CanonicalView, row_of_lane
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, InputError, Settings, load
from trepid.images.files import NOMINAL_FPS
from trepid.messages import Frame
from trepid.types import Array, Floats, Image, Mask, Positive, Share

LEAST_VISIBLE = 0.5  # of a road, by the network
LEAST_SURE = 0.8  # confidence of a teacher


class SelfTraining(Settings):
    """Section ``self_training`` of ``config/train.yaml``."""

    share: Share
    after: Share
    agree_deg: Positive
    most_frames: Annotated[int, Field(ge=1)]


@dataclass(frozen=True, slots=True)
class UnlabelledFrames:
    """Canonical images of drives, in the order of the drives."""

    images: Image  # (n, height, width, 3)
    drives: NDArray[np.int64]  # (n,): number of the drive
    names: tuple[str, ...] = ()  # of the files, by number of the drive
    taught: tuple[Prediction, Prediction] | None = None  # by a teacher, of the images and of mirror images

    def __len__(self) -> int:
        return len(self.images)

    @property
    def digest(self) -> str:
        """Of images and drives; "" without any."""
        digest = hashlib.sha256(np.ascontiguousarray(self.images).data)
        digest.update(self.drives.tobytes())
        for one in self.taught or ():
            digest.update(one.lanes.tobytes() + one.visible.tobytes())
        return digest.hexdigest() if len(self) else ""


def none_of(canonical: Camera) -> UnlabelledFrames:
    """No frames."""
    return UnlabelledFrames(
        np.empty((0, canonical.height_px, canonical.width_px, 3), np.uint8), np.empty(0, int)
    )


def read_drives(
    paths: Sequence[Path], canonical: Camera, *, most_frames: int, teacher: str = "", lookahead_m: float = 0.0
) -> UnlabelledFrames:
    """The first ``most_frames`` frames of each of ``paths``, of which a folder of images is one drive.

    Camera: that of a recording, else of the car in use, else self-calibrated. ``teacher``: the estimator that gives
    the lanes, with the curvature at ``lookahead_m``; "": none. Raises InputError.
    """
    camera_for, _ = cameras(None)
    if teacher:
        check_estimator(teacher)
    step_of = partial(_step_of, canonical, teacher, lookahead_m)
    frames: list[TaughtFrame] = []
    drives: list[int] = []
    for number, path in enumerate(paths):
        seen = results([path], camera_for, step_of, Unread(strict=True), drive_fps=NOMINAL_FPS)
        with closing(seen):
            drive = [_check_size(frame) for frame in islice(seen, most_frames)]
        frames += drive
        drives += [number] * len(drive)
    if not frames:
        return none_of(canonical)
    images, names = np.stack([one.image for one in frames]), tuple(path.name for path in paths)
    taught = (_predictions(frames, 0), _predictions(frames, 1)) if teacher else None
    return UnlabelledFrames(images, np.array(drives, int), names, taught)


class TaughtFrame(NamedTuple):
    """A frame: its canonical image, and the lanes of a teacher in it and in its mirror image."""

    image: Image
    lanes: Floats  # (2, 5), of the canonical images; NaN without a lane
    sure: Array  # (2,)


def _step_of(
    canonical: Camera, teacher: str, lookahead_m: float, _: Source, camera: Camera
) -> Callable[[Frame], TaughtFrame | None]:
    """The step of a drive from ``camera``; None for an image of another size."""
    view, size = CanonicalView(camera, canonical), (camera.height_px, camera.width_px)
    both = (camera, mirror_camera(camera)) if teacher else ()
    eyes = [_Teacher(teacher, one, canonical, lookahead_m) for one in both]

    def step(frame: Frame) -> TaughtFrame | None:
        if frame.image.shape[:2] != size:
            return None
        image = as_bgr(frame.image)
        sides = zip(eyes, (1, -1), strict=False)
        found = [eye(np.ascontiguousarray(image[:, ::side]), frame.t_s) for eye, side in sides]
        lanes, sure = zip(*found, strict=True) if found else ((), ())
        return TaughtFrame(view.image(image), np.array(lanes, np.float32), np.array(sure))

    return step


def mirror_camera(camera: Camera) -> Camera:
    """The camera of the mirror images, which show the mirrored road."""
    lens = list(camera.distortion)
    if len(lens) > 3:
        lens[3] *= -1  # p2, tangential along the columns
    return camera.model_copy(
        update=dict(
            cx_px=camera.width_px - 1 - camera.cx_px,
            distortion=tuple(lens),
            y_m=-camera.y_m,
            yaw_rad=-camera.yaw_rad,
        )
    )


class _Teacher:
    """An estimator for the frames of one drive, whose lanes are those of the canonical images."""

    def __init__(self, name: str, camera: Camera, canonical: Camera, lookahead_m: float) -> None:
        # In the metres of the camera, be it assumed or not: its canonical image has no others.
        self._estimator = entry_of(name).build(camera, load(CONFIG_DIR / "vehicle.yaml", Vehicle))
        self._view, self._lookahead_m = CanonicalView(camera, canonical), lookahead_m

    def __call__(self, image: Image, t_s: float) -> tuple[Floats, float]:
        """The lane as a row, NaN without one that this image shows, and its confidence."""
        found = self._estimator.step(Frame(t_s=t_s, image=image), None, now_s=t_s)
        lane, width_m = Lane.of_message(found), found.lane_width_m
        if lane is None or width_m is None or found.reason:  # or remembered
            return np.full(len(MIRRORED), np.nan, np.float32), 0.0
        width_m /= self._view.scale
        return row_of_lane(self._view.canonical_lane(lane), width_m, self._lookahead_m), found.confidence


def _predictions(frames: Sequence[TaughtFrame], which: int) -> Prediction:
    """The lanes of the images (0) or of their mirror images (1), whose deviation a teacher does not state."""
    lanes = np.stack([one.lanes[which] for one in frames])
    sure = np.array([one.sure[which] for one in frames])
    return Prediction(lanes, np.full(len(frames), np.nan), sure)


def _check_size(frame: FrameResult[TaughtFrame | None]) -> TaughtFrame:
    """The frame. Raises InputError for an image of another size than the first of its drive."""
    if frame.result is None:
        height, width = frame.image.shape[:2]
        raise InputError(
            f"{frame.path}: image {frame.number} has {width} x {height} px, unlike the first one"
        )
    return frame.result


def label_by_network(
    predict: Callable[[Image], Prediction], frames: UnlabelledFrames, task: PursuitTask, *, agree_rad: float
) -> LabelledFrames:
    """The frames in which the network is consistent, with its lanes."""
    if not len(frames):
        return LabelledFrames(frames.images, np.empty((0, len(MIRRORED)), np.float32), np.empty(0, bool))
    both = predict(frames.images), predict(np.ascontiguousarray(frames.images[:, :, ::-1]))
    return _label(frames, both, task, agree_rad=agree_rad, least=LEAST_VISIBLE)


def label_by_teacher(frames: UnlabelledFrames, task: PursuitTask, *, agree_rad: float) -> LabelledFrames:
    """The frames in which the teacher is sure and consistent, with its lanes."""
    assert frames.taught is not None
    return _label(frames, frames.taught, task, agree_rad=agree_rad, least=LEAST_SURE)


def _label(
    frames: UnlabelledFrames,
    both: tuple[Prediction, Prediction],
    task: PursuitTask,
    *,
    agree_rad: float,
    least: float,
) -> LabelledFrames:
    """The frames in which ``both``, of the images and of their mirror images, agree with more than ``least``."""
    plain, mirror = both
    lanes = (plain.lanes + MIRRORED * mirror.lanes) / 2
    sides_rad = task.road_wheel_angle(plain.lanes), task.road_wheel_angle(MIRRORED * mirror.lanes)
    steady = np.abs(sides_rad[0] - sides_rad[1]) <= agree_rad  # False without a lane
    steady &= np.minimum(plain.visible, mirror.visible) > least
    steady &= _like_neighbours(task.road_wheel_angle(lanes), frames.drives, agree_rad)
    return LabelledFrames(frames.images, lanes.astype(np.float32), np.ones(len(frames), bool)).part(steady)


def _like_neighbours(angles_rad: NDArray[np.float64], drives: NDArray[np.int64], agree_rad: float) -> Mask:
    """Whether each angle is near those of the frames before and after it in its drive, as far as there are any."""
    apart = (np.abs(np.diff(angles_rad)) > agree_rad) & (np.diff(drives) == 0)
    return ~(np.append(apart, False) | np.insert(apart, 0, False))
