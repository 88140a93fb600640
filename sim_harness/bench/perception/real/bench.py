"""The real sets, which the project does not ship: read from the data folder, or left out with the reason."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from sim_harness.bench.perception.real.frames import (
    Picture,
    donkey_drive,
    estimates,
    still,
    stills,
    udacity_drive,
    video,
)
from sim_harness.bench.perception.real.scores import (
    Pairs,
    Row,
    lane_overlap,
    lane_widths,
    road_overlap,
    steering,
    tusimple,
)
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint
from sim_harness.sweep.store import Store
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load

CODE = (
    "sim_harness/bench/perception/real/bench.py",
    "sim_harness/bench/perception/real/frames.py",
    "sim_harness/bench/perception/real/scores.py",
    "perception/camera/self_calibration.py",
    "config/perception.yaml",
    "config/cameras",
)
SAY_EVERY_S = 10.0
QUICK = 6  # every sixth image or stretch


@dataclass(frozen=True)
class RealSet:
    """One set: its folder, its images (every n-th) and its scores."""

    folder: str
    pictures: Callable[[Path, int], Iterator[Picture]]
    score: Callable[[Pairs], Row]


def _camvid(sequence: str, split: str) -> Callable[[Path, int], Iterator[Picture]]:
    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        return stills(folder / split, f"{sequence}_*.jpg", folder / f"{split}_road", ".png", every=every)

    return pictures


def _tusimple(folder: Path, every: int) -> Iterator[Picture]:
    return stills(folder / "image", "*.png", folder / "gt_instance_image", ".png")


def _kitti(folder: Path, every: int) -> Iterator[Picture]:
    for path in sorted((folder / "image_2").glob("um_*.png")):
        yield still(path, label=folder / "gt_image_2" / path.name.replace("um_", "um_lane_"))


def _highway_stills(folder: Path, every: int) -> Iterator[Picture]:
    camera = load(CONFIG_DIR / "cameras" / "udacity_highway.yaml", Camera)
    return (still(path, camera=camera) for path in sorted((folder / "test_images").glob("*.jpg")))


SETS: dict[str, RealSet] = {
    "tusimple": RealSet("tusimple_lanenet", _tusimple, tusimple),
    "kitti ego lane": RealSet("kitti_road_tiny", _kitti, lane_overlap),
    "camvid day 0006R0": RealSet("camvid_road", _camvid("0006R0", "train"), road_overlap),
    "camvid dusk 0001TP": RealSet("camvid_road", _camvid("0001TP", "train"), road_overlap),
    "camvid day 0016E5": RealSet("camvid_road", _camvid("0016E5", "val"), road_overlap),
    "highway stills": RealSet("highway_udacity_adv", _highway_stills, lane_widths),
    "highway video": RealSet(
        "highway_udacity_p1",
        lambda folder, every: video(folder / "solidWhiteRight.mp4", every=every),
        lane_widths,
    ),
    "udacity drive": RealSet("udacity_sim_track", lambda f, n: udacity_drive(f, every=n), steering),
    "donkey drive": RealSet("donkey_indoor_track", lambda f, n: donkey_drive(f, every=n), steering),
}


def data_folder(given: Path | None) -> Path:
    """``--data``, or TREPID_DATA, or ../shared/data next to the repository."""
    return given or Path(os.environ.get("TREPID_DATA") or ROOT.parent / "shared" / "data")


def bench_real(names: Sequence[str], data: Path, folder: Path, *, quick: bool) -> dict[str, Any]:
    """Per set the figures of every estimator, or the reason for its absence; stored ones are not computed again."""
    found: dict[str, Any] = {}
    with Store(folder / "real.jsonl") as store:
        for name, real in SETS.items():
            if not (data / real.folder).is_dir():
                found[name] = {"left out": f"no folder {real.folder} in the data folder"}
                continue
            found[name] = _scored(name, real, data / real.folder, names, store, every=QUICK if quick else 1)
    return found


def _scored(
    name: str, real: RealSet, data: Path, names: Sequence[str], store: Store, *, every: int
) -> dict[str, Row]:
    keys = {
        one: (f"{name}, {one}", f"{estimator_fingerprint(one)} {fingerprint(*CODE)} {every}") for one in names
    }
    missing = [one for one in names if store.get(*keys[one]) is None]
    for one, row in _judged(name, real, data, missing, every).items() if missing else ():
        store.add(*keys[one], row)
    return {one: store.get(*keys[one]) or {} for one in names}


def _judged(name: str, real: RealSet, folder: Path, names: Sequence[str], every: int) -> dict[str, Row]:
    cv2.setNumThreads(1)
    pairs: dict[str, list[Any]] = {one: [] for one in names}
    said_s = time.monotonic()
    for number, (picture, found) in enumerate(estimates(real.pictures(folder, every), names), start=1):
        light = replace(picture, image=picture.image[:0])  # drop images, which are not scored
        for one, estimate in found.items():
            pairs[one].append((light, estimate))
        if time.monotonic() - said_s > SAY_EVERY_S:
            said_s = time.monotonic()
            print(f"perception: {name}, {number} pictures", file=sys.stderr, flush=True)
    return {one: real.score(seen) for one, seen in pairs.items()}
