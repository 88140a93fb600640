"""The lead detector on random rendered drives: recall, precision, errors by distance and by disturbance.

Every drive follows a leader at a varying gap on a random road, past parked and oncoming cars. The output of
``LeadFinder`` is compared with the truth of the simulator. The last rows are the parameters of
``config/lead_model.yaml``.
"""

import itertools
import math
import time
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.bench.follow.cases import random_segments
from lab.bench.perception.clips import truth_at
from learning.lead.frames import near_end, random_body
from perception.lead.finder import LeadFinder, build
from sim_harness.lockstep.oracle import Oracle
from sim_harness.lockstep.traffic import Traffic
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.loudness import note
from trepid.messages import Frame, LeadVehicle, VehicleState

Kind = DisturbanceKind
CONDITIONS: dict[str, tuple[Disturbance, ...]] = {"clear": ()} | {
    f"{kind} {grade}": (Disturbance(kind=kind, grade=grade),)
    for kind, grade in (
        (Kind.TREE_SHADOWS, 3),
        (Kind.LOW_SUN, 3),
        (Kind.GLARE, 2),
        (Kind.NIGHT, 2),
        (Kind.RAIN, 3),
        (Kind.FOG, 3),
        (Kind.SNOW, 2),
        (Kind.DIRT, 2),
        (Kind.NOISE, 3),
        (Kind.MOTION_BLUR, 3),
    )
}
DRIVE_S, PERIOD_S, SPEED_MPS = 16.0, 0.04, 6.0
GAPS_M = (3.0, 42.0)
BINS_M = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 42.0)
SAME_RATIO, SAME_ASIDE_M = 1.3, 1.0
CLEAR_DRIVES = 4


@dataclass(slots=True)
class Log:
    """True and estimated values, frame by frame; NaN for absent ones."""

    rows: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)

    def add(self, true: tuple[float, float, float] | None, said: LeadVehicle) -> None:
        """Append true and estimated gap [m], lateral place [m], speed [m/s]."""
        fields = (said.distance_m, said.lateral_m, said.speed_mps)
        self.rows.append(
            (*(true or (math.nan,) * 3), *(math.nan if value is None else value for value in fields))  # type: ignore[arg-type]
        )

    @property
    def table(self) -> NDArray[np.float64]:
        """Rows (n, 6)."""
        return np.array(self.rows, np.float64).reshape(-1, 6)


def bench_detector(seed: int) -> dict[str, Any]:
    """Recall, precision and errors of the detector on random rendered drives, and its time."""
    cv2.setNumThreads(1)
    logs: dict[str, list[Log]] = {}
    for number, (name, disturbances) in enumerate(CONDITIONS.items()):
        drives = CLEAR_DRIVES if name == "clear" else 1
        for again in range(drives):
            lots = np.random.default_rng((seed, 50, number, again))
            logs.setdefault(name, []).append(drive(lots, disturbances, with_leader=True))
        note(f"detector: {name} done")
    empty = [drive(np.random.default_rng((seed, 51, n)), (), with_leader=False) for n in range(2)]
    clear = np.concatenate([log.table for log in logs["clear"]])
    times_ms = 1e3 * np.concatenate([log.times_s for logs_ in logs.values() for log in logs_])
    result: dict[str, Any] = {
        "ms of processor time per frame (median, p99)": np.percentile(times_ms, (50, 99)).round(2).tolist(),
        "false leads without a leader, share of frames": _share(
            ~np.isnan(np.concatenate([log.table for log in empty])[:, 3])
        ),
    }
    for name, drives_ in logs.items():
        result[name] = figures(np.concatenate([log.table for log in drives_]))
    for low_m, high_m in itertools.pairwise(BINS_M):
        part = clear[(clear[:, 0] >= low_m) & (clear[:, 0] < high_m)]
        result[f"clear, {low_m:g} to {high_m:g} m"] = figures(part)
    return result | model([log.table for log in logs["clear"]])


