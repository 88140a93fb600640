"""Tracking error of the lateral laws, pure pursuit and Stanley on the same episodes and seeds.

The lane is measured as far ahead as the car drives until a command takes effect, because preview of bends is a
property of perception; only the first figure requires it. Baselines without understeer assume a neutral car.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from controller.controller import ControllerSettings
from controller.laws.lateral import LawName
from sim_harness.bench.control.episode import S_DURATION_S, TICK_S, Episode, Track, drive, road_of, s_clothoid
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.roads.road import Road
from trepid.config import CONFIG_DIR, load
from trepid.vehicle import Vehicle

SPEEDS_MPS = (10.0, 20.0, 30.0)
UNDERSTEER_DEG_PER_G = (0.0, 0.94, 2.45, 5.0)
DELAYS_S, LAGS_S = (0.0, 0.1, 0.2, 0.3), (0.05, 0.1, 0.2, 0.3)
WRONG = (0.7, 1.3)
GRID_MPS = 20.0
BANK_RAD, OFFSET_RAD = math.atan(0.06), math.radians(0.5)
SETTLED_S = 5.0
RANDOM_CASES = 40  # for each law; control-random drives a thousand with the default one
NOISE_M, RANDOM_TARGET_M = 0.03, 0.08
REAR_SLIP = 1.0 / (
    PlantSettings().chassis.rear_stiffness_per_rad * GRAVITY_MPS2
)  # R of the plants with tyres
FROM_FRAME_S = 0.08  # largest age of a frame when its command is sent
BASELINES = (LawName.PURE_PURSUIT, LawName.STANLEY)

Episodes = Callable[[int], Iterator[Episode]]


@dataclass(frozen=True)
class Figure:
    """Episodes, the error that counts [m], and its target."""

    episodes: Episodes
    target_m: float
    error_m: Callable[[Track], float] = lambda track: track.worst_m


def bench_lateral(seed: int) -> dict[str, Any]:
    """Largest distance from the centre of the lane [m] by figure and law; 5 m and more is a lost lane."""
    return {name: _row(figure, seed) for name, figure in FIGURES.items()}


def contestants() -> dict[str, ControllerSettings]:
    """The controller with each of its laws."""
    settings = load(CONFIG_DIR / "controller.yaml", ControllerSettings)
    return {
        law.value: settings.model_copy(update=dict(lateral=settings.lateral.model_copy(update=dict(law=law))))
        for law in LawName
    }


def _row(figure: Figure, seed: int) -> dict[str, float]:
    """The worst of every law over the episodes; the laws take turns."""
    worst: dict[str, float] = {"target": figure.target_m}
    for episode in figure.episodes(seed):
        for name, error_m in _errors(figure, episode):
            worst[name] = max(worst.get(name, 0.0), round(error_m, 4))
    return worst


def _errors(figure: Figure, episode: Episode) -> Iterator[tuple[str, float]]:
    for name, settings in contestants().items():
        yield name, figure.error_m(drive(episode, settings))
        if name in BASELINES:
            blind = replace(episode, nominal=_neutral(episode.nominal), plant=_real(episode))
            unlearning = settings.learning.model_copy(update=dict(enabled=False))
            fixed = settings.model_copy(update=dict(learning=unlearning))
            yield f"{name}, no understeer", figure.error_m(drive(blind, fixed))


def _neutral(vehicle: Vehicle) -> Vehicle:
    return vehicle.model_copy(update=dict(understeer_gradient_rad_per_mps2=0.0))


def _real(episode: Episode) -> PlantSettings:
    """The plant of ``episode`` for a controller with another understeer."""
    understeer = episode.nominal.understeer_gradient_rad_per_mps2
    differs = {"understeer_gradient_rad_per_mps2": understeer} | episode.plant.vehicle
    return episode.plant.model_copy(update=dict(vehicle=differs))


def vehicle(*, understeer_deg_per_g: float = 2.0, delay_s: float = 0.1, lag_s: float = 0.1) -> Vehicle:
    """The default vehicle with another understeer and another steering."""
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle).model_copy(
        update=dict(
            understeer_gradient_rad_per_mps2=math.radians(understeer_deg_per_g) / GRAVITY_MPS2,
            steering_delay_s=delay_s,
            steering_lag_s=lag_s,
        )
    )


def tyred(vehicle: Vehicle) -> Vehicle:
    """``vehicle`` with the rear tyre stiffness of the plants with tyres."""
    return vehicle.model_copy(update=dict(rear_slip_gradient_rad_per_mps2=REAR_SLIP))


@cache
def _s(speed_mps: float) -> Road:
    return s_clothoid(speed_mps)


@cache
def _straight() -> Road:
    return road_of([(1000.0, 0.0)])


def s_curve(speed_mps: float, nominal: Vehicle, *, sight_s: float | None = None, **real: Any) -> Episode:
    """The S on a car that differs from ``nominal`` by the plant fields ``real``."""
    return Episode(
        road=_s(speed_mps),
        speed_mps=speed_mps,
        duration_s=S_DURATION_S,
        nominal=nominal,
        plant=PlantSettings.model_validate(real),
        sight_s=sight_s,
    )


def s_curves(model: Model) -> Iterator[Episode]:
    """Over understeer and speed, on a car that equals its vehicle file, without preview of bends."""
    for understeer, speed_mps in product(UNDERSTEER_DEG_PER_G, SPEEDS_MPS):
        nominal = vehicle(understeer_deg_per_g=understeer)
        yield s_curve(speed_mps, nominal if model is Model.KINEMATIC else tyred(nominal), model=model)


def timings(wrong: tuple[float, ...]) -> Iterator[Episode]:
    """Over dead time and lag, whose true values are ``wrong`` times as long."""
    for delay_s, lag_s, factor in product(DELAYS_S, LAGS_S, wrong):
        real = dict(steering_delay_s=factor * delay_s, steering_lag_s=factor * lag_s)
        sight_s = FROM_FRAME_S + max(1.0, factor) * (delay_s + lag_s)
        yield s_curve(GRID_MPS, vehicle(delay_s=delay_s, lag_s=lag_s), sight_s=sight_s, vehicle=real)


def pushed(model: Model = Model.KINEMATIC, **real: Any) -> Iterator[Episode]:
    """Straight on at every speed, with the disturbance present from the start."""
    nominal = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for speed_mps in SPEEDS_MPS:
        yield Episode(
            road=_straight(),
            speed_mps=speed_mps,
            duration_s=2 * SETTLED_S,
            nominal=nominal if model is Model.KINEMATIC else tyred(nominal),
            plant=PlantSettings(model=model, **real),
        )


def random_cases(seed: int, cases: int = RANDOM_CASES) -> Iterator[Episode]:
    """The S at any speed on a car that differs in all parameters, with 3 cm of noise in the offset."""
    lots = np.random.default_rng(seed)
    nominal = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for _ in range(cases):
        speed_mps = float(lots.uniform(10.0, 30.0))
        understeer, delay, lag = lots.uniform(0.7, 1.3, 3)
        real = dict(
            understeer_gradient_rad_per_mps2=understeer * nominal.understeer_gradient_rad_per_mps2,
            steering_delay_s=delay * nominal.steering_delay_s,
            steering_lag_s=lag * nominal.steering_lag_s,
        )
        episode = s_curve(
            speed_mps,
            nominal,
            sight_s=FROM_FRAME_S + 1.3 * (nominal.steering_delay_s + nominal.steering_lag_s),
            vehicle=real,
            load_kg=float(lots.uniform(0.0, 200.0)),
            bank_rad=float(lots.uniform(-BANK_RAD, BANK_RAD)),
            steering_offset_rad=float(lots.uniform(-1.0, 1.0)) * math.radians(0.2),
        )
        yield replace(episode, offset_noise_m=NOISE_M, seed=int(lots.integers(2**32)))


def settled_m(track: Track) -> float:
    """The largest offset from ``SETTLED_S`` on; the last offset where the lane was lost before."""
    late_m = track.offset_m[round(SETTLED_S / TICK_S) :]
    return float(np.abs(late_m).max(initial=abs(track.offset_m[-1])))


def _any_seed(episodes: Callable[[], Iterator[Episode]]) -> Episodes:
    return lambda _seed: episodes()


FIGURES = {
    "S, known car": Figure(_any_seed(lambda: s_curves(Model.KINEMATIC)), 0.010),
    "S, known car with tyres": Figure(_any_seed(lambda: s_curves(Model.SINGLE_TRACK)), 0.010),
    "S, delay x lag known": Figure(_any_seed(lambda: timings((1.0,))), 0.04),
    "S, delay x lag 30 % wrong": Figure(_any_seed(lambda: timings(WRONG)), 0.08),
    "bank 6 %": Figure(_any_seed(lambda: pushed(bank_rad=BANK_RAD)), 0.08),
    "bank 6 %, tyres": Figure(_any_seed(lambda: pushed(Model.SINGLE_TRACK, bank_rad=BANK_RAD)), 0.08),
    "steering offset 0.5 deg": Figure(_any_seed(lambda: pushed(steering_offset_rad=OFFSET_RAD)), 0.12),
    "steering offset 0.5 deg, after 5 s": Figure(
        _any_seed(lambda: pushed(steering_offset_rad=OFFSET_RAD)), 0.02, settled_m
    ),
    "S, all wrong at random": Figure(random_cases, RANDOM_TARGET_M),
}
