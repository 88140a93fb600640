"""Agreement of the plants on the order of the laws: Kendall's rank correlation between every two vehicles.

Laws are ranked by the root mean square of the offset on the S at 2 m/s², at 10 and 20 m/s. An order that is equal
on all plants is a property of the laws; another one may be a property of the plant.
"""

from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from controller.controller import ControllerSettings
from sim_harness.bench.control.drift import known_vehicle
from sim_harness.bench.control.episode import S_DURATION_S, Episode, drive, s_clothoid
from sim_harness.bench.control.lateral import contestants
from sim_harness.world.plants.settings import Model, PlantSettings

SPEEDS_MPS = (10.0, 20.0)
VEHICLES = {
    "kinematic": PlantSettings(),
    "kinematic, bank 6 %": PlantSettings(bank_rad=0.06),
    "single track": PlantSettings(model=Model.SINGLE_TRACK),
    "single track, 300 kg more": PlantSettings(model=Model.SINGLE_TRACK, load_kg=300.0),
    "single track, play 0.5°": PlantSettings(model=Model.SINGLE_TRACK, steering_friction_rad=0.0044),
    "CommonRoad drift": PlantSettings(model=Model.COMMONROAD_DRIFT),
}


def bench_ranking(seed: int) -> dict[str, Any]:
    """Root mean square of the offset [m] by vehicle and law, and Kendall's τ between the orders."""
    laws = contestants()
    table = {
        name: {law: _rms_m(plant, settings, seed) for law, settings in laws.items()}
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
    """Rms over both speeds; a lost lane counts up to the loss."""
    offsets_m = [
        drive(
            Episode(
                road=s_clothoid(speed_mps),
                speed_mps=speed_mps,
                duration_s=S_DURATION_S,
                nominal=known_vehicle(plant.model),
                plant=plant,
                seed=seed,
            ),
            settings,
        ).offset_m
        for speed_mps in SPEEDS_MPS
    ]
    return float(np.sqrt(np.mean(np.concatenate(offsets_m) ** 2)))
