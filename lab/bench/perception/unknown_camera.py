"""`trepid bench unknown-camera`: how soon a drive measures a camera without a file.

Drives of ten seconds on winding roads of every kind, each with another camera, speed and width of the lane; the
odometry has a scale error and the gyroscope a bias. The estimator `cv` gets the frames with speed and yaw rate,
with the speed alone, and without any odometry. The height of the camera of Udacity's simulator, whose lens is known
but not its mounting, is measured on each stretch of a drive.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.bench.perception.clips import Course
from lab.bench.perception.looks import random_camera
from lab.bench.real.sets import data_folder
from perception.camera.odometry import DriveOptics, StateOdometry
from perception.camera.road_lines import pitch_and_yaw
from perception.camera.self_calibration import CALIBRATION_FRAMES, calibrate_by_images
from perception.estimators import lane_cv_settings
from perception.lane.which_lane import WhichLane
from sim_harness.footage.clip import read_log
from sim_harness.sweep.store import finish_tasks
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.drawn import MarkingKind, random_section
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.images.files import read_image
from trepid.messages import Frame, VehicleState
from trepid.types import Image

DRIVES = 24
PERIOD_S, DURATION_S = 0.05, 10.0
JUDGED_S = (2.0, 5.0, 10.0)
NEAR = 0.05  # of the height, the focal length
SPEEDS_MPS, WIDTHS_M = (5.0, 25.0), (2.9, 3.75)
ACCEL_MPS2, LEAST_RADIUS_M = (0.4, 2.0), 30.0  # in the bends
START_M, SPARE_M = 10.0, 80.0
SAME_SIDE = 0.3  # share of the bends to the side of the one before
FOREIGN, STRETCH = "udacity_sim_track", 300  # the set; frames of a stretch
FOREIGN_FOV_RAD = math.pi / 3  # of Unity's camera, vertical
SPEED_ERROR, RATE_BIAS_RADPS, RATE_NOISE_RADPS = 0.01, 0.003, 0.005  # standard deviations


class OdometryFrame(NamedTuple):
    """A frame, and speed and yaw rate as the car measures them."""

    t_s: float
    image: Image
    speed_mps: float
    yaw_rate_radps: float


@dataclass(frozen=True)
class UnknownDrive:
    """A drive with an unknown camera."""

    camera: Camera
    course: Course
    renderer: Renderer
    rng: np.random.Generator

    def moments(self) -> Iterator[OdometryFrame]:
        """The frames, with measured odometry."""
        scale, bias = self.rng.normal(1.0, SPEED_ERROR), self.rng.normal(0.0, RATE_BIAS_RADPS)
        for number in range(round(DURATION_S / PERIOD_S) + 1):
            t_s = number * PERIOD_S
            rate = self.course.yaw_rate_radps(t_s) + bias + self.rng.normal(0.0, RATE_NOISE_RADPS)
            image = self.course.picture(self.renderer, t_s)
            yield OdometryFrame(t_s, image, self.course.speed_along_mps(t_s) * float(scale), float(rate))


def unknown_drive(seed: int, number: int) -> UnknownDrive:
    """The drive of a seed and a number; kinds of roads in turn."""
    rng = np.random.default_rng((seed, 64, number))
    speed_mps = float(rng.uniform(*SPEEDS_MPS))
    road = Road(
        RoadSettings(
            name=f"winding road {number}",
            closed=False,
            lane_width_m=float(rng.uniform(*WIDTHS_M)),
            segments=_winding(speed_mps, rng),
            sections=(random_section(list(MarkingKind)[number % len(MarkingKind)], rng),),
        )
    )
    camera = random_camera(rng)
    course = Course(road, speed_mps, START_M, rng)
    return UnknownDrive(camera, course, Renderer(road, camera, seed=int(rng.integers(2**31))), rng)


def _winding(speed_mps: float, rng: np.random.Generator) -> tuple[Segment, ...]:
    """Bends and straights as they are driven at a speed."""
    segments, length_m = [Segment(length_m=2 * START_M)], 2 * START_M
    side = float(rng.choice([-1, 1]))
    while length_m < START_M + speed_mps * DURATION_S + SPARE_M:
        curvature = side * min(float(rng.uniform(*ACCEL_MPS2)) / speed_mps**2, 1 / LEAST_RADIUS_M)
        entry_m, arc_m = max(10.0, 0.8 * speed_mps), speed_mps * float(rng.uniform(0.5, 2.5))
        bend = (
            Segment(length_m=entry_m, curvature_1pm=(0.0, curvature)),
            Segment(length_m=arc_m, curvature_1pm=curvature),
            Segment(length_m=entry_m, curvature_1pm=(curvature, 0.0)),
            Segment(length_m=speed_mps * float(rng.uniform(0.2, 2.0))),
        )
        segments.extend(bend)
        length_m += sum(segment.length_m for segment in bend)
        side *= 1.0 if rng.random() < SAME_SIDE else -1.0
    return tuple(segments)


class BeliefError(NamedTuple):
    """The belief of an estimator at a time, against the truth."""

    height: float  # ln of the ratio to the true one
    height_sigma: float
    focal: float
    horizon_rad: float
    yaw_rad: float


class WatchedDrive(NamedTuple):
    """One drive with one kind of odometry."""

    odometry: StateOdometry
    seen: tuple[BeliefError, ...]  # at JUDGED_S
    confidence: float  # mean over the second half
    width_error_m: float | None  # median over the second half


def watch(case: tuple[int, int]) -> list[WatchedDrive]:
    """The drive of a seed and a number, with every kind of odometry."""
    drive = unknown_drive(*case)
    moments = list(drive.moments())
    return [_watch_drive(drive, moments, odometry) for odometry in StateOdometry]


def _watch_drive(drive: UnknownDrive, moments: list[OdometryFrame], odometry: StateOdometry) -> WatchedDrive:
    settings, vehicle = lane_cv_settings(), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    assumed = calibrate_by_images([moments[0].image], settings.self_calibration)
    finder, seen, late = WhichLane(settings, assumed, vehicle, odometry), [], []
    for t_s, image, speed_mps, rate in moments:
        state = VehicleState(
            t_s=t_s,
            speed_mps=speed_mps,
            yaw_rate_radps=rate,
            road_wheel_angle_rad=None,
            driver_override=False,
        )
        estimate = finder.step(Frame(t_s=t_s, image=image), state, now_s=t_s)
        if any(math.isclose(t_s, at_s) for at_s in JUDGED_S):
            seen.append(_belief_error(drive.camera, finder))
        if t_s > DURATION_S / 2:
            late.append(estimate)
    widths = [one.lane_width_m for one in late if one.lane_width_m is not None]
    true_m = drive.course.road.settings.lane_width_m
    return WatchedDrive(
        odometry,
        tuple(seen),
        float(np.mean([one.confidence for one in late])),
        float(np.median(widths)) - true_m if widths else None,
    )


def _belief_error(true: Camera, finder: WhichLane) -> BeliefError:
    belief, camera = finder.belief, finder.camera
    return BeliefError(
        height=math.log(belief.height_m / true.height_m),
        height_sigma=belief.height_sigma,
        focal=math.log(belief.focal_px / true.fx_px),
        horizon_rad=(camera.horizon_row_px - true.horizon_row_px) / true.fy_px,
        yaw_rad=camera.yaw_rad - true.yaw_rad,
    )


def bench_unknown_camera(seed: int, *, jobs: int = 1, data: Path | None = None) -> dict[str, Any]:
    """How near the camera is to the true one after seconds of driving, by the odometry that is known."""
    cases = {(seed, number): (seed, number) for number in range(DRIVES)}
    with closing(finish_tasks(watch, cases, jobs)) as results:
        drives = [one for _, found in results for one in found]
    rows = {odometry.value: [one for one in drives if one.odometry is odometry] for odometry in StateOdometry}
    tables: dict[str, Any] = {"odometry": {name: _scores(found) for name, found in rows.items()}}
    folder = data_folder(data) / FOREIGN
    if folder.is_dir() and (foreign := foreign_heights(folder)):
        tables["foreign_simulator"] = foreign
    return tables


def _scores(drives: list[WatchedDrive]) -> dict[str, float | None]:
    height = np.array([[one.height for one in drive.seen] for drive in drives])
    end = [drive.seen[-1] for drive in drives]
    sigma = np.array([one.height_sigma for one in end])
    shares = {
        f"height_within_5_percent_after_{at_s:.0f}_s_percent": 100 * float(np.mean(np.abs(column) < NEAR))
        for at_s, column in zip(JUDGED_S, height.T, strict=True)
    }
    widths = [abs(drive.width_error_m) for drive in drives if drive.width_error_m is not None]
    return shares | {
        "height_error_percent": 100 * float(np.median(np.abs(height[:, -1]))),
        "height_sigma_percent": 100 * float(np.median(sigma)),
        "height_within_2_sigma_percent": 100 * float(np.mean(np.abs(height[:, -1]) < 2 * sigma)),
        "focal_error_percent": 100 * float(np.median([abs(one.focal) for one in end])),
        "horizon_error_deg": math.degrees(float(np.median([abs(one.horizon_rad) for one in end]))),
        "yaw_error_deg": math.degrees(float(np.median([abs(one.yaw_rad) for one in end]))),
        "lane_width_error_m": float(np.median(widths)) if widths else None,
        "confidence": float(np.mean([drive.confidence for drive in drives])),
    }


def foreign_heights(folder: Path) -> dict[str, Any]:
    """The height of the camera of Udacity's simulator on stretches of a drive, by the logged speed.

    Its true value is not known; that of one camera is the same on every stretch. The lens is Unity's default.
    """
    log = folder / "driving_log.csv"
    with log.open(encoding="utf-8") as file:
        names = [Path(row[0]).name for row in csv.reader(file)]
    logged = list(zip(names, *(column.tolist() for column in read_log(log)), strict=True))
    heights = [
        height_m
        for start in range(0, len(logged) - STRETCH + 1, STRETCH)
        if (height_m := _height_m(folder / "IMG", logged[start : start + STRETCH])) is not None
    ]
    if not heights:
        return {}
    middle_m = float(np.median(heights))
    apart = np.abs(np.array(heights) / middle_m - 1)
    return {
        "stretches": len(heights),
        "median_height_m": middle_m,
        "within_5_percent_percent": 100 * float(np.mean(apart < NEAR)),
        "median_difference_percent": 100 * float(np.median(apart)),
        "largest_difference_percent": 100 * float(apart.max()),
    }


def _height_m(folder: Path, stretch: Sequence[tuple[str, float, float]]) -> float | None:
    """The height by a stretch of names of frames, times and speeds; None where too few pairs are known."""
    images = [read_image(folder / name) for name, _, _ in stretch]
    spread = np.linspace(0, len(images) - 1, CALIBRATION_FRAMES).astype(int)
    assumed = calibrate_by_images([images[at] for at in spread], lane_cv_settings().self_calibration)
    focal_px = assumed.height_px / 2 / math.tan(FOREIGN_FOV_RAD / 2)
    lens = assumed.model_copy(update={"fx_px": focal_px, "fy_px": focal_px})
    camera = lens.model_copy(update=pitch_and_yaw(lens.cx_px, assumed.horizon_row_px, lens))
    optics, found = DriveOptics(camera, StateOdometry.WAY), None
    for image, (_, t_s, speed_mps) in zip(images, stretch, strict=True):
        found = optics.step(image, t_s, speed_mps, None) or found
    return None if found is None else found.focal_height_pxm / focal_px
