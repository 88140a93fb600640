"""Data sets in the layouts of other tools: a tub of donkeycar, a LeRobot data set.

The angle is the label: that of a car without understeer.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from cockpit.export.frames import DrivenFrame, rate_of
from cockpit.export.lerobot import write_lerobot
from cockpit.export.tub import write_tub
from learning.dataset.dataset import Dataset, middle_rows
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load

JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
LATEST_S = 253402300800.0  # the end of the year 9999
TASK = "follow the road"


def write_as(
    form: str, dataset: Dataset, splits: Iterable[str], out: Path, tick: Callable[[], None] = lambda: None
) -> int:
    """Write the frames of ``splits`` into the new folder ``out``; their number. ``tick`` follows every frame.

    Frames of side cameras are left out, because these layouts cannot say that their angle was not recorded.
    ``form`` is tub or lerobot. Raises InputError when there is no frame, and for images of several sizes.
    """
    splits = tuple(splits)
    rows = np.concatenate([middle_rows(dataset.rows(name)) for name in splits])
    if not len(rows):
        raise InputError(f"{dataset.folder}: no frame in {', '.join(splits)}: nothing to export")
    if form == "tub" and not (np.abs(rows["t_s"]) < LATEST_S).all():
        raise InputError(f"{dataset.folder}: a time of {rows['t_s'].max():g} s has no date: check its unit")
    frames = _frames(dataset, splits, tick)
    if form == "lerobot":
        return write_lerobot(frames, out, rate_hz=rate_of(rows["t_s"].tolist()), task=TASK)
    lock_rad = dataset.wheel.lock_rad or load(CONFIG_DIR / "vehicle.yaml", Vehicle).max_road_wheel_angle_rad
    return write_tub(frames, out, lock_rad=lock_rad)


def _frames(dataset: Dataset, splits: Iterable[str], tick: Callable[[], None]) -> Iterator[DrivenFrame]:
    """The frames, split by split; an episode ends with its stretch, and where frames are left out."""
    episode, before = -1, None
    for split in splits:
        rows = middle_rows(dataset.rows(split))
        for row, image in zip(rows, dataset.images(rows), strict=True):
            here = (split, row["route"], row["stretch"], row["frame"])
            if before != (*here[:3], here[3] - 1):
                episode += 1
            before = here
            yield DrivenFrame(
                t_s=float(row["t_s"]),
                image=image,
                jpeg=_jpeg(dataset, row),
                road_wheel_rad=float(row["road_wheel_rad"]),
                speed_mps=float(row["speed_mps"]),
                episode=episode,
                split=split,
            )
            tick()


def _jpeg(dataset: Dataset, row: np.void) -> bytes | None:
    """The bytes of an image that is a JPEG file."""
    path = dataset.folder / dataset.file.sources[int(row["source"])].root / str(row["image"])
    if row["item"] >= 0 or path.suffix.lower() not in JPEG_SUFFIXES:
        return None
    return path.read_bytes()
