"""The real sets and their sequences. The project ships none of them; absent ones are left out with the reason."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from sim_harness.bench.perception.real.frames import (
    Picture,
    cart_drive,
    donkey_drive,
    still,
    stills,
    udacity_drive,
    video,
)
from sim_harness.bench.perception.real.scores import (
    MAGENTA,
    ROAD_CLASS,
    TUSIMPLE_ROWS,
    VOID_CLASS,
    ego_lines,
    label_of,
)
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.types import Mask

HIGHWAY_MPS = 25.0


class Labels(StrEnum):
    """What the labels of a set show."""

    ROAD = "road"  # the whole carriageway
    LANE = "lane"  # the ego lane
    ANGLE = "angle"  # the driver's wheel angle
    NONE = "none"


Truth = tuple[Mask, Mask]
"""Pixels of the labelled road or lane, and those where the label is known; both (height, width)."""


@dataclass(frozen=True)
class Sequence:
    """Frames of one drive (or of one set of stills)."""

    pictures: Callable[[Path, int], Iterator[Picture]]  # folder of the set; every n-th still or stretch
    labels: Labels
    truth: Callable[[Picture], Truth] | None = None
    speed_mps: float | None = None  # for the supervisor; None: the cruise speed of its settings


def _road(picture: Picture) -> Truth:
    label = label_of(picture)[..., 0]
    return label == ROAD_CLASS, label != VOID_CLASS


def _magenta(picture: Picture) -> Truth:
    lane = (label_of(picture) == np.array(MAGENTA)).all(axis=2)
    return lane, np.ones_like(lane)


def _between_ego_lines(picture: Picture) -> Truth:
    """The surface between the two labelled ego lines; known in the rows where both are."""
    height, width = label_of(picture).shape[:2]
    lane, known = np.zeros((height, width), bool), np.zeros((height, width), bool)
    left, right = ego_lines(picture)
    if left is None or right is None:
        return lane, known
    seen = np.isfinite(left) & np.isfinite(right)
    rows = np.arange(TUSIMPLE_ROWS[seen][0], TUSIMPLE_ROWS[seen][-1] + 1)
    edges = [np.interp(rows, TUSIMPLE_ROWS[seen], side[seen]) for side in (left, right)]
    at = np.arange(width)
    lane[rows] = (at >= edges[0][:, None]) & (at <= edges[1][:, None])
    known[rows] = True
    return lane, known


def _camvid(name: str) -> Sequence:
    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        for split in ("train", "val"):
            labels = folder / f"{split}_road"
            yield from stills(folder / split, f"{name}_*.jpg", labels, ".png", every=every)

    return Sequence(pictures, Labels.ROAD, _road)


def _tusimple(folder: Path, every: int) -> Iterator[Picture]:
    return stills(folder / "image", "*.png", folder / "gt_instance_image", ".png")


def _kitti(folder: Path, every: int) -> Iterator[Picture]:
    for path in sorted((folder / "image_2").glob("um_*.png")):
        yield still(path, label=folder / "gt_image_2" / path.name.replace("um_", "um_lane_"))


def _stills(pattern: str, camera: str | None = None) -> Sequence:
    """Images without labels; ``camera``: a file of config/cameras."""

    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        known = load(CONFIG_DIR / "cameras" / camera, Camera) if camera else None
        return (still(path, camera=known) for path in sorted(folder.glob(pattern)))

    return Sequence(pictures, Labels.NONE, speed_mps=HIGHWAY_MPS)


def _clip(name: str) -> Sequence:
    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        return video(folder / name, every=every)

    return Sequence(pictures, Labels.NONE, speed_mps=HIGHWAY_MPS)


def _drive(pictures: Callable[..., Iterator[Picture]]) -> Sequence:
    return Sequence(lambda folder, every: pictures(folder, every=every), Labels.ANGLE)


SETS: dict[str, dict[str, Sequence]] = {
    "camvid_road": {name: _camvid(name) for name in ("0006R0", "0016E5", "0001TP")},
    "tusimple_lanenet": {"highway": Sequence(_tusimple, Labels.LANE, _between_ego_lines, HIGHWAY_MPS)},
    "kitti_road_tiny": {"um": Sequence(_kitti, Labels.LANE, _magenta)},
    "highway_udacity_p1": {
        "solidWhiteRight": _clip("solidWhiteRight.mp4"),
        "stills": _stills("test_images/*.jpg"),
    },
    "highway_udacity_adv": {"stills": _stills("test_images/*.jpg", "udacity_highway.yaml")},
    "running_track_cart": {"drive": _drive(cart_drive)},
    "donkey_sim_carpet": {"drive": _drive(donkey_drive)},
    "donkey_indoor_track": {"drive": _drive(donkey_drive)},
    "udacity_sim_track": {"drive": _drive(udacity_drive)},
}
"""Folder of the set -> name of the sequence -> its frames."""