def drive(rng: np.random.Generator, disturbances: tuple[Disturbance, ...], *, with_leader: bool) -> Log:
    """16 s along a random road: a leader at a varying gap, a parked and an oncoming car."""
    scenario = Scenario.model_validate(
        dict(
            name="lead",
            description="a leader whose gap swings",
            tags=["traffic"],
            road="straight",
            segments=random_segments(rng),
            duration_s=DRIVE_S,
            disturbances=[d.model_dump() for d in disturbances],
            traffic=_others(rng),
        )
    )
    road, vehicle = scenario.build_road(), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    world = _World(
        road, vehicle, Traffic(scenario.traffic, road, nose_m=12.0), random_body(rng), rng, with_leader
    )
    seed = int(rng.integers(2**31))
    renderer = Renderer(road, camera, seed=seed, disturbances=disturbances)
    finder, oracle, log = build(), Oracle("cv", road, vehicle), Log()
    for n in range(round(DRIVE_S / PERIOD_S)):
        _frame(world, renderer, finder, oracle, log, n * PERIOD_S)
    return log


@dataclass(slots=True)
class _World:
    """Poses of all vehicles."""

    road: Road
    vehicle: Vehicle
    others: Traffic
    body: Body
    rng: np.random.Generator
    with_leader: bool
    station_m: float = 10.0
    phase: float = field(init=False)

    def __post_init__(self) -> None:
        self.phase = float(self.rng.uniform(0, 2 * math.pi))

    def gap_m(self, t_s: float) -> float:
        """Gap [m]: a sine between the least and the greatest one."""
        middle, half = (GAPS_M[1] + GAPS_M[0]) / 2, (GAPS_M[1] - GAPS_M[0]) / 2
        return middle - half * math.cos(2 * math.pi * t_s / DRIVE_S + self.phase)

    def leader(self, t_s: float) -> tuple[float, float, float]:
        """Its pose; its rear is ``gap_m`` ahead of the ego bumper."""
        nose_m = self.station_m + self.vehicle.wheelbase_m + self.vehicle.front_overhang_m
        station_m = nose_m + self.gap_m(t_s) - self.body.rear_m
        x_m, y_m = self.road.position(station_m, 0.2 * math.sin(0.7 * t_s))
        return x_m, y_m, self.road.heading_at(station_m)


def _frame(
    world: _World, renderer: Renderer, finder: LeadFinder, oracle: Oracle, log: Log, t_s: float
) -> None:
    road, offset_m = world.road, 0.1 * math.sin(0.5 * t_s)
    world.station_m = 10.0 + SPEED_MPS * t_s
    x_m, y_m = road.position(world.station_m, offset_m)
    yaw_rad = road.heading_at(world.station_m)
    rate = SPEED_MPS * road.curvature_at(world.station_m)
    vehicles = [(actor.pose, actor.body) for actor in world.others.actors]
    leader = world.leader(t_s)
    if world.with_leader:
        vehicles.append((leader, world.body))
    image = renderer.render(
        x_m,
        y_m,
        yaw_rad,
        t_s=t_s,
        station_m=world.station_m,
        vehicles=vehicles,
        motion=ShutterMotion(SPEED_MPS, rate),
    )
    state = VehicleState(
        t_s=t_s, speed_mps=SPEED_MPS, road_wheel_angle_rad=0.0, yaw_rate_radps=rate, driver_override=False
    )
    lane = oracle.step(truth_at(road, world.station_m, offset_m, t_s=t_s, speed_mps=SPEED_MPS))
    started_s = time.thread_time()
    said = finder.step(Frame(t_s=t_s, image=image), state, [lane], now_s=t_s)
    log.times_s.append(time.thread_time() - started_s)
    nose_m = world.vehicle.wheelbase_m + world.vehicle.front_overhang_m
    true = None
    if world.with_leader:
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        dx, dy = leader[0] - x_m, leader[1] - y_m
        pose = dx * cos + dy * sin, dy * cos - dx * sin, leader[2] - yaw_rad
        ahead_m, left_m = near_end(pose, world.body)
        later = world.leader(t_s + 1e-3)
        slope = (world.gap_m(t_s + 1e-3) - world.gap_m(t_s)) / 1e-3
        along = (SPEED_MPS + slope) * math.cos(later[2] - yaw_rad)
        true = ahead_m - nose_m, left_m, along
    world.others.step(t_s, PERIOD_S, nose_m=world.station_m + nose_m)
    log.add(true, said)


