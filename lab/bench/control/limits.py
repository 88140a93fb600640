"""Random drives through the limiter on four plants: compliance with ISO 11270 and UN R79.

An episode is feasible by construction: the car equals its vehicle file, has grip, and starts within the limits on a
steady bend. The demands are arbitrary: angles up to the stops as steps, ramps, sines and noise, full drive and full
brake in spans of random length. The motion of the plant is judged, not the commands:

    lateral acceleration  |a_y| ≤ 3 m/s²                                                    ISO 11270:2014
    lateral jerk          |a_y(t + 0.5 s) - a_y(t)|/0.5 s ≤ 5 m/s³, of a_y unfiltered       ISO 11270:2014
    the same              of a_y after a Butterworth filter of fourth order, 0.5 Hz         UN R79 rev. 4 annex 8
    deceleration          ≤ 4 m/s²                                                          UN R157 5.3

CommonRoad's plants are driven up to 15 m/s: above it, the mass of a BMW on the wheelbase of the shuttle spins when
it brakes hard in a bend.

Every episode is written down in ``out/limits``, so that a run that was cut short goes on where it was.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi

from controller.limiter import build
from sim_harness.judging.comfort import JERK_WINDOW_S, R79_CUTOFF_HZ, R79_ORDER
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.progress import SweepProgress
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, load
from trepid.messages import Command
from trepid.types import Column

TICK_S, CONTROL_TICKS = 0.01, 2
SLOWEST_MPS = 2.0
DEPENDS_ON = (
    *("controller/limiter", "sim_harness/world/plants", "lab/bench/control/limits.py"),
    *("config/limiter.yaml", "config/vehicle.yaml"),
)


class Group(NamedTuple):
    """Episodes on one plant."""

    model: Model
    episodes: int
    duration_s: float
    fastest_mps: float


GROUPS = (  # in all 10 000; a step of the multi-body model takes 16 times as long as one of the kinematic one
    Group(Model.KINEMATIC, 5000, 4.0, 30.0),
    Group(Model.SINGLE_TRACK, 4000, 4.0, 30.0),
    Group(Model.COMMONROAD_DRIFT, 700, 4.0, 15.0),
    Group(Model.COMMONROAD_MULTI_BODY, 300, 3.0, 15.0),
)
LATERAL_MPS2, JERK_MPS3, DECEL_MPS2 = 3.0, 5.0, 4.0
_R79 = butter(R79_ORDER, R79_CUTOFF_HZ, fs=1.0 / TICK_S, output="sos")


class Worst(NamedTuple):
    """Largest values of an episode, or of many."""

    lateral_mps2: float
    jerk_mps3: float
    r79_jerk_mps3: float
    decel_mps2: float

    @property
    def breaches(self) -> bool:
        """True if a value exceeds its standard."""
        return (
            self.lateral_mps2 > LATERAL_MPS2
            or max(self.jerk_mps3, self.r79_jerk_mps3) > JERK_MPS3
            or self.decel_mps2 > DECEL_MPS2
        )


def bench_limits(seed: int, groups: tuple[Group, ...] = GROUPS, folder: Path | None = None) -> dict[str, Any]:
    """Breaches and the largest values on every plant."""
    folder = folder or WORK_DIR / "out" / "limits"
    folder.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {}
    for group in groups:
        worst = _drive_group(
            group, seed, folder / f"{seed}-{group.model.value}-{fingerprint(*DEPENDS_ON)}.csv"
        )
        peak = Worst(*np.max(worst, axis=0).tolist())
        result[group.model.value] = {
            "episodes": len(worst),
            "breaches": sum(one.breaches for one in worst),
            **{name: round(value, 3) for name, value in peak._asdict().items()},
        }
    return result


def _drive_group(group: Group, seed: int, file: Path) -> list[Worst]:
    """Every episode of ``group``: stored ones from ``file``, the others are driven and stored there."""
    lines = file.read_text().splitlines(keepends=True) if file.exists() else []
    worst = [Worst(*map(float, line.split(","))) for line in lines if line.endswith("\n")][: group.episodes]
    left = group.episodes - len(worst)
    with file.open("w") as out, SweepProgress(left, left) as progress:
        out.writelines(map(_line, worst))
        for index in range(len(worst), group.episodes):
            worst.append(episode(group, np.random.default_rng((seed, index))))
            out.write(_line(worst[-1]))
            out.flush()
            progress.step(1.0)
    return worst


def _line(one: Worst) -> str:
    return ",".join(map(repr, one)) + "\n"


def episode(group: Group, generator: np.random.Generator) -> Worst:
    """One random drive. Raises InputError where the plant's library is missing."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    plant = build_plant(PlantSettings(model=group.model), vehicle)
    limiter = build(plant.vehicle)
    ticks = round(group.duration_s / TICK_S)
    angles_rad, accels_mps2 = random_demands(generator, ticks, vehicle.max_road_wheel_angle_rad)
    car, command, rows = _start(plant, group.fastest_mps, generator), None, []
    for tick in range(ticks):
        now_s = tick * TICK_S
        if tick % CONTROL_TICKS == 0:
            command = Command(
                t_s=now_s,
                road_wheel_angle_rad=angles_rad[tick],
                speed_mps=0.0,
                accel_mps2=accels_mps2[tick],
            )
        given = limiter.step(command, now_s, plant.measure(car, now_s), now_s=now_s)
        car = plant.step(car, given, TICK_S)
        rows.append((plant.lateral_accel_mps2(car), car.accel_mps2))
    lateral_mps2, accel_mps2 = np.array(rows).T
    return judge_columns(lateral_mps2, accel_mps2)


