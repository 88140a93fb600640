"""Each estimator alone in closed loop: its road-wheel angle is the command, as in the review.

There is no supervisor and no controller; without an estimate the angle is held. When a wheel leaves the lane or the
offset exceeds a metre, the car is put back on the lane centre.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from drive.tally import autonomy_percent
from perception.estimators import entry_of
from sim_harness.lockstep.referee import Referee, locate
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint
from sim_harness.sweep.store import Row, stored_rows
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.state import PlantState
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.drawn import BendShape, MarkingKind, random_section, random_segments
from sim_harness.world.roads.road import Road, RoadSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, Frame, VehicleState

_Drive = tuple[int, int, str]  # seed, number of the course, estimator

COURSES: tuple[tuple[MarkingKind, DisturbanceKind | None, int], ...] = (
    (MarkingKind.WHITE, None, 0),
    (MarkingKind.YELLOW, DisturbanceKind.TREE_SHADOWS, 3),
    (MarkingKind.DASHED, DisturbanceKind.RAIN, 2),
    (MarkingKind.WORN, None, 0),
    (MarkingKind.WHITE, DisturbanceKind.NIGHT, 2),
    (MarkingKind.ASPHALT, None, 0),
    (MarkingKind.GRAVEL, None, 0),
    (MarkingKind.MULTI_LANE, DisturbanceKind.GLARE, 2),
)
QUICK_COURSES = 3
DURATION_S, SPEED_MPS = 30.0, 6.0
STEP_S, STEPS_PER_FRAME = 0.02, 2
START_M, START_OFFSET_M = 3.0, 0.4
MAX_OFFSET_M = 1.0
CODE = (
    "lab/bench/perception/drive.py",
    "sim_harness/world/plants",
    "sim_harness/world/render",
    "sim_harness/world/roads",
    "config/camera.yaml",
    "config/disturbances.yaml",
)


def bench_drive(
    names: Sequence[str], seed: int, folder: Path, *, quick: bool, jobs: int = 1
) -> dict[str, Row]:
    """Over all courses: autonomy, interventions, root mean square offset and share of time without an estimate.

    Drives run on ``jobs`` processes; stored ones are not repeated. Raises WorkerLost after the other drives when a
    process was killed.
    """
    courses = range(QUICK_COURSES if quick else len(COURSES))
    rows = drive_rows(names, seed, folder, courses=courses, jobs=jobs)
    return {name: _total(found) for name, found in rows.items()}


def drive_rows(
    names: Sequence[str], seed: int, folder: Path, *, courses: Sequence[int], jobs: int = 1
) -> dict[str, list[Row]]:
    """Estimator -> the row of each of ``courses`` (numbers in COURSES), as of :func:`bench_drive`."""
    drives = {
        f"seed {seed} course {number} {name}": (seed, number, name) for number in courses for name in names
    }
    codes = {key: f"{estimator_fingerprint(name)} {fingerprint(*CODE)}" for key, (*_, name) in drives.items()}
    rows = stored_rows(folder / "drive.jsonl", _drive, drives, codes=codes, jobs=jobs)
    return {name: rows[number :: len(names)] for number, name in enumerate(names)}


def _drive(drive: _Drive) -> Row:
    """One course with one estimator."""
    cv2.setNumThreads(1)
    seed, number, name = drive
    road, renderer = _course(seed, number)
    real = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    car = real.model_copy(update={"understeer_gradient_rad_per_mps2": 0.0})  # estimates contain no understeer
    plant, referee = KinematicPlant(car), Referee(road, car, max_offset_m=MAX_OFFSET_M)
    estimator = entry_of(name).build(renderer.camera, real)
    state = _state_at(plant, road, START_M, START_OFFSET_M)
    place = locate(road, state, START_M)
    angle_rad, blind, offsets = 0.0, 0, []
    for step in range(round(DURATION_S / STEP_S)):
        t_s = step * STEP_S
        if step % STEPS_PER_FRAME == 0:
            rate = plant.yaw_rate_radps(state)
            frame, reported = _frame_and_state(renderer, state, rate, place.station_m, t_s)
            seen = estimator.step(frame, reported, now_s=t_s).road_wheel_angle_rad
            blind += seen is None
            angle_rad = angle_rad if seen is None else seen
        command = Command(t_s=t_s, road_wheel_angle_rad=angle_rad, speed_mps=SPEED_MPS, accel_mps2=0.0)
        state = plant.step(state, command, STEP_S)
        place = locate(road, state, place.station_m)
        if referee.must_recentre(state, place):
            state = _state_at(plant, road, place.station_m, 0.0)
            place, angle_rad = locate(road, state, place.station_m), state.road_wheel_angle_rad
        offsets.append(place.offset_m)
    return {
        "interventions": referee.interventions,
        "square_m2": float(np.mean(np.square(offsets))),
        "blind": blind / (DURATION_S / STEP_S / STEPS_PER_FRAME),
    }


@lru_cache(maxsize=1)  # drives of the same course follow each other
def _course(seed: int, number: int) -> tuple[Road, Renderer]:
    """A random road, and its camera images with the disturbance of the course."""
    kind, disturbance, grade = COURSES[number]
    rng = np.random.default_rng((seed, 62, number))
    shapes = [BendShape.BEND, BendShape.TIGHT, BendShape.STRAIGHT]
    segments = tuple(segment for shape in shapes for segment in random_segments(shape, rng)[:-1])
    road = Road(
        RoadSettings(
            name=f"{kind}",
            closed=False,
            lane_width_m=float(rng.uniform(3.2, 3.6)),
            segments=segments,
            sections=(random_section(kind, rng),),
        )
    )
    disturbances = () if disturbance is None else (Disturbance(kind=disturbance, grade=grade),)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    return road, Renderer(road, camera, seed=seed, disturbances=disturbances)


def _state_at(plant: KinematicPlant, road: Road, station_m: float, offset_m: float) -> PlantState:
    """Along the lane at the usual speed."""
    x_m, y_m = road.position(station_m, offset_m)
    curvature = road.curvature_at(station_m)
    return plant.initial(x_m, y_m, road.heading_at(station_m), SPEED_MPS, curvature)


def _frame_and_state(
    renderer: Renderer, state: PlantState, rate: float, station_m: float, t_s: float
) -> tuple[Frame, VehicleState]:
    """The frame at ``state``, and the state as the vehicle reports it."""
    motion = ShutterMotion(state.speed_mps, rate)
    image = renderer.render(state.x_m, state.y_m, state.yaw_rad, t_s=t_s, station_m=station_m, motion=motion)
    reported = VehicleState(
        t_s=t_s,
        speed_mps=state.speed_mps,
        road_wheel_angle_rad=state.road_wheel_angle_rad,
        yaw_rate_radps=rate,
        driver_override=False,
    )
    return Frame(t_s=t_s, image=image), reported


def _total(rows: Sequence[Row]) -> dict[str, Any]:
    interventions = sum(row["interventions"] for row in rows)
    return {
        "autonomy_pct": float(np.mean([autonomy_percent(row["interventions"], DURATION_S) for row in rows])),
        "interventions": interventions,
        "courses_without": sum(row["interventions"] == 0 for row in rows),
        "courses": len(rows),
        "offset_m_rms": math.sqrt(float(np.mean([row["square_m2"] for row in rows]))),
        "blind_pct": 100 * float(np.mean([row["blind"] for row in rows])),
    }
