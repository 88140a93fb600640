"""`trepid bench sight`: the measured sight distance beside the true one, and on real images of clear days.

Every drawn drive has a random road, light and place. The estimator `cv` tracks the lane, and the judge of the image
gets the lane of the frame before, as in a drive. The last frames of a drive count, and so does its true sight
(:mod:`sim_harness.world.sight_truth`). Real images stand alone, without a lane: the ground straight ahead counts.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from lab.bench.perception.clips import Course
from lab.bench.real.sets import SETS, data_folder
from perception.camera.image_statistics import ImageStatistician
from perception.estimators import build
from perception.sight.judge import build as build_judge
from sim_harness.sweep.store import finish_tasks
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.drawn import SPEEDS_MPS, BendShape, MarkingKind, random_road, random_section
from sim_harness.world.roads.elevation import ElevationPoint
from sim_harness.world.roads.features import Side, Wall, WallKind
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from sim_harness.world.sight_truth import SightDistance, SightTruth, load_sight_settings
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, ImageStatistics, SteeringEstimate, VehicleState
from trepid.types import Array

PERIOD_S = 0.04
WARM_UP, SCORED = 45, 4  # frames: the crest finder looks at the last 1.2 s, what is shown follows by 0.3 s
STEP = 3  # scored frames are this many frames apart
# Drives of each kind; of the others, of each grade.
DRIVES = {"clear": 12, "crest": 8, "dip": 8, "wall": 8, "truck": 10}
OF_A_GRADE = 3
GRADES = (1, 2, 3, 4, 5)
WEATHER = ("fog", "night", "rain", "snow")
HILL_RADII_M, HILL_GRADES = (400.0, 1500.0), (0.03, 0.07)
BEND_RADII_M, WALL_DISTANCES_M = (40.0, 120.0), (0.6, 2.5)
TRUCK_M, TRUCK = (8.0, 60.0), Body(width_m=2.5, height_m=3.6, waist_m=3.0)
REAL_FRAMES, REAL_EVERY = 40, 6
SHORT_M, LONG_M = 40.0, 80.0
BESIDE = (
    "side of the image"  # row of the frames in which a bend leaves the image, and nothing else ends the sight
)


class SightSample(NamedTuple):
    """What was measured in a frame, and what was true."""

    seen: ImageStatistics
    true: SightDistance
    judge_ms: float
    statistics_ms: float


@dataclass(frozen=True, slots=True)
class SightCase:
    """One drive."""

    seed: int
    kind: str
    grade: int
    number: int

    @property
    def row(self) -> str:
        """Row of the table."""
        return f"{self.kind} {self.grade}" if self.grade else self.kind


def cases(seed: int, *, quick: bool = False) -> list[SightCase]:
    """Every drive of a seed; ``quick``: one of each row."""
    graded = [(kind, grade, OF_A_GRADE) for kind in WEATHER for grade in GRADES]
    plain = [(kind, 0, count) for kind, count in DRIVES.items()]
    return [
        SightCase(seed, kind, grade, number)
        for kind, grade, count in (*plain, *graded)
        for number in range(1 if quick else count)
    ]


def drive(case: SightCase) -> list[SightSample]:
    """The scored frames of a drive."""
    rng = np.random.default_rng([case.seed, 66, case.number, case.grade, *case.kind.encode()])
    road, start_m, speed_mps = _road(case, rng)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    spoiled = [Disturbance(kind=DisturbanceKind(case.kind), grade=case.grade)] if case.grade else []
    seed = int(rng.integers(2**31))
    renderer = Renderer(road, camera, seed=seed, disturbances=spoiled)
    truth = SightTruth(road, camera, spoiled, seed=seed)
    course = Course(road, speed_mps, start_m, rng)
    ahead_m = float(rng.uniform(*TRUCK_M)) if case.kind == "truck" else None
    estimator, judge, statistician = build("cv"), build_judge(), ImageStatistician()
    lane: SteeringEstimate | None = None
    found = []
    for number in range(WARM_UP + SCORED * STEP):
        t_s = number * PERIOD_S
        station_m = course.station_m(t_s)
        pose = (*road.position(station_m, course.offset_m(t_s)), course.yaw_rad(t_s))
        vehicles = [] if ahead_m is None else [_truck(road, station_m + ahead_m)]
        motion = ShutterMotion(course.speed_along_mps(t_s), course.yaw_rate_radps(t_s))
        image = renderer.render(*pose, t_s=t_s, station_m=station_m, motion=motion, vehicles=vehicles)
        frame, state = Frame(t_s=t_s, image=image), _state(motion, t_s)
        started_s = time.thread_time()
        seen = judge.step(frame, lane, state, now_s=t_s)
        judged_s = time.thread_time()
        statistician.step(frame, now_s=t_s)
        ended_s = time.thread_time()
        if number >= WARM_UP and (number - WARM_UP) % STEP == 0:
            true = truth.at(station_m, pose, vehicles)
            found.append(SightSample(seen, true, 1e3 * (judged_s - started_s), 1e3 * (ended_s - judged_s)))
        lane = estimator.step(frame, state, now_s=t_s)
    return found


def _state(motion: ShutterMotion, t_s: float) -> VehicleState:
    return VehicleState(
        t_s=t_s,
        speed_mps=motion.speed_mps,
        road_wheel_angle_rad=None,
        yaw_rate_radps=motion.yaw_rate_radps,
        driver_override=False,
    )


def _truck(road: Road, station_m: float) -> tuple[Pose, Body]:
    """A truck in the lane with its rear end at ``station_m``."""
    axle_m = station_m - TRUCK.rear_m
    return (*road.position(axle_m, 0.0), road.heading_at(axle_m)), TRUCK


def _road(case: SightCase, rng: np.random.Generator) -> tuple[Road, float, float]:
    """The road of a drive, the station at which it begins, and its speed [m/s]."""
    kinds = list(MarkingKind)
    kind = kinds[int(rng.integers(len(kinds)))]
    match case.kind:
        case "crest" | "dip":
            return _hill(kind, rng, sign=1.0 if case.kind == "crest" else -1.0)
        case "wall":
            return _walled_road(kind, rng)
        case "truck":
            shape = BendShape.STRAIGHT if case.number % 2 else BendShape.BEND
        case _:
            shape = list(BendShape)[case.number % len(BendShape)]
    road = random_road(kind, shape, rng)
    return road, float(rng.uniform(8.0, 60.0)), SPEEDS_MPS[shape]


def _hill(kind: MarkingKind, rng: np.random.Generator, *, sign: float) -> tuple[Road, float, float]:
    """A straight road over a hill, or with ``sign`` -1 through a valley; the drive begins before it or in it."""
    grade, radius_m = float(rng.uniform(*HILL_GRADES)), float(rng.uniform(*HILL_RADII_M))
    long_m = 2 * grade * radius_m
    grades = {0.0: grade, 120.0: grade, 120.0 + long_m: -grade, 320.0 + long_m: -grade}
    settings = _plain(kind, rng, (Segment(length_m=500.0 + long_m),)).model_copy(
        update={"elevation": tuple(ElevationPoint(at_m=at, grade=sign * g) for at, g in grades.items())}
    )
    return Road(settings), 120.0 + float(rng.uniform(-40.0, 0.4 * long_m)), 10.0


def _walled_road(kind: MarkingKind, rng: np.random.Generator) -> tuple[Road, float, float]:
    """A bend with a wall on its inside; the drive begins before it or within it."""
    radius_m, sign = float(rng.uniform(*BEND_RADII_M)), float(rng.choice([-1.0, 1.0]))
    bend, turn_m = sign / radius_m, 1.2 * radius_m
    segments = (
        Segment(length_m=60.0),
        Segment(length_m=20.0, curvature_1pm=(0.0, bend)),
        Segment(length_m=turn_m, curvature_1pm=bend),
        Segment(length_m=20.0, curvature_1pm=(bend, 0.0)),
        Segment(length_m=150.0),
    )
    wall = Wall(
        kind=WallKind(str(rng.choice([WallKind.STONE, WallKind.HEDGE, WallKind.HOUSES]))),
        side=Side.LEFT if sign > 0 else Side.RIGHT,
        from_m=50.0,
        to_m=100.0 + turn_m,
        distance_m=float(rng.uniform(*WALL_DISTANCES_M)),
    )
    settings = _plain(kind, rng, segments).model_copy(update={"walls": (wall,)})
    return Road(settings), float(rng.uniform(30.0, 70.0 + 0.5 * turn_m)), 7.0


def _plain(kind: MarkingKind, rng: np.random.Generator, segments: tuple[Segment, ...]) -> RoadSettings:
    return RoadSettings(
        name=str(kind),
        closed=False,
        lane_width_m=3.4,
        segments=segments,
        sections=(random_section(kind, rng),),
    )


def bench_sight(seed: int, *, jobs: int = 1, quick: bool = False, data: Path | None = None) -> dict[str, Any]:
    """Error, cause and deviation of the sight by what ends it, time of a frame, and the sight on real images."""
    cv2.setNumThreads(1)
    reach_m = load_sight_settings().limit_m
    drives = {case: case for case in cases(seed, quick=quick)}
    looked: dict[str, list[SightSample]] = {}
    for case, found in finish_tasks(drive, drives, jobs=jobs):
        for one in found:
            beside = one.true.cause == "" and one.true.distance_m < reach_m
            looked.setdefault(BESIDE if beside else case.row, []).append(one)
    kinds: dict[str, list[SightSample]] = {}
    for row, found in looked.items():
        kinds.setdefault(row if row == BESIDE else row.split()[0], []).extend(found)
    every = [one for found in looked.values() for one in found]
    scored = {row: scores(found) for row, found in sorted(looked.items())}
    return {
        "kinds": {kind: scores(found) for kind, found in sorted(kinds.items())} | {"all": scores(every)},
        "grades": {row: columns for row, columns in scored.items() if row not in kinds},
        "time": {
            "judge of the image": _times([one.judge_ms for one in every]),
            "its statistics alone": _times([one.statistics_ms for one in every]),
        },
        "real": dict(real(data_folder(data))),
    }


def scores(found: list[SightSample]) -> dict[str, float | int | None]:
    """The columns of a row."""
    true_m = np.array([one.true.distance_m for one in found])
    known = [one for one in found if one.seen.sight_m is not None]
    seen_m = np.array([_number(one.seen.sight_m) for one in found])
    sigma_m = np.array([_number(one.seen.sight_sigma_m) for one in found])
    off = np.abs(seen_m / true_m - 1)
    deviations = np.abs(seen_m - true_m) / sigma_m
    right = [one.seen.sight_cause == one.true.cause for one in known]
    return {
        "frames": len(found),
        "true_m": float(np.median(true_m)),
        "seen_m": _quantile(seen_m, 50),
        "error_percent": _quantile(100 * off, 50),
        "error_p90_percent": _quantile(100 * off, 90),
        "too_long_percent": 100 * float(np.mean(seen_m > 1.2 * true_m)),
        "right_cause_percent": 100 * float(np.mean(right)) if right else None,
        "absent_percent": 100 * (1 - len(known) / len(found)),
        "within_1_sigma_percent": 100 * float(np.mean(deviations[np.isfinite(deviations)] < 1)),
        "within_2_sigma_percent": 100 * float(np.mean(deviations[np.isfinite(deviations)] < 2)),
        "least_seen_m": _quantile(seen_m, 0),
    }


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _quantile(values: Array, percent: float) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.percentile(known, percent)) if len(known) else None


def _times(values_ms: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(values_ms, [50, 99])
    return {"median_ms": float(p50), "p99_ms": float(p99)}


def real(folder: Path) -> Iterator[tuple[str, dict[str, float | int | None]]]:
    """The sight in images of real cameras and of foreign simulators, all in clear air; absent sets are left out."""
    for name, sequences in SETS.items():
        if not (folder / name).is_dir():
            continue
        for part, sequence in sequences.items():
            seen = []
            for picture in islice(sequence.pictures(folder / name, REAL_EVERY), REAL_FRAMES):
                judge = build_judge(picture.camera, assumed=picture.assumed)
                seen.append(judge.step(Frame(t_s=0.0, image=picture.image), None, None, now_s=0.0))
            if seen:
                yield f"{name}, {part}", _clear_scores(seen)


def _clear_scores(seen: list[ImageStatistics]) -> dict[str, float | int | None]:
    sights_m = np.array([_number(one.sight_m) for one in seen])
    return {
        "frames": len(seen),
        "least_seen_m": _quantile(sights_m, 0),
        "seen_p5_m": _quantile(sights_m, 5),
        "seen_m": _quantile(sights_m, 50),
        "below_40_m_percent": 100 * float(np.mean(sights_m < SHORT_M)),
        "below_80_m_percent": 100 * float(np.mean(sights_m < LONG_M)),
        "fog_percent": 100 * float(np.mean([one.sight_cause == "fog" for one in seen])),
        "dark_percent": 100 * float(np.mean([one.sight_cause == "dark" for one in seen])),
        "absent_percent": 100 * float(np.mean(np.isnan(sights_m))),
    }