def _others(rng: np.random.Generator) -> tuple[dict[str, Any], ...]:
    """Vehicles that are not the leader."""
    parked = {"station_m": float(rng.uniform(40, 90)), "lane": -1, "offset_m": 0.3}
    oncoming = {"station_m": float(rng.uniform(90, 180)), "lane": 1, "speed_mps": 6.0, "oncoming": True}
    return parked, oncoming


def figures(table: NDArray[np.float64]) -> dict[str, Any]:
    """Recall, precision, and errors of right detections."""
    there, said = ~np.isnan(table[:, 0]), ~np.isnan(table[:, 3])
    right = _right(table)
    if not there.any():
        return {}
    ratio = np.log(np.maximum(table[right, 3], 0.1) / np.maximum(table[right, 0], 0.1))
    aside_m, speed_mps = table[right, 4] - table[right, 1], table[right, 5] - table[right, 2]
    return {
        "recall": _share(right[there]),
        "precision": _share(right[said]),
        "distance error % (rms, bias)": [_percent(_rms(ratio)), _percent(np.mean(ratio))]
        if len(ratio)
        else None,
        "lateral error m (rms)": round(_rms(aside_m), 3) if len(aside_m) else None,
        "speed error m/s (rms)": round(_rms(speed_mps), 2) if np.isfinite(speed_mps).any() else None,
    }


def _right(table: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Frames with a right detection of the leader: within metres when near, within a ratio when far."""
    off_m = np.abs(table[:, 3] - table[:, 0])
    close = (off_m < 1.5) | (off_m < (SAME_RATIO - 1) * table[:, 0])
    return np.asarray(close & (np.abs(table[:, 4] - table[:, 1]) < SAME_ASIDE_M))


def model(tables: list[NDArray[np.float64]]) -> dict[str, Any]:
    """Parameters of ``config/lead_model.yaml``, from drives in clear weather."""
    table = np.concatenate(tables)
    rows: dict[str, list[float]] = {
        name: [] for name in ("distance_bias", "distance_sigma", "lateral_sigma_m", "speed_sigma_mps", "seen")
    }
    for low_m, high_m in itertools.pairwise(BINS_M):
        part = table[(table[:, 0] >= low_m) & (table[:, 0] < high_m)]
        right = part[_right(part)]
        ratio, aside_m = right[:, 3] / right[:, 0] - 1, right[:, 4] - right[:, 1]
        rows["distance_bias"].append(round(float(np.median(ratio)), 3))
        rows["distance_sigma"].append(round(float(np.std(ratio)), 3))
        rows["lateral_sigma_m"].append(round(_rms(aside_m), 3))
        rows["speed_sigma_mps"].append(round(_rms(right[:, 5] - right[:, 2]), 2))
        rows["seen"].append(_share(_right(part)))
    memories = [_memory_s(part[_right(part)]) for part in tables]
    losses = [length for part in tables for length in _loss_lengths_s(~_right(part))]
    return {f"model {name}": values for name, values in rows.items()} | {
        "model memory_s": round(float(np.median(memories)), 2),
        "model lost_for_s": round(float(np.mean(losses)), 2) if losses else None,
    }


def _memory_s(right: NDArray[np.float64]) -> float:
    """Time in which the autocorrelation of the lateral error falls to 1/e [s]."""
    error = right[:, 4] - right[:, 1]
    error = error - error.mean()
    for lag in range(1, len(error) // 2):
        if float(error[lag:] @ error[:-lag]) / float(error @ error) < 1 / math.e:
            return lag * PERIOD_S
    return DRIVE_S


def _loss_lengths_s(lost: NDArray[np.bool_]) -> list[float]:
    """Duration of each loss of detection [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    return (np.diff(edges)[::2] * PERIOD_S).tolist()


def _share(values: NDArray[np.bool_]) -> float:
    return round(float(np.mean(values)), 4) if len(values) else math.nan


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.nanmean(np.square(values)))) if len(values) else math.nan


def _percent(share: float | np.floating[Any]) -> float:
    return round(100 * float(share), 1)
