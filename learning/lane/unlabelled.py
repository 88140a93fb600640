"""Drives without labels, whose lanes the network under training gives itself (self-training).

From the share ``after`` of the epochs on, the network gives a lane for each frame before every epoch. A lane counts
where the network is consistent:

- a road is visible in the image and in its mirror image, and the lane of the mirror image is the mirrored lane,
- the frames before and after it in its drive have nearly the same lane.

Nearly: the road-wheel angle of the pure pursuit differs by at most ``agree_deg``. The label is the mean of both
images;
the network learns it from augmented frames, as in FixMatch (Sohn et al., Simplifying Semi-Supervised Learning with
Consistency and Confidence, NeurIPS 2020). The other estimator gives no labels: both would have the same errors.
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cockpit.footage.api import cameras
from cockpit.footage.frames import FrameResult, Unread, results
from cockpit.footage.sources import Source
from learning.lane.scores import LabelledFrames, Prediction, PursuitTask
from perception.lane.view import as_bgr
from perception.net.canonical import MIRRORED, CanonicalView
from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.images.files import NOMINAL_FPS
from trepid.messages import Frame
from trepid.types import Image, Mask, Positive, Share

LEAST_VISIBLE = 0.5


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

    def __len__(self) -> int:
        return len(self.images)

    @property
    def digest(self) -> str:
        """Of images and drives; "" without any."""
        digest = hashlib.sha256(np.ascontiguousarray(self.images).data)
        digest.update(self.drives.tobytes())
        return digest.hexdigest() if len(self) else ""


def none_of(canonical: Camera) -> UnlabelledFrames:
    """No frames."""
    return UnlabelledFrames(
        np.empty((0, canonical.height_px, canonical.width_px, 3), np.uint8), np.empty(0, int)
    )


def read_drives(paths: Sequence[Path], canonical: Camera, *, most_frames: int) -> UnlabelledFrames:
    """The first ``most_frames`` frames of each of ``paths``, of which a folder of images is one drive.

    Camera: that of a recording, else of the car in use, else self-calibrated. Raises InputError.
    """
    camera_for, _ = cameras(None)
    images: list[Image] = []
    drives: list[int] = []
    for number, path in enumerate(paths):
        seen = results(
            [path], camera_for, partial(_image_warp, canonical), Unread(strict=True), drive_fps=NOMINAL_FPS
        )
        with closing(seen):
            drive = [_check_size(frame) for frame in islice(seen, most_frames)]
        images += drive
        drives += [number] * len(drive)
    if not images:
        return none_of(canonical)
    return UnlabelledFrames(np.stack(images), np.array(drives, int), tuple(path.name for path in paths))


def _image_warp(canonical: Camera, _: Source, camera: Camera) -> Callable[[Frame], Image | None]:
    """The canonical image of each frame of ``camera``; None for one of another size."""
    view, size = CanonicalView(camera, canonical), (camera.height_px, camera.width_px)
    return lambda frame: view.image(as_bgr(frame.image)) if frame.image.shape[:2] == size else None


def _check_size(frame: FrameResult[Image | None]) -> Image:
    """The canonical image. Raises InputError for an image of another size than the first of its drive."""
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
    plain, mirror = predict(frames.images), predict(np.ascontiguousarray(frames.images[:, :, ::-1]))
    lanes = (plain.lanes + MIRRORED * mirror.lanes) / 2
    angles_rad = task.road_wheel_angle(lanes)
    sides_rad = task.road_wheel_angle(plain.lanes), task.road_wheel_angle(MIRRORED * mirror.lanes)
    steady = np.abs(sides_rad[0] - sides_rad[1]) <= agree_rad
    steady &= np.minimum(plain.visible, mirror.visible) > LEAST_VISIBLE
    steady &= _like_neighbours(angles_rad, frames.drives, agree_rad)
    return LabelledFrames(frames.images, lanes.astype(np.float32), np.ones(len(frames), bool)).part(steady)


def _like_neighbours(angles_rad: NDArray[np.float64], drives: NDArray[np.int64], agree_rad: float) -> Mask:
    """Whether each angle is near those of the frames before and after it in its drive, as far as there are any."""
    apart = (np.abs(np.diff(angles_rad)) > agree_rad) & (np.diff(drives) == 0)
    return ~(np.append(apart, False) | np.insert(apart, 0, False))
