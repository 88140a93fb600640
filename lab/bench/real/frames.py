"""Frames of the real sets: independent stills, and stretches of drives for tracking."""

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from cockpit.footage.sources import Clip, sources
from perception.camera.odometry import StateOdometry
from perception.camera.self_calibration import CALIBRATION_FRAMES, calibrate_by_images
from perception.estimators import build_beside, lane_cv_settings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.files import read_image
from trepid.images.video import count_frames
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.recording.csv_file import MPS_PER_MPH
from trepid.types import Image

FULL_LOCK_RAD = np.radians(25.0)  # of both steering logs, by the MANIFESTs
HALF_WORLD = 0.467  # lengths of config/cameras/udacity_sim_half.yaml over those of the simulator


class Stretches(NamedTuple):
    """The parts of a long drive that are looked at, spread evenly over it."""

    number: int = 12
    frames: int = 40  # in a row


STRETCHES = Stretches()


@dataclass(frozen=True)
class Picture:
    """A frame of a set; consecutive ones of the same ``drive`` are tracked, a still has a drive of its own."""

    drive: str
    t_s: float
    image: Image
    camera: Camera
    label: Path | None = None
    steering_rad: float | None = None  # of the driver, + = left
    speed_mps: float | None = None
    file: str = ""  # within the folder of its set; the frame of a video as NAME#NUMBER
    assumed: bool = False  # the camera is self-calibrated


Seen = tuple[Picture, dict[str, SteeringEstimate]]


def estimates(pictures: Iterator[Picture], names: Sequence[str]) -> Iterator[Seen]:
    """Every frame with the estimates of all estimators; each drive gets fresh estimators."""
    vehicle, drive = load(CONFIG_DIR / "vehicle.yaml", Vehicle), None
    for picture in pictures:
        if picture.drive != drive:
            drive = picture.drive
            runners = build_beside(
                names, picture.camera, vehicle, assumed=picture.assumed, odometry=StateOdometry.NONE
            )
        frame, state = Frame(t_s=picture.t_s, image=picture.image), None
        if picture.speed_mps is not None:
            state = VehicleState(
                t_s=picture.t_s,
                speed_mps=picture.speed_mps,
                road_wheel_angle_rad=None,
                yaw_rate_radps=None,
                driver_override=False,
            )
        yield picture, {name: runner.step(frame, state, now_s=frame.t_s) for name, runner in runners.items()}


def stills(
    folder: Path, pattern: str, labels: Path, suffix: str, *, every: int = 1, width_px: int | None = None
) -> Iterator[Picture]:
    """Images of a folder with their labels, with unknown cameras; stretched to ``width_px``."""
    for path in sorted(folder.glob(pattern))[::every]:
        yield still(path, label=labels / f"{path.stem}{suffix}", width_px=width_px)


def still(
    path: Path, *, label: Path | None = None, camera: Camera | None = None, width_px: int | None = None
) -> Picture:
    """An image; without ``camera`` a typical one with the horizon of the image, as in `trepid estimate`."""
    image = read_image(path)
    if width_px is not None:
        image = np.asarray(cv2.resize(image, (width_px, image.shape[0])), np.uint8)
    known = camera or calibrate_by_images([image], lane_cv_settings().self_calibration)
    camera, assumed = known.resize(image.shape[1], image.shape[0]), camera is None
    return Picture(str(path), 0.0, image, camera, label=label, file=path.name, assumed=assumed)


