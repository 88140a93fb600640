"""Roads that rise, fall and lean: laps under supervision, errors of the estimators ahead, and stops behind crests.

The lap is the circuit with random heights: grades up to 12 %, crests behind which the camera sees 30 m, banks up to
6 % (0.06 rad), whether they help in the bend or not. The error of an estimator is that of the lane centre 15 m
ahead of the rear axle, on random roads from equal places; the flat road is the same one without its heights. At a
crest of random shape and place stands a car that the top hides at first.

Every drive is one line in ``runs/hills_<seed>.jsonl``; stored ones are not repeated, so that an interrupted
benchmark continues.
"""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.bench.drawn_cases import drawn_scenario
from perception.estimators import entry_of
from sim_harness.lockstep.closed_loop import Instant, run
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.store import Row, stored_rows
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.drawn import BendShape, MarkingKind, random_road, with_hills
from sim_harness.world.roads.road import Road
from supervisor.modes.modes import DRIVING
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, load
from trepid.messages import Frame, SteeringEstimate, VehicleState

ESTIMATORS = ("cv", "cnn")
SEEDS, QUICK_LAP_M = 3, 250.0
ROADS, QUICK_ROADS = 40, 6
STOPS, QUICK_STOPS = 100, 5
AHEAD_M, SURE = 15.0, 0.5
STEP_S, SPEED_MPS, WARM_UP_S, DRIVEN_S = 0.04, 6.0, 0.6, 6.0
FIRST_M = 15.0
WAITING_S, STANDING_MPS = 10.0, 0.05  # of a car before a vehicle that it stopped for
GRADES, ROOF_M = (0.03, 0.12), 1.48  # of both sides of a crest; of a standing car
KINDS = (MarkingKind.WHITE, MarkingKind.DASHED, MarkingKind.YELLOW, MarkingKind.MULTI_LANE)
SHAPES = (BendShape.STRAIGHT, BendShape.BEND)
TARGETS = "targets: departures 0; error 0.3 m; engaged 90 %; cv 2 times a flat road; no contact in a stop"


class Drive(NamedTuple):
    """One drive: a lap, a look at a road or a stop."""

    part: str
    number: int
    seed: int
    quick: bool = False
    estimator: str = ""
    hilly: bool = False

    @property
    def key(self) -> str:
        """Its name in the store."""
        return " ".join(str(field) for field in self)


def bench_hills(
    seed: int, quick: bool = False, count: int | None = None, jobs: int | None = None
) -> dict[str, Any]:
    """Laps, errors ahead and stops. ``count``: of stops, and of roads for the errors."""
    drives = [Drive("lap", number, seed, quick) for number in range(1 if quick else SEEDS)]
    drives += [
        Drive("look", number, seed, quick, name, hilly)
        for number in range(count or (QUICK_ROADS if quick else ROADS))
        for name in ESTIMATORS
        for hilly in (False, True)
    ]
    drives += [
        Drive("stop", number, seed, quick) for number in range(count or (QUICK_STOPS if quick else STOPS))
    ]
    path = WORK_DIR / "runs" / f"hills_{seed}.jsonl"
    rows = stored_rows(path, driven_row, {drive.key: drive for drive in drives}, jobs=jobs)
    return summary(list(zip(drives, rows, strict=True)))


def driven_row(drive: Drive) -> Row:
    """The stored row of a drive."""
    return {"lap": _lap, "look": _look, "stop": _stop}[drive.part](drive)


def _lap(drive: Drive) -> Row:
    rng = np.random.default_rng((drive.seed, 531, drive.number))
    settings = with_hills(load_road("circuit").settings, rng)
    with tempfile.TemporaryDirectory() as folder:
        road = Path(folder) / "hills.yaml"
        road.write_text(settings.model_dump_json(exclude_defaults=True), encoding="utf-8")  # JSON is YAML
        scenario = Scenario.model_validate(
            {
                "name": "hills",
                "description": "a lap of the circuit over random hills",
                "tags": ("height",),
                "road": str(road),
                "start": {"station_m": 20.0, "speed_mps": 5.0},
                "duration_s": 600.0,
                "distance_m": QUICK_LAP_M if drive.quick else None,
                "plant": {"model": "single_track", "springs": {}},
            }
        )
        result = run(scenario, seed=drive.number)
    metrics, words = result.metrics, result.trace.words["mode"]
    driven = np.isin(result.trace["mode"], [code for code, word in enumerate(words) if word in DRIVING])
    return {
        "finished": bool(result.trace["finished"][-1]),
        "departures": metrics.departures,
        "largest_offset_m": metrics.max_lateral_error_m,
        "engaged_percent": 100.0 * float(driven.mean()),
        "mean_speed_mps": metrics.mean_speed_mps,
        "mean_fear": metrics.mean_fear,
    }


