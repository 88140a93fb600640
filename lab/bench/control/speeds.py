"""Tracking of the laws over speeds and over vehicles."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from controller.controller import ControllerSettings
from lab.bench.control.contestants import contestants, nominal, with_tyres
from lab.bench.control.episode import Episode, drive, s_clothoid, s_curve
from sim_harness.world.plants.settings import Model, PlantSettings

MPH = 0.44704
SPEEDS_MPS = (5 * MPH, 10 * MPH, 15 * MPH, 20 * MPH, 15.0, 20.0, 25.0, 30.0)
LATERAL_MPS2, JERK_MPS3 = 2.0, 1.0
TIGHTEST_M, SHORTEST_ENTRY_M = 15.0, 10.0
ARCS_S = 2 * 2.0 + 2.0  # both arcs, and the straights before and after

RANKING_SPEEDS_MPS = (10.0, 20.0)
VEHICLES = {
    "kinematic": PlantSettings(),
    "kinematic, bank 6 %": PlantSettings(bank_rad=0.06),
    "single track": PlantSettings(model=Model.SINGLE_TRACK),
    "single track, 300 kg more": PlantSettings(model=Model.SINGLE_TRACK, load_kg=300.0),
    "single track, play 0.5°": PlantSettings(model=Model.SINGLE_TRACK, steering_friction_rad=0.0044),
    "CommonRoad drift": PlantSettings(model=Model.COMMONROAD_DRIFT),
}


def bench_speeds(seed: int) -> dict[str, Any]:
    """One tuning: largest distance from the lane's centre [m] by law and plant, over the speeds [m/s]."""
    rows: dict[str, dict[str, float]] = {}
    for model, episode in episodes(seed):
        for law, settings in contestants().items():
            row = rows.setdefault(f"{law}, {model.value}", {})
            row[f"{episode.speed_mps:.1f}"] = round(drive(episode, settings).worst_m, 4)
    return rows


def episodes(seed: int) -> Iterator[tuple[Model, Episode]]:
    """The S at 2 m/s², or at R = 15 m if the acceleration is lower there, on cars that equal their vehicle file."""
    for model, speed_mps in product((Model.KINEMATIC, Model.SINGLE_TRACK), SPEEDS_MPS):
        lateral_mps2 = min(LATERAL_MPS2, speed_mps**2 / TIGHTEST_M)
        jerk_mps3 = min(JERK_MPS3, speed_mps * lateral_mps2 / SHORTEST_ENTRY_M)
        episode = s_curve(speed_mps, with_tyres(nominal(), model), PlantSettings(model=model), seed=seed)
        yield (
            model,
            replace(
                episode,
                road=s_clothoid(speed_mps, lateral_mps2=lateral_mps2, jerk_mps3=jerk_mps3),
                duration_s=ARCS_S - 1.0 + 4.0 * lateral_mps2 / jerk_mps3,
            ),
        )


def bench_ranking(seed: int) -> dict[str, Any]:
    """Root mean square of the offset [m] by vehicle and law, and Kendall's τ between the orders.

    An order of the laws that is equal on all plants is a property of the laws; another one may be a property of the
    plant.
    """
    table = {
        name: {law: _rms_m(plant, settings, seed) for law, settings in contestants().items()}
        for name, plant in VEHICLES.items()
    }
    taus = {
        (one, other): kendalltau(list(table[one].values()), list(table[other].values())).statistic
        for one, other in combinations(VEHICLES, 2)
    }
    least = min(taus, key=lambda pair: taus[pair])
    return {
        **{name: {law: round(value, 4) for law, value in row.items()} for name, row in table.items()},
        "Kendall's τ": {
            "mean": round(float(np.mean(list(taus.values()))), 3),
            "least": f"{taus[least]:.2f} between {least[0]} and {least[1]}",
        },
    }


def _rms_m(plant: PlantSettings, settings: ControllerSettings, seed: int) -> float:
    """Rms on the S over both speeds; a lost lane counts up to the loss."""
    known = with_tyres(nominal(), Model(plant.model))
    tracks = [drive(s_curve(speed, known, plant, seed=seed), settings) for speed in RANKING_SPEEDS_MPS]
    return float(np.sqrt(np.mean(np.concatenate([track.offset_m for track in tracks]) ** 2)))
