"""The lateral laws beside pure pursuit and Stanley, on the same fresh seeds: issue 6's figures."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from controller.controller import ControllerSettings
from controller.lateral import LawName
from sim_harness.control_bench.episode import S_DURATION_S, Episode, drive, s_clothoid
from sim_harness.plants.axles import GRAVITY_MPS2
from sim_harness.plants.settings import Model, PlantSettings
from trepid.config import CONFIG_DIR, load
from trepid.vehicle import Vehicle

SPEEDS_MPS = (10.0, 20.0, 30.0)
UNDERSTEER_DEG_PER_G = (0.0, 0.94, 2.45, 5.0)

Row = dict[str, float | str]


def bench_lateral(seed: int) -> dict[str, Any]:
    """Largest distance from the centre of the lane [m] by figure and law."""
    return {name: _row(figure, seed) for name, figure in FIGURES.items()}


def contestants() -> dict[str, ControllerSettings]:
    """The controller with each of its laws."""
    settings = load(CONFIG_DIR / "controller.yaml", ControllerSettings)
    return {
        law.value: settings.model_copy(update=dict(lateral=settings.lateral.model_copy(update=dict(law=law))))
        for law in LawName
    }


def _row(figure: Callable[[int], Iterator[Episode]], seed: int) -> Row:
    """The worst of every law over the episodes; the laws take turns."""
    laws, worst = contestants(), dict[str, float]()
    for episode in figure(seed):
        for name, settings in laws.items():
            worst[name] = max(worst.get(name, 0.0), drive(episode, settings).worst_m)
    return {name: round(value, 4) for name, value in worst.items()}


def vehicle(*, understeer_deg_per_g: float, delay_s: float = 0.1, lag_s: float = 0.1) -> Vehicle:
    """The default vehicle with another understeer and another steering."""
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle).model_copy(
        update=dict(
            understeer_gradient_rad_per_mps2=math.radians(understeer_deg_per_g) / GRAVITY_MPS2,
            steering_delay_s=delay_s,
            steering_lag_s=lag_s,
        )
    )


def s_curves(model: Model) -> Iterator[Episode]:
    """The S at 2 m/s² over understeer and speed, on a car that is what it is believed to be."""
    for understeer in UNDERSTEER_DEG_PER_G:
        for speed_mps in SPEEDS_MPS:
            yield Episode(
                road=s_clothoid(speed_mps),
                speed_mps=speed_mps,
                duration_s=S_DURATION_S,
                believed=vehicle(understeer_deg_per_g=understeer),
                plant=PlantSettings(model=model),
            )


FIGURES: dict[str, Callable[[int], Iterator[Episode]]] = {
    "S, known car": lambda _: s_curves(Model.KINEMATIC),
}
