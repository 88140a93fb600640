"""Steps per second of the plants, of CommonRoad's models and of highway-env's lane keeping in the same run.

All run in turn, so that other work on the machine affects them equally. CommonRoad's models are stepped by Trepid's
Runge-Kutta method without any other code; highway-env runs the step of its lane-keeping task.
"""

import importlib.metadata
import math
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from sim_harness.world.plants.batch import BatchPlant
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command

STEP_S = 0.01
SPEED_MPS = 8.0
TURN_S = 0.1  # duration of a turn
TURNS = 7
BATCH = 4000
PEER = "commonroad_st_bare"

Advance = Callable[[int], object]


def bench_plants() -> dict[str, Any]:
    """Steps per second of one core of every plant and peer, median of the turns, and the ratio to CommonRoad's ST.

    A step of the batch counts once for each of its vehicles. Peers that are not installed are missing.
    """
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    contestants: dict[str, tuple[Advance, int]] = {
        "kinematic": (_plant(Model.KINEMATIC, vehicle), 1),
        "single_track": (_plant(Model.SINGLE_TRACK, vehicle), 1),
        f"kinematic_batch_of_{BATCH}": (_batch(vehicle), BATCH),
    }
    contestants |= {name: (advance, 1) for name, advance in peers(vehicle).items()}
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(TURNS):
        for name, (advance, vehicles) in contestants.items():
            rates[name].append(vehicles * steps_per_s(advance))
    medians = {name: float(np.median(values)) for name, values in rates.items()}
    rows: dict[str, Any] = {name: _row(rate, medians.get(PEER)) for name, rate in medians.items()}
    return rows | {"peers": _versions()}


def peers(vehicle: Vehicle) -> dict[str, Advance]:
    """The peers that are installed."""
    found: dict[str, Advance] = {}
    with _optional():
        found |= _commonroad(vehicle)
    with _optional():
        found["highway_env_lane_keeping"] = _lane_keeping()
    return found


def _row(rate: float, peer: float | None) -> dict[str, float]:
    row = {"steps_per_s": round(rate)}
    return row | ({f"ratio_to_{PEER}": round(rate / peer, 2)} if peer else {})


def _versions() -> dict[str, str]:
    """Versions of the peers that are installed."""
    installed = {}
    for name in ("commonroad-vehicle-models", "highway-env"):
        with suppress(importlib.metadata.PackageNotFoundError):
            installed[name] = importlib.metadata.version(name)
    return installed


@contextmanager
def _optional() -> Iterator[None]:
    """Leave out a peer that is not installed."""
    try:
        yield
    except ImportError as error:
        warnings.warn(f"left out: {error}; pip install 'trepid[bench]'", stacklevel=3)


def steps_per_s(advance: Advance) -> float:
    """Calls of ``advance`` per second of this process's computing time, over one turn."""
    steps, started_s = 0, time.process_time()
    while (passed_s := time.process_time() - started_s) < TURN_S:
        advance(steps)
        steps += 1
    return steps / passed_s


def _angle_rad(step: int) -> float:
    return 0.05 * math.sin(0.01 * step)


def _plant(model: Model, vehicle: Vehicle) -> Advance:
    """A plant under a command that changes every other step, as the controller's does."""
    plant = build_plant(PlantSettings(model=model), vehicle)
    commands = [
        Command(
            t_s=None,
            road_wheel_angle_rad=_angle_rad(step),
            speed_mps=SPEED_MPS,
            accel_mps2=0.0,
        )
        for step in range(600)
    ]
    state = plant.initial(speed_mps=SPEED_MPS)

    def advance(step: int) -> None:
        nonlocal state
        state = plant.step(state, commands[step // 2 % len(commands)], STEP_S)

    return advance


def _batch(vehicle: Vehicle) -> Advance:
    """Vehicles of different wheelbase and understeer, under different commands that change every other step."""
    spread = np.linspace(0.5, 1.5, BATCH)
    different = [
        vehicle.model_copy(
            update=dict(
                wheelbase_m=vehicle.wheelbase_m * share,
                understeer_gradient_rad_per_mps2=vehicle.understeer_gradient_rad_per_mps2 * share,
            )
        )
        for share in spread.tolist()
    ]
    batch = BatchPlant([KinematicPlant(one) for one in different], period_s=STEP_S)
    state = batch.initial(np.full(BATCH, SPEED_MPS))
    coast = np.zeros(BATCH)

    def advance(step: int) -> None:
        batch.step(state, _angle_rad(step // 2) * spread, coast)

    return advance


def _commonroad(vehicle: Vehicle) -> dict[str, Advance]:
    """CommonRoad's single-track models, and its multi-body one, under a steering rate. Raises ImportError."""
    from vehiclemodels.init_mb import init_mb
    from vehiclemodels.init_st import init_st
    from vehiclemodels.init_std import init_std
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
    from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st
    from vehiclemodels.vehicle_dynamics_std import vehicle_dynamics_std

    parameters = parameters_vehicle2()
    core = [0.0, 0.0, 0.0, SPEED_MPS, 0.0, 0.0, 0.0]
    models = {
        PEER: (init_st(core), vehicle_dynamics_st),
        "commonroad_std_bare": (init_std(core, parameters), vehicle_dynamics_std),
        "commonroad_mb_bare": (init_mb(core, parameters), vehicle_dynamics_mb),
    }

    def stepper(start: list[float], dynamics: Callable[..., list[float]]) -> Advance:
        def rates(vector: tuple[float, ...], inputs: tuple[float, float]) -> list[float]:
            return dynamics(list(vector), list(inputs), parameters)

        def advance(step: int) -> None:
            # From the same state each time: at 10 ms the wheels of STD and MB would become unstable.
            inputs = (0.05 * math.cos(0.01 * step), 0.0)
            rk4(rates, tuple(start), inputs, inputs, inputs, STEP_S)

        return advance

    return {name: stepper(start, dynamics) for name, (start, dynamics) in models.items()}


def _lane_keeping() -> Advance:
    """The lane-keeping task of highway-env; one step of it is one of its simulation. Raises ImportError."""
    import gymnasium
    import highway_env

    gymnasium.register_envs(highway_env)
    env = gymnasium.make("lane-keeping-v0").unwrapped
    env.reset(seed=0)

    def advance(step: int) -> None:
        if step % 200 == 0:
            env.reset(seed=0)
        env.step(np.array([_angle_rad(step)]))

    return advance
