"""Labelled frames for the lane network: random roads by seed, kept in a folder, and the shipped circuit."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from learning.drawn_frames import LaneSample, carriageway_at, lane_at, road_samples
from learning.lane.scores import LabelledFrames
from learning.rendered import Part, Report, render_roads
from learning.roadside import OPEN_COUNTRY, Scenery
from perception.net.canonical import MIRRORED, CanonicalView, row_of_lane
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import Settings

CIRCUIT_STEP_M = 1.0
OFFSET_M, HEADING_RAD = 0.3, 0.03  # standard deviations of the poses on the circuit: a lively drive
MOUNTED_FRAMES = 400
MOUNTS: dict[str, dict[str, float]] = {
    "high camera": dict(height=1.5, focal=1.0),
    "low camera": dict(height=0.62, focal=1.0),
    "narrow lens": dict(height=1.0, focal=1.6),
    "wide lens": dict(height=1.0, focal=0.65),
}
"""Other cameras: height and focal length as multiples of those of the default one."""


class Mounts(Settings):
    """Section ``mounts`` of ``config/train.yaml``: how the cameras of the random roads differ.

    Height and focal length lie between 1/factor and factor of those of the default camera, evenly in the logarithm.
    """

    height: Annotated[float, Field(ge=1)]
    focal: Annotated[float, Field(ge=1)]


HOME = Mounts(height=1.0, focal=1.0)


@dataclass(frozen=True, slots=True)
class TrainingShot:
    """Cameras and label of training frames."""

    camera: Camera  # that renders the frames, where ``mounts`` do not change it
    canonical: Camera  # whose images are kept
    lookahead_m: float  # of the fourth label
    frames_per_road: int
    scenery: Scenery = OPEN_COUNTRY
    mounts: Mounts = HOME

    def label_frames(self, frames: list[LaneSample]) -> LabelledFrames:
        """Canonical images and lanes of rendered frames."""
        view = CanonicalView(self.camera, self.canonical)
        seen = [(view.canonical_lane(frame.lane), frame.lane_width_m / view.scale) for frame in frames]
        return LabelledFrames(
            np.stack([view.image(frame.image) for frame in frames]),
            np.array([row_of_lane(*lane, self.lookahead_m) for lane in seen]),
            np.array([frame.visible for frame in frames], bool),
        )

    def part(self, seed: int) -> Part:
        """The frames of the random road ``seed``, by a camera of ``mounts``."""
        rng = np.random.default_rng((seed, 12))
        height, focal = (
            math.exp(math.log(factor) * rng.uniform(-1, 1))
            for factor in (self.mounts.height, self.mounts.focal)
        )
        shot = replace(self, camera=change_mount(self.camera, height=height, focal=focal))
        ahead_m = self.lookahead_m * shot.camera.height_m / self.canonical.height_m
        samples = road_samples(
            seed, shot.camera, frames=self.frames_per_road, scenery=self.scenery, ahead_m=ahead_m
        )
        part = shot.label_frames(list(samples))
        return dict(images=part.images, lanes=part.lanes, visible=part.visible)


def change_mount(camera: Camera, *, height: float, focal: float) -> Camera:
    """``camera`` with ``height`` times its height and ``focal`` times its focal length."""
    lengths = dict(height_m=height * camera.height_m, fx_px=focal * camera.fx_px, fy_px=focal * camera.fy_px)
    return camera.model_copy(update=lengths)


def random_frames(
    shot: TrainingShot, split: str, count: int, *, seed: int, folder: Path, reuse: bool, report: Report
) -> LabelledFrames:
    """``count`` frames of random roads of ``split``, as :func:`learning.render_roads.render_roads` keeps them."""
    images = np.empty((count, shot.canonical.height_px, shot.canonical.width_px, 3), np.uint8)
    labels, done, roads = [], 0, math.ceil(count / shot.frames_per_road)
    for path in render_roads(
        shot.part,
        split,
        roads,
        seed=seed,
        folder=folder,
        reuse=reuse,
        key=f"{shot!r}, {len(MIRRORED)} numbers",
        report=report,
    ):
        with np.load(path) as part:
            taken = min(shot.frames_per_road, count - done)
            images[done : done + taken] = part["images"][:taken]
            labels.append((part["lanes"][:taken], part["visible"][:taken]))
        done += taken
    lanes, visible = (np.concatenate(column) for column in zip(*labels, strict=True))
    return LabelledFrames(images, lanes, visible)


def mounted_frames(
    shot: TrainingShot, *, seed: int, folder: Path, reuse: bool, report: Report
) -> dict[str, tuple[LabelledFrames, float]]:
    """MOUNTED_FRAMES frames of the roads of the test by each camera of MOUNTS, and the scale of its world."""
    found = {}
    for name, factors in MOUNTS.items():
        own = folder / name.replace(" ", "-")
        frames = random_frames(
            replace(shot, camera=change_mount(shot.camera, **factors)),
            "test",
            MOUNTED_FRAMES,
            seed=seed,
            folder=own,
            reuse=reuse,
            report=report,
        )
        found[name] = frames, factors["height"]
    return found


def circuit_frames(
    shot: TrainingShot, name: str, *, seed: int, step_m: float = CIRCUIT_STEP_M
) -> dict[str, LabelledFrames]:
    """Frames every ``step_m`` along a shipped road at random poses near the lane centre, by section of the road."""
    rng = np.random.default_rng((seed, 1))
    road = load_road(name)
    renderer = Renderer(road, shot.camera, seed=seed)
    sections: dict[str, list[LaneSample]] = {section.name: [] for section in road.sections}
    for index, station_m in enumerate(np.arange(0, road.length_m, step_m).tolist()):
        offset_m, heading = OFFSET_M * float(rng.normal()), HEADING_RAD * float(rng.normal())
        x_m, y_m = road.position(station_m, offset_m)
        yaw_rad = road.heading_at(station_m) + heading
        frame = LaneSample(
            image=renderer.render(x_m, y_m, yaw_rad, t_s=float(index), station_m=station_m),
            lane=lane_at(road, station_m, offset_m, heading, ahead_m=shot.lookahead_m),
            lane_width_m=road.width_at(station_m),
            visible=True,
            carriageway=carriageway_at(road, station_m),
        )
        sections[road.section_at(station_m).name].append(frame)
    return {section: shot.label_frames(frames) for section, frames in sections.items()}
