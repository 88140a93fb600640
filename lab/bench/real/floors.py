"""`trepid bench floors`: lanes of tape and of paint on real and foreign floors, beside lanes drawn by eye.

The frames are those of ``floors.yaml``, and the estimator sees the half second before each. The speed is
unknown, as in the recordings of most RC cars. A lane is right where every drawn point of its boundaries within
NEAR lane widths of the rear axle lies within TOLERANCE lane widths of the answer on the floor, or DRAWN_PX in
the image, to which it is drawn. Frames in which a person would not say where the lane is are not in the file.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from lab.bench.real.scores import CONFIDENT
from lab.bench.real.sets import data_folder
from perception.estimators import Entry, entry_of
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, Settings, load, using_car
from trepid.images.files import images_in, read_image
from trepid.messages import Frame, PixelPath, SteeringEstimate
from trepid.types import Array

CAR, ESTIMATORS = "mini", ("tape",)
FRAMES, FRAME_S = 11, 0.05  # up to a drawn one
NEAR, TOLERANCE = 2.0, 0.2  # in lane widths: beyond, a pixel is more than the tolerance along the lane
DRAWN_PX = 2.0
TARGET = "target: right and confident 0.7"


class DrawnLane(Settings):
    """Points on the two boundaries of a lane, in pixels of the image; none of one that it does not show."""

    left: PixelPath
    right: PixelPath


class Floor(Settings):
    """A drive over a floor: its camera, and lanes by the names of images."""

    camera: Camera
    lanes: Annotated[dict[str, DrawnLane], Field(min_length=1)]


class Floors(Settings):
    """``floors.yaml``, by the folders of the sets."""

    floors: dict[str, Floor]


class Answer(NamedTuple):
    """What an estimator says of a drawn frame."""

    answered: bool
    confidence: float
    right: bool


def bench_floors(data: Path | None = None, estimators: Sequence[str] = ()) -> dict[str, Any]:
    """Set -> estimator -> shares of the drawn frames; "left out" in place of those of an absent set.

    Raises InputError for an unknown estimator and for unreadable images.
    """
    table: dict[str, Any] = {}
    with using_car(CONFIG_DIR / "cars" / CAR):
        vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        entries = {name: entry_of(name) for name in tuple(estimators) or ESTIMATORS}
        for name, floor in load(Path(__file__).with_name("floors.yaml"), Floors).floors.items():
            folder = data_folder(data) / name
            if not folder.is_dir():
                table[name] = {"left out": f"no folder {name} in the data folder"}
                continue
            table[name] = {
                one: shares(answers(entry, floor, folder / "images", vehicle))
                for one, entry in entries.items()
            }
    return table | {"targets": TARGET}


def answers(entry: Entry, floor: Floor, images: Path, vehicle: Vehicle) -> list[Answer]:
    """What the estimator of ``entry`` says of each drawn frame, after those before it. Raises InputError."""
    paths = images_in(images)
    places = {path.name: number for number, path in enumerate(paths)}
    found = []
    for name, drawn in floor.lanes.items():
        if name not in places:
            raise InputError(f"{images / name}: there is no such image; the set is not complete")
        estimator, last = entry.build(floor.camera, vehicle), places[name]
        for number, path in enumerate(paths[max(0, last + 1 - FRAMES) : last + 1]):
            t_s = number * FRAME_S
            estimate = estimator.step(Frame(t_s=t_s, image=read_image(path)), None, now_s=t_s)
        found.append(judge(estimate, drawn, floor.camera, vehicle))
    return found


def judge(estimate: SteeringEstimate, drawn: DrawnLane, camera: Camera, vehicle: Vehicle) -> Answer:
    """Whether ``estimate`` shows the boundaries where they were drawn."""
    pairs = (drawn.left, estimate.left_boundary_px), (drawn.right, estimate.right_boundary_px)
    near_m, most_m = NEAR * vehicle.lane_width_m, TOLERANCE * vehicle.lane_width_m
    right = all(
        apart(point_m, on_floor(found_px, camera)) <= most_m or apart(point_px, found_px) <= DRAWN_PX
        for drawn_px, found_px in pairs
        for point_px, point_m in zip(drawn_px, on_floor(drawn_px, camera), strict=True)
        if np.hypot(*point_m) <= near_m
    )
    answered = bool(estimate.left_boundary_px or estimate.right_boundary_px)
    return Answer(answered, estimate.confidence, answered and right)


def on_floor(pixels: PixelPath, camera: Camera) -> Array:
    """Points of the floor [m], shape (n, 2), that the lens shows at ``pixels``; (0, 2) without any."""
    if not pixels:
        return np.empty((0, 2))
    matrix = camera.intrinsics
    straight = cv2.undistortPoints(np.array(pixels).reshape(-1, 1, 2), matrix, camera.lens, P=matrix)
    return camera.road_from_pixel(straight.reshape(-1, 2))


def apart(point: ArrayLike, path: ArrayLike) -> float:
    """Distance of ``point`` from the broken line ``path``, shape (n, 2); infinite from fewer than two points."""
    corners = np.reshape(path, (-1, 2))
    if len(corners) < 2:
        return float("inf")
    start, along = corners[:-1], np.diff(corners, axis=0)
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - start) * along).sum(axis=1) / length, 0, 1)
    return float(np.hypot(*(start + share[:, None] * along - point).T).min())


def shares(found: Sequence[Answer]) -> Mapping[str, float | int]:
    """Number of frames, and the shares that are answered, right, right and confident, wrong and confident."""
    return {
        "frames": len(found),
        "answered": fmean(one.answered for one in found),
        "right": fmean(one.right for one in found),
        "right_and_confident": fmean(one.right and one.confidence > CONFIDENT for one in found),
        "wrong_and_confident": fmean(not one.right and one.confidence > CONFIDENT for one in found),
    }
