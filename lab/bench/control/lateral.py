"""Tracking error of the lateral laws, pure pursuit and Stanley on the same episodes and seeds.

The lane is measured as far ahead as the car drives until a command takes effect, because preview of bends is a
property of perception; only the first figure requires it. Baselines without understeer assume a neutral car.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from controller.laws.lateral import LawName
from lab.bench.control.contestants import contestants, nominal, shipped_settings, unlearning, with_tyres
from lab.bench.control.episode import SETTLED_S, Episode, drive, road_of, s_curve
from sim_harness.sweep.progress import SweepProgress
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import GRADIENT, Vehicle

SPEEDS_MPS = (10.0, 20.0, 30.0)
UNDERSTEER_DEG_PER_G = (0.0, 0.94, 2.45, 5.0)
DELAYS_S, LAGS_S = (0.0, 0.1, 0.2, 0.3), (0.05, 0.1, 0.2, 0.3)
WRONG = (0.7, 1.3)
GRID_MPS = 20.0
BANK_RAD, OFFSET_RAD = math.atan(0.06), math.radians(0.5)
RANDOM_CASES, MANY_CASES = 40, 1000  # for each law; for the configured law alone
NOISE_M, RANDOM_TARGET_M = 0.03, 0.08
FROM_FRAME_S = 0.08  # largest age of a frame when its command is sent
BASELINES = (LawName.PURE_PURSUIT, LawName.STANLEY)


class Figure(NamedTuple):
    """Episodes, and the target of the largest distance from the centre of the lane [m] in them."""

    episodes: Iterable[Episode]
    target_m: float
    settled: bool = False  # only the distance after ``SETTLED_S`` counts


def bench_lateral(seed: int) -> dict[str, Any]:
    """Largest distance from the centre of the lane [m] by figure and law; 5 m and more is a lost lane."""
    figures = {
        "S, known car": Figure(s_curves(Model.KINEMATIC), 0.010),
        "S, known car with tyres": Figure(s_curves(Model.SINGLE_TRACK), 0.010),
        "S, delay x lag known": Figure(timings((1.0,)), 0.04),
        "S, delay x lag 30 % wrong": Figure(timings(WRONG), 0.08),
        "bank 6 %": Figure(push_episodes(bank_rad=BANK_RAD), 0.08),
        "bank 6 %, tyres": Figure(push_episodes(Model.SINGLE_TRACK, bank_rad=BANK_RAD), 0.08),
        "steering offset 0.5 deg": Figure(push_episodes(steering_offset_rad=OFFSET_RAD), 0.12),
        "steering offset 0.5 deg, after 5 s": Figure(
            push_episodes(steering_offset_rad=OFFSET_RAD), 0.02, settled=True
        ),
        "S, all wrong at random": Figure(random_cases(seed), RANDOM_TARGET_M),
    }
    return {name: _row(figure) for name, figure in figures.items()}


def bench_random(seed: int, cases: int = MANY_CASES) -> dict[str, Any]:
    """Largest distances from the centre of the lane [m] over cars that differ from their vehicle file."""
    settings, worst_m = shipped_settings(), []
    with SweepProgress(cases, cases) as progress:
        for episode in random_cases(seed, cases):
            worst_m.append(drive(episode, settings).worst_m)
            progress.step(1.0)
    return {
        "law": settings.lateral.law.value,
        "cases": cases,
        "target [m]": RANDOM_TARGET_M,
        "largest [m]": round(max(worst_m), 4),
        "99th percentile [m]": round(float(np.percentile(worst_m, 99)), 4),
        "median [m]": round(float(np.median(worst_m)), 4),
        "beyond the target": sum(error_m > RANDOM_TARGET_M for error_m in worst_m),
    }


def _row(figure: Figure) -> dict[str, float]:
    """The worst of every law over the episodes; the laws take turns."""
    worst: dict[str, float] = {"target": figure.target_m}
    for episode in figure.episodes:
        for law, settings in contestants().items():
            runs = {law: (episode, settings)}
            if law in BASELINES:
                runs[f"{law}, no understeer"] = _neutral(episode), unlearning(settings)
            for name, run in runs.items():
                track = drive(*run)
                error_m = track.settled_offset_m if figure.settled else track.worst_m
                worst[name] = max(worst.get(name, 0.0), round(error_m, 4))
    return worst


def _neutral(episode: Episode) -> Episode:
    """``episode`` on the same plant, for a controller that assumes no understeer."""
    differs = {GRADIENT: episode.nominal.understeer_gradient_rad_per_mps2} | episode.plant.vehicle
    return replace(
        episode,
        nominal=episode.nominal.model_copy(update={GRADIENT: 0.0}),
        plant=episode.plant.model_copy(update=dict(vehicle=differs)),
    )


def vehicle(*, understeer_deg_per_g: float = 2.0, delay_s: float = 0.1, lag_s: float = 0.1) -> Vehicle:
    """The default vehicle with another understeer and another steering."""
    gradient = math.radians(understeer_deg_per_g) / GRAVITY_MPS2
    changes = {GRADIENT: gradient, "steering_delay_s": delay_s, "steering_lag_s": lag_s}
    return nominal().model_copy(update=changes)


def s_curves(model: Model) -> Iterator[Episode]:
    """Over understeer and speed, on a car that equals its vehicle file, without preview of bends."""
    for understeer, speed_mps in product(UNDERSTEER_DEG_PER_G, SPEEDS_MPS):
        known = with_tyres(vehicle(understeer_deg_per_g=understeer), model)
        yield s_curve(speed_mps, known, PlantSettings(model=model))


def timings(wrong: tuple[float, ...]) -> Iterator[Episode]:
    """Over dead time and lag, whose true values are ``wrong`` times as long."""
    for delay_s, lag_s, factor in product(DELAYS_S, LAGS_S, wrong):
        real = dict(steering_delay_s=factor * delay_s, steering_lag_s=factor * lag_s)
        sight_s = FROM_FRAME_S + max(1.0, factor) * (delay_s + lag_s)
        known = vehicle(delay_s=delay_s, lag_s=lag_s)
        yield s_curve(GRID_MPS, known, PlantSettings(vehicle=real), sight_s=sight_s)


def push_episodes(
    model: Model = Model.KINEMATIC, speeds_mps: Iterable[float] = SPEEDS_MPS, **real: Any
) -> Iterator[Episode]:
    """Straight on at every speed, with the disturbance present from the start."""
    for speed_mps in speeds_mps:
        yield Episode(
            road=road_of([(1000.0, 0.0)]),
            speed_mps=speed_mps,
            duration_s=2 * SETTLED_S,
            nominal=with_tyres(nominal(), model),
            plant=PlantSettings(model=model, **real),
        )


def random_cases(seed: int, cases: int = RANDOM_CASES) -> Iterator[Episode]:
    """The S at any speed on a car that differs in all parameters, with 3 cm of noise in the offset."""
    lots = np.random.default_rng(seed)
    known = nominal()
    sight_s = FROM_FRAME_S + 1.3 * (known.steering_delay_s + known.steering_lag_s)
    for _ in range(cases):
        speed_mps = float(lots.uniform(10.0, 30.0))
        understeer, delay, lag = lots.uniform(0.7, 1.3, 3)
        plant = PlantSettings(
            vehicle={
                GRADIENT: float(understeer * known.understeer_gradient_rad_per_mps2),
                "steering_delay_s": float(delay * known.steering_delay_s),
                "steering_lag_s": float(lag * known.steering_lag_s),
            },
            load_kg=float(lots.uniform(0.0, 200.0)),
            bank_rad=float(lots.uniform(-BANK_RAD, BANK_RAD)),
            steering_offset_rad=float(lots.uniform(-1.0, 1.0)) * math.radians(0.2),
        )
        noise_seed = int(lots.integers(2**32))
        yield s_curve(speed_mps, known, plant, sight_s=sight_s, offset_noise_m=NOISE_M, seed=noise_seed)
