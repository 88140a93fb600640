"""Labelled frames for the lane network: random roads by seed, kept in a folder, and the shipped circuit."""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from learning.drawn_frames import LaneSample, road_samples
from learning.lane.scores import Labelled
from perception.net.canonical import CanonicalView, row_of_lane
from sim_harness.sweep.pool import imap
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.camera import Camera
from trepid.clothoid import Lane

ROADS_PER_SEED = 1_000_000  # every training seed has a million roads of its own, divided below
FIRST_ROAD = {"train": 0, "validation": 800_000, "test": 900_000}
CIRCUIT_STEP_M = 1.0
OFFSET_M, HEADING_RAD = 0.3, 0.03  # standard deviations of the poses on the circuit: a lively drive
Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Shot:
    """Cameras and label of training frames."""

    camera: Camera  # that renders the frames
    canonical: Camera  # whose images are kept
    lookahead_m: float  # of the fourth label
    frames_per_road: int

    def labelled(self, frames: list[LaneSample]) -> Labelled:
        """Canonical images and lanes of rendered frames."""
        view = CanonicalView(self.camera, self.canonical)
        return Labelled(
            np.stack([view.image(frame.image) for frame in frames]),
            np.array([self._lane(frame) for frame in frames], np.float32),
            np.array([frame.visible for frame in frames], bool),
        )

    def _lane(self, frame: LaneSample) -> tuple[float, float, float, float]:
        lane = Lane(
            frame.lateral_offset_m, frame.heading_error_rad, frame.curvature_1pm, frame.curvature_rate_1pm2
        )
        return row_of_lane(lane, self.lookahead_m)


def random_frames(
    shot: Shot, split: str, count: int, *, seed: int, folder: Path, reuse: bool, report: Report
) -> Labelled:
    """``count`` frames of random roads of ``split``, rendered by all cores into ``folder``; splits share no road.

    With ``reuse``, roads that an earlier call for the same cameras rendered are read from there.
    """
    folder = folder / f"{split}-seed{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    _clear_unless(reuse, folder, repr(shot))
    first = seed * ROADS_PER_SEED + FIRST_ROAD[split]
    roads = range(first, first + math.ceil(count / shot.frames_per_road))
    images = np.empty((count, shot.canonical.height_px, shot.canonical.width_px, 3), np.uint8)
    labels, done, started_s = [], 0, time.monotonic()
    paths = imap(partial(_road, shot, folder), roads, os.cpu_count() or 1)
    for number, path in enumerate(paths, start=1):
        with np.load(path) as part:
            taken = min(shot.frames_per_road, count - done)
            images[done : done + taken] = part["images"][:taken]
            labels.append((part["lanes"][:taken], part["visible"][:taken]))
        done += taken
        if number % 25 == 0 or done == count:
            left_s = (time.monotonic() - started_s) * (count - done) / done
            report(f"{split}: {done}/{count} frames rendered, {left_s / 60:.1f} min left")
    lanes, visible = (np.concatenate(column) for column in zip(*labels, strict=True))
    return Labelled(images, lanes, visible)


def _clear_unless(reuse: bool, folder: Path, key: str) -> None:
    """Delete the roads in ``folder`` that were not rendered for ``key``; all of them without ``reuse``."""
    stored = folder / "shot.txt"
    if not (reuse and stored.is_file() and stored.read_text(encoding="utf-8") == key):
        for old in folder.glob("*.npz"):
            old.unlink()
        stored.write_text(key, encoding="utf-8")


def _road(shot: Shot, folder: Path, seed: int) -> Path:
    """File with the frames of the road ``seed``, rendered unless it exists."""
    path = folder / f"{seed}.npz"
    if not path.is_file():
        cv2.setNumThreads(1)
        part = shot.labelled(list(road_samples(seed, shot.camera, frames=shot.frames_per_road)))
        fresh = path.with_suffix(".new")
        with fresh.open("wb") as file:
            np.savez(file, images=part.images, lanes=part.lanes, visible=part.visible)
        fresh.replace(path)
    return path


def circuit_frames(
    shot: Shot, name: str, *, seed: int, step_m: float = CIRCUIT_STEP_M
) -> dict[str, Labelled]:
    """Frames every ``step_m`` along a shipped road at random poses near the lane centre, by section of the road."""
    rng = np.random.default_rng((seed, 1))
    road = load_road(name)
    renderer = Renderer(road, shot.camera, seed=seed)
    sections: dict[str, list[LaneSample]] = {section.name: [] for section in road.sections}
    for index, station_m in enumerate(np.arange(0, road.length_m, step_m).tolist()):
        offset_m, heading = OFFSET_M * float(rng.normal()), HEADING_RAD * float(rng.normal())
        x_m, y_m = road.position(station_m, offset_m)
        yaw_rad = road.heading_at(station_m) + heading
        curvature, ahead = road.curvature_at(station_m), road.curvature_at(station_m + shot.lookahead_m)
        frame = LaneSample(
            image=renderer.render(x_m, y_m, yaw_rad, t_s=float(index), station_m=station_m),
            lateral_offset_m=offset_m,
            heading_error_rad=heading,
            curvature_1pm=curvature,
            curvature_rate_1pm2=(ahead - curvature) / shot.lookahead_m,
            lane_width_m=road.width_at(station_m),
            visible=True,
        )
        sections[road.section_at(station_m).name].append(frame)
    return {section: shot.labelled(frames) for section, frames in sections.items()}