def _start(plant: Plant, fastest_mps: float, generator: np.random.Generator) -> PlantState:
    """A steady bend within the limits for demands."""
    speed_mps = float(generator.uniform(SLOWEST_MPS, fastest_mps))
    tightest_1pm = min(0.9 * LATERAL_MPS2 / speed_mps**2, 0.3)
    return plant.initial(speed_mps=speed_mps, curvature_1pm=float(generator.uniform(-1, 1)) * tightest_1pm)


def random_demands(
    generator: np.random.Generator, ticks: int, limit_rad: float
) -> tuple[list[float], list[float]]:
    """Demanded angles and accelerations, per tick."""
    t_s = TICK_S * np.arange(ticks)
    size_rad = limit_rad * 10.0 ** generator.uniform(-2.0, 0.2)
    angle_rad = size_rad * _spans(generator, ticks)
    if generator.random() < 0.5:
        rate_radps = generator.uniform(0.3, 12.0)
        angle_rad = angle_rad + size_rad * np.sin(rate_radps * t_s + generator.uniform(0.0, 6.3))
    if generator.random() < 0.3:
        angle_rad = angle_rad + 0.1 * size_rad * generator.standard_normal(ticks)
    accel_mps2 = 6.0 * _spans(generator, ticks)
    return angle_rad.tolist(), accel_mps2.tolist()


def _spans(generator: np.random.Generator, ticks: int) -> Column:
    """Values within ±1 in spans of 0.1 to 3 s, a third of which are ramps and a fourth at an end."""
    values, last = np.empty(0), float(generator.uniform(-1.0, 1.0))
    while len(values) < ticks:
        next_ = float(generator.uniform(-1.0, 1.0))
        if generator.random() < 0.25:
            next_ = math.copysign(1.0, next_)
        span = round(float(generator.uniform(0.1, 3.0)) / TICK_S)
        first = last if generator.random() < 0.33 else next_
        values = np.concatenate([values, np.linspace(first, next_, span)])
        last = next_
    return values[:ticks]


def judge_columns(lateral_mps2: Column, accel_mps2: Column) -> Worst:
    """The largest magnitudes; accelerations sampled at 100 Hz."""
    settled, _ = sosfilt(_R79, lateral_mps2, zi=sosfilt_zi(_R79) * lateral_mps2[0])
    return Worst(
        float(np.abs(lateral_mps2).max()),
        _mean_jerk(lateral_mps2),
        _mean_jerk(settled),
        float(-accel_mps2.min()),
    )


def _mean_jerk(lateral_mps2: Column) -> float:
    window = round(JERK_WINDOW_S / TICK_S)
    return float(np.abs(lateral_mps2[window:] - lateral_mps2[:-window]).max() / JERK_WINDOW_S)