def _look(drive: Drive) -> Row:
    """Errors of one estimator, driven along the lane at an even speed."""
    rng = np.random.default_rng((drive.seed, 532, drive.number))
    kind, shape = KINDS[drive.number % len(KINDS)], SHAPES[drive.number // len(KINDS) % len(SHAPES)]
    hills = random_road(kind, shape, rng, hilly=True)
    road = hills if drive.hilly else Road(hills.settings.model_copy(update={"elevation": (), "bank": ()}))
    camera, car = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    renderer = Renderer(road, camera, seed=drive.number)
    estimator = entry_of(drive.estimator).build(camera, car)
    errors_m, frames = [], 0
    for step in range(round((WARM_UP_S + DRIVEN_S) / STEP_S)):
        t_s = step * STEP_S
        station_m, offset_m = FIRST_M + SPEED_MPS * t_s, 0.3 * math.sin(0.4 * t_s)
        heading_rad = road.heading_at(station_m) + math.atan2(0.12 * math.cos(0.4 * t_s), SPEED_MPS)
        x_m, y_m = road.position(station_m, offset_m)
        rate = SPEED_MPS * road.curvature_at(station_m)
        image = renderer.render(
            x_m, y_m, heading_rad, t_s=t_s, station_m=station_m, motion=ShutterMotion(SPEED_MPS, rate)
        )
        state = VehicleState(
            t_s=t_s,
            speed_mps=SPEED_MPS,
            road_wheel_angle_rad=math.atan(car.wheelbase_m * road.curvature_at(station_m)),
            yaw_rate_radps=rate,
            driver_override=False,
        )
        seen = estimator.step(Frame(t_s=t_s, image=image), state, now_s=t_s)
        if t_s < WARM_UP_S:
            continue
        frames += 1
        place_m = lane_ahead_m(seen, AHEAD_M)
        if place_m is not None and seen.confidence >= SURE:
            errors_m.append(place_m - true_lane_ahead_m(road, station_m, (x_m, y_m, heading_rad), AHEAD_M))
    return {"frames": frames, "errors_m": [round(error_m, 4) for error_m in errors_m]}


def lane_ahead_m(seen: SteeringEstimate, ahead_m: float) -> float | None:
    """How far left of the vehicle the lane centre lies ``ahead_m`` ahead; None without a lane.

    The clothoid of the estimate to third order: y = -e/cos ψ - X·tan ψ + κ₀·X²/2 + κ'·X³/6.
    """
    offset_m, heading_rad = seen.lateral_offset_m, seen.heading_error_rad
    if offset_m is None or heading_rad is None:
        return None
    rate = seen.curvature_rate_1pm2 or 0.0
    at_axle_1pm = (seen.curvature_1pm or 0.0) - rate * seen.lookahead_m
    straight_m = -offset_m / math.cos(heading_rad) - ahead_m * math.tan(heading_rad)
    return straight_m + at_axle_1pm * ahead_m**2 / 2 + rate * ahead_m**3 / 6


def true_lane_ahead_m(
    road: Road, station_m: float, pose: tuple[float, float, float], ahead_m: float
) -> float:
    """How far left of the vehicle at ``pose`` the lane centre lies ``ahead_m`` ahead."""
    stations = station_m + np.linspace(0.8, 1.4, 121) * ahead_m
    away = road.positions(stations, np.zeros(len(stations))) - pose[:2]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return float(np.interp(ahead_m, away @ (cos, sin), away @ (-sin, cos)))


def _stop(drive: Drive) -> Row:
    rng = np.random.default_rng((drive.seed, 533, drive.number))
    scenario, seed = crest_case(rng), int(rng.integers(2**31))
    metrics = run(scenario, seed=seed, until=_Waiting()).metrics
    return {
        "collisions": metrics.collisions,
        "departures": metrics.departures,
        "max_decel_mps2": metrics.max_decel_mps2,
        "set_mps": scenario.speed_mps,
    }


class _Waiting:
    """Whether a car that has driven stands for WAITING_S: what it may do next is to creep on."""

    def __init__(self) -> None:
        self._moved_s = math.inf

    def __call__(self, now: Instant) -> bool:
        speed_mps = now.truth.speed_mps  # None after a contact
        if speed_mps is not None and abs(speed_mps) > STANDING_MPS:
            self._moved_s = now.now_s
        return now.now_s > self._moved_s + WAITING_S


def crest_case(rng: np.random.Generator) -> Scenario:
    """A car behind a crest of 300 to 1200 m radius, between grades of up to 12 %, at a set speed of 5 to 15 m/s."""
    while True:
        radius_m, up, down = (float(rng.uniform(*span)) for span in ((300, 1200), GRADES, GRADES))
        foot_m, climb_m = 40.0, 200.0 * up + 20.0
        begins_m = foot_m + climb_m + 30.0
        ends_m = begins_m + radius_m * (up + down)
        profile = ((foot_m, 0.0), (foot_m + climb_m, up), (begins_m, up), (ends_m, -down))
        car_m = begins_m + radius_m * up + float(rng.uniform(5.0, 60.0))
        scenario = drawn_scenario(
            "crest",
            "a car stands behind a crest",
            rendered=True,
            start_mps=4.0,
            segments=[{"length_m": ends_m + 200.0}],
            elevation=[{"at_m": at_m, "grade": grade} for at_m, grade in profile],
            speed_mps=float(rng.uniform(5.0, 15.0)),
            traffic=[{"station_m": car_m}],
            duration_s=car_m / 4.0 + 20.0,
            tags=["height"],
        )
        if _is_hidden(scenario.build_road(), car_m):
            return scenario


def _is_hidden(road: Road, car_m: float) -> bool:
    """Whether the ground meets the line from the lens at the start to the roof of a car."""
    heights_m = road.heights_at(np.linspace(0.0, car_m, 400))
    eye_m, roof_m = heights_m[0] + load(CONFIG_DIR / "camera.yaml", Camera).height_m, heights_m[-1] + ROOF_M
    return bool((heights_m > np.linspace(eye_m, roof_m, 400)).any())


def summary(driven: Sequence[tuple[Drive, Row]]) -> dict[str, Any]:
    """The tables of the benchmark."""
    laps = {f"lap {d.number}": row for d, row in driven if d.part == "lap"}
    errors = {}
    for name in ESTIMATORS:
        flat, hilly = (
            [row for d, row in driven if d.part == "look" and d.estimator == name and d.hilly is on]
            for on in (False, True)
        )
        errors[f"{name}, flat"], errors[f"{name}, hills"] = _errors(flat), _errors(hilly)
        least_m, most_m = errors[f"{name}, flat"]["rms_m"], errors[f"{name}, hills"]["rms_m"]
        errors[f"{name}, hills"]["times_flat"] = (
            round(most_m / least_m, 2) if least_m and most_m is not None else None
        )
    stops = [row for d, row in driven if d.part == "stop"]
    return {
        "laps": laps,
        "lane 15 m ahead": errors,
        "stops behind a crest": {
            "all": {
                "stops": len(stops),
                "collisions": sum(row["collisions"] > 0 for row in stops),
                "departures": sum(row["departures"] for row in stops),
                "greatest_decel_mps2": round(max(row["max_decel_mps2"] for row in stops), 2),
            }
        },
        "targets": TARGETS,
    }


def _errors(rows: Sequence[Row]) -> Row:
    errors_m = np.array([error_m for row in rows for error_m in row["errors_m"]])
    frames = sum(row["frames"] for row in rows)
    if not len(errors_m):
        return {"frames": frames, "sure": 0.0, "rms_m": None, "p95_m": None, "mean_m": None}
    return {
        "frames": frames,
        "sure": round(len(errors_m) / frames, 3),
        "rms_m": round(float(np.sqrt(np.mean(errors_m**2))), 3),
        "p95_m": round(float(np.quantile(np.abs(errors_m), 0.95)), 3),
        "mean_m": round(float(errors_m.mean()), 3),
    }
