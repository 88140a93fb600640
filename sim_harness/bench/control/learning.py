"""Learned steering offset and understeer: tracking error with and without them, and their errors.

Tracking: a steering offset of 0.5° from the start on, on a straight. Parameters: laps of the circuit by random
cars; the estimate at the end is compared with the result of identification from the log of the same drive.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from controller.controller import Controller, ControllerSettings
from controller.identify.drive_log import DriveLog
from controller.identify.identification import identify_understeer
from controller.learner.steering_learner import SteeringLearner
from sim_harness.bench.control.drift import known_vehicle
from sim_harness.bench.control.episode import Episode, drive, road_of
from sim_harness.bench.control.lateral import contestants
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import ClosedLoop, build_parts
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.config import CONFIG_DIR, load
from trepid.vehicle import GRADIENT, Vehicle

OFFSET_RAD = math.radians(0.5)
SPEEDS_MPS = (10.0, 20.0, 25.0)
STRAIGHT_S, SETTLED_S = 10.0, 5.0
CARS = 6
LAP_S = 200.0


def bench_learning(seed: int) -> dict[str, Any]:
    """Peak error and error after 5 s [m] with an offset of 0.5°; errors of the learned values."""
    return {**_offsets(seed), **_laps(seed)}


def _offsets(seed: int) -> dict[str, Any]:
    rows: dict[str, dict[str, str]] = {}
    for model in (Model.KINEMATIC, Model.SINGLE_TRACK):
        for law, settings in contestants().items():
            for learns, ours in (("learning", settings), ("not learning", _unlearned(settings))):
                row = rows.setdefault(f"offset, {law}, {model.value}, {learns}", {})
                for speed_mps in SPEEDS_MPS:
                    track = drive(_straight(model, speed_mps, seed), ours)
                    late_m = float(np.abs(track.offset_m[track.t_s >= SETTLED_S]).max(initial=0.0))
                    row[f"{speed_mps:g} m/s"] = f"{track.worst_m:.3f}, after 5 s {late_m:.3f}"
    return rows


def _unlearned(settings: ControllerSettings) -> ControllerSettings:
    return settings.model_copy(update=dict(learning=settings.learning.model_copy(update=dict(enabled=False))))


def _straight(model: Model, speed_mps: float, seed: int) -> Episode:
    return Episode(
        road=road_of([((STRAIGHT_S + 1.0) * speed_mps, 0.0)]),
        speed_mps=speed_mps,
        duration_s=STRAIGHT_S,
        nominal=known_vehicle(model),
        plant=PlantSettings(model=model, steering_offset_rad=OFFSET_RAD),
        seed=seed,
    )


def _laps(seed: int) -> dict[str, Any]:
    """Random cars on the circuit; errors relative to the truth for K [%], absolute for the offset [mrad]."""
    rows: dict[str, str] = {}
    nominal = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    settings = load(CONFIG_DIR / "controller.yaml", ControllerSettings)
    for number, plant in enumerate(random_cars(nominal, seed)):
        trace, learner = lap(nominal, settings, plant, seed + number)
        found = identify_understeer(_log(trace), nominal)
        gradient, offset = plant.vehicle[GRADIENT], plant.steering_offset_rad
        rows[f"lap of {plant.model.value}, K {gradient:.5f}, offset {offset:+.4f}"] = (
            f"learned {_errors(learner.understeer, learner.offset_rad, gradient, offset)}; identified "
            + (
                found.refused
                or _errors(
                    found.parameters[GRADIENT].value,
                    found.parameters["steering_offset_rad"].value,
                    gradient,
                    offset,
                )
            )
        )
    return rows


def _errors(gradient: float, offset_rad: float, true_gradient: float, true_offset_rad: float) -> str:
    percent = 100.0 * (gradient / true_gradient - 1.0)
    return f"K {percent:+.1f} %, offset {1e3 * (offset_rad - true_offset_rad):+.2f} mrad"


def random_cars(nominal: Vehicle, seed: int) -> Iterator[PlantSettings]:
    """Understeer within ±30 %, offset within ±0.5°, on both plants in turn."""
    draw = np.random.default_rng(seed)
    for number in range(CARS):
        share, offset_rad = draw.uniform(0.7, 1.3), draw.uniform(-OFFSET_RAD, OFFSET_RAD)
        yield PlantSettings(
            model=(Model.KINEMATIC, Model.SINGLE_TRACK)[number % 2],
            steering_offset_rad=float(offset_rad),
            vehicle={GRADIENT: float(share * nominal.understeer_gradient_rad_per_mps2)},
        )


def lap(
    nominal: Vehicle, settings: ControllerSettings, plant: PlantSettings, seed: int
) -> tuple[Trace, SteeringLearner]:
    """A lap of the circuit on ``plant`` with the vehicle file ``nominal``; returns the learned values."""
    scenario = load_scenario("circuit", {"sight": "truth"}).model_copy(update=dict(plant=plant))
    controller = Controller(nominal, settings)
    parts = replace(build_parts(scenario, seed=seed), controller=controller)
    return ClosedLoop(scenario.shortened(LAP_S), parts, load_simulator()).drive(), controller.learner


def _log(trace: Trace) -> DriveLog:
    """The measured columns in the form that identification reads."""
    nothing = np.empty(0)
    return DriveLog(
        t_s=trace["t_s"],
        speed_mps=trace["speed_mps"],
        angle_rad=trace["road_wheel_angle_rad"],
        yaw_rate_radps=trace["yaw_rate_radps"],
        driver_override=np.zeros(len(trace)),
        at_steering_wheel=False,
        command_t_s=nothing,
        command_rad=nothing,
    )
