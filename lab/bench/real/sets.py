"""The real sets and their sequences. The project ships none of them; absent ones are left out with the reason."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from lab.bench.real.frames import (
    Picture,
    cart_drive,
    donkey_drive,
    numbered_clip,
    still,
    stills,
    udacity_drive,
    video,
)
from lab.bench.real.labels import Labels
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load

HIGHWAY_MPS = 25.0
CAMVID_HZ = 30.0  # by which CamVid numbers its frames
CAMVID_DRIVES = "0006R0", "0016E5", "0001TP"
CAMVID_WIDTH_PX = (
    640  # of its pictures as they were taken, 4:3 of those in the set: roads there are too narrow
)


@dataclass(frozen=True)
class Sequence:
    """Frames of one drive (or of one set of stills)."""

    pictures: Callable[[Path, int], Iterator[Picture]]  # folder of the set; every n-th still or stretch
    labels: Labels
    speed_mps: float | None = None  # for the supervisor; None: the cruise speed of its settings


def data_folder(given: Path | None) -> Path:
    """``--data``, or TREPID_DATA, or ../shared/data next to the repository."""
    return given or Path(os.environ.get("TREPID_DATA") or ROOT.parent / "shared" / "data")


def _camvid(name: str, width_px: int | None = None, *, assumed: bool = True) -> Sequence:
    """``assumed`` False: what the estimators with a camera file state, although height and lens are a guess."""

    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        for split in ("train", "val"):
            labels = folder / f"{split}_road"
            found = stills(folder / split, f"{name}_*.jpg", labels, ".png", every=every, width_px=width_px)
            yield from (replace(picture, assumed=assumed) for picture in found)

    return Sequence(pictures, Labels.ROAD)


def camvid_clip(folder: Path, every: int = 1) -> Iterator[Picture]:
    """Seven seconds of a street by day: the part that is labelled at 15 frames/s."""
    labels = folder / "val_road"
    return numbered_clip(folder / "val", "0016E5_*.jpg", labels, ".png", number_hz=CAMVID_HZ, every=every)


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

    return Sequence(pictures, Labels.NONE, HIGHWAY_MPS)


def _clip(name: str) -> Sequence:
    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        return video(folder / name, every=every)

    return Sequence(pictures, Labels.NONE, HIGHWAY_MPS)


def _drive(pictures: Callable[..., Iterator[Picture]]) -> Sequence:
    return Sequence(lambda folder, every: pictures(folder, every=every), Labels.ANGLE)


SETS: dict[str, dict[str, Sequence]] = {
    "camvid_road": {
        **{name: _camvid(name) for name in CAMVID_DRIVES},
        **{f"{name} at 640x360": _camvid(name, CAMVID_WIDTH_PX) for name in CAMVID_DRIVES},
        **{
            f"{name} with a camera file": _camvid(name, CAMVID_WIDTH_PX, assumed=False)
            for name in CAMVID_DRIVES
        },
        "0016E5 at 15 Hz": Sequence(camvid_clip, Labels.ROAD),
    },
    "tusimple_lanenet": {"highway": Sequence(_tusimple, Labels.LINES, HIGHWAY_MPS)},
    "kitti_road_tiny": {"um": Sequence(_kitti, Labels.LANE)},
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
