"""Learned steering offset and understeer: tracking error with and without them, and their errors.

Tracking: a steering offset of 0.5° from the start on, on a straight. Parameters: laps of the circuit by random
cars; the estimate at the end is compared with the result of identification from the log of the same drive.
"""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cockpit.calibration.drive_log import DriveLog, log_of
from cockpit.calibration.identification import identify_understeer
from controller.controller import Controller, ControllerSettings
from controller.steering_learner import SteeringLearner
from lab.bench.control.contestants import contestants, drive_scenario, nominal, shipped_settings, unlearning
from lab.bench.control.episode import drive
from lab.bench.control.lateral import OFFSET_RAD, push_episodes
from sim_harness.judging.trace import Trace
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import GRADIENT, Vehicle

SPEEDS_MPS = (10.0, 20.0, 25.0)
MODELS = (Model.KINEMATIC, Model.SINGLE_TRACK)
CARS = 6
LAP_S = 200.0


def bench_learning(seed: int) -> dict[str, Any]:
    """Peak error and error after 5 s [m] with an offset of 0.5°; errors of the learned values."""
    return {**_offsets(), **_laps(seed)}


def _offsets() -> dict[str, Any]:
    rows: dict[str, dict[str, str]] = {}
    for model, (law, settings) in product(MODELS, contestants().items()):
        for learns, ours in (("learning", settings), ("not learning", unlearning(settings))):
            row = rows[f"offset, {law}, {model.value}, {learns}"] = {}
            for episode in push_episodes(model, SPEEDS_MPS, steering_offset_rad=OFFSET_RAD):
                track = drive(episode, ours)
                row[f"{episode.speed_mps:g} m/s"] = (
                    f"{track.worst_m:.3f}, after 5 s {track.settled_offset_m:.3f}"
                )
    return rows


def _laps(seed: int) -> dict[str, Any]:
    """Random cars on the circuit; errors relative to the truth for K [%], absolute for the offset [mrad]."""
    rows: dict[str, str] = {}
    known, settings = nominal(), shipped_settings()
    for number, plant in enumerate(random_cars(known, seed)):
        trace, learner = lap(known, settings, plant, seed + number)
        gradient, offset_rad = plant.vehicle[GRADIENT], plant.steering_offset_rad
        learned = _errors(plant, learner.understeer, learner.offset_rad)
        found = identify_understeer(_log(trace), known)
        values = {name: parameter.value for name, parameter in found.parameters.items()}
        identified = found.refused or _errors(plant, values[GRADIENT], values["steering_offset_rad"])
        name = f"lap of {plant.model}, K {gradient:.5f}, offset {offset_rad:+.4f}"
        rows[name] = f"learned {learned}; identified {identified}"
    return rows


def _errors(plant: PlantSettings, gradient: float, offset_rad: float) -> str:
    percent = 100.0 * (gradient / plant.vehicle[GRADIENT] - 1.0)
    return f"K {percent:+.1f} %, offset {1e3 * (offset_rad - plant.steering_offset_rad):+.2f} mrad"


def random_cars(known: Vehicle, seed: int) -> Iterator[PlantSettings]:
    """Understeer within ±30 %, offset within ±0.5°, on both plants in turn."""
    draw = np.random.default_rng(seed)
    for number in range(CARS):
        share, offset_rad = draw.uniform(0.7, 1.3), draw.uniform(-OFFSET_RAD, OFFSET_RAD)
        yield PlantSettings(
            model=MODELS[number % 2],
            steering_offset_rad=float(offset_rad),
            vehicle={GRADIENT: float(share * known.understeer_gradient_rad_per_mps2)},
        )


def lap(
    known: Vehicle, settings: ControllerSettings, plant: PlantSettings, seed: int
) -> tuple[Trace, SteeringLearner]:
    """A lap of the circuit on ``plant`` with the vehicle file ``known``; returns the learned values."""
    scenario = load_scenario("circuit", {"sight": "truth"}).model_copy(update=dict(plant=plant))
    controller = Controller(known, settings)
    return drive_scenario(scenario.shorten(LAP_S), controller, seed=seed), controller.learner


def _log(trace: Trace) -> DriveLog:
    """The measured columns in the form that identification reads."""
    names = ("t_s", "speed_mps", "road_wheel_angle_rad", "yaw_rate_radps")
    by_hand, no_commands = np.zeros(len(trace)), (np.empty(0), np.empty(0))
    return log_of(Path("circuit"), [*(trace[name] for name in names), by_hand], no_commands)