def video(path: Path, *, every: int = 1) -> Iterator[Picture]:
    """The frames of a video with an unknown camera."""
    clip = sources(path)[0]
    if not isinstance(clip, Clip):
        raise InputError(f"{path}: not a video")
    camera = calibrate_by_images(clip.sample(CALIBRATION_FRAMES), lane_cv_settings().self_calibration)
    for shot in islice(clip.shots(), count_frames(path) // every):
        file = f"{path.name}#{shot.number}"
        yield Picture(str(path), shot.t_s, shot.image, camera, file=file, assumed=True)


def numbered_clip(
    folder: Path, pattern: str, labels: Path, suffix: str, *, number_hz: float, every: int = 1
) -> Iterator[Picture]:
    """Labelled images as one drive with an unknown camera; the number that ends a name counts at ``number_hz``."""
    paths = sorted(folder.glob(pattern))
    paths = paths[: len(paths) // every]
    if not paths:
        return
    sample = [read_image(path) for path in paths[:: max(1, len(paths) // CALIBRATION_FRAMES)]]
    camera = calibrate_by_images(sample, lane_cv_settings().self_calibration)
    numbers = [int(path.stem.rpartition("_")[2]) for path in paths]
    for path, number in zip(paths, numbers, strict=True):
        yield Picture(
            f"{folder} {pattern}",
            (number - numbers[0]) / number_hz,
            read_image(path),
            camera,
            label=labels / f"{path.stem}{suffix}",
            file=path.name,
            assumed=True,
        )


@dataclass(frozen=True)
class _LoggedFrame:
    """A frame of a drive, and what its log says."""

    image: Path
    t_s: float
    steer_share: float  # of full lock, + = left
    speed_mps: float | None = None


def udacity_drive(folder: Path, *, every: int = 1, parts: Stretches = STRETCHES) -> Iterator[Picture]:
    """Stretches of the simulator drive with the steering of its log, in a world of half its size."""
    camera = load(CONFIG_DIR / "cameras" / "udacity_sim_half.yaml", Camera)
    with (folder / "driving_log.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.reader(file) if row]
    logged = [
        _LoggedFrame(
            folder / "IMG" / Path(row[0]).name,
            number / 10,  # about ten frames a second
            -float(row[3]),
            HALF_WORLD * MPS_PER_MPH * float(row[6]),
        )
        for number, row in enumerate(rows)
    ]
    return _stretches("udacity", logged, every, parts, camera)


def donkey_drive(folder: Path, *, every: int = 1, parts: Stretches = STRETCHES) -> Iterator[Picture]:
    """Stretches of a donkeycar drive with the joystick's angle, with an unknown camera."""
    catalogs = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("catalog_?.catalog"))]
    rows = [json.loads(line) for catalog in catalogs for line in catalog.splitlines()]
    rows.sort(key=lambda row: row["_index"])
    logged = [
        _LoggedFrame(
            folder / "images" / row["cam/image_array"], row["_timestamp_ms"] / 1000, -float(row["user/angle"])
        )
        for row in rows
    ]
    return _stretches("donkey", logged, every, parts)


def cart_drive(folder: Path, *, every: int = 1, parts: Stretches = STRETCHES) -> Iterator[Picture]:
    """Stretches of a cart's drive whose driving_log.csv names image, timestamp_ms and user_angle."""
    with (folder / "driving_log.csv").open(encoding="utf-8") as file:
        logged = [
            _LoggedFrame(folder / row["image"], float(row["timestamp_ms"]) / 1000, -float(row["user_angle"]))
            for row in csv.DictReader(file)
        ]
    return _stretches("cart", logged, every, parts)


def _stretches(
    name: str, rows: Sequence[_LoggedFrame], every: int, parts: Stretches, camera: Camera | None = None
) -> Iterator[Picture]:
    """``parts`` of a drive, every n-th of them; without ``camera`` calibrated on frames of the drive."""
    known = camera
    if known is None:
        chosen = np.linspace(0, len(rows) - 1, CALIBRATION_FRAMES).astype(int).tolist()
        sample = [read_image(rows[number].image) for number in chosen]
        known = calibrate_by_images(sample, lane_cv_settings().self_calibration)
    starts = np.linspace(0, len(rows) - parts.frames, parts.number).astype(int).tolist()[::every]
    for drive, start in enumerate(starts):
        for row in rows[start : start + parts.frames]:
            yield Picture(
                f"{name} {drive}",
                row.t_s,
                read_image(row.image),
                known,
                steering_rad=row.steer_share * FULL_LOCK_RAD,
                speed_mps=row.speed_mps,
                file=row.image.name,
                assumed=camera is None,
            )
