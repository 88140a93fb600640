"""The laws and the cars that the benchmarks compare."""

from dataclasses import replace

from controller.controller import Controller, ControllerSettings
from controller.laws.lateral import LawName
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import ClosedLoop, build_parts
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import REAR_SLIP, Vehicle
from trepid.config import CONFIG_DIR, load


def shipped_settings() -> ControllerSettings:
    """``config/controller.yaml``."""
    return load(CONFIG_DIR / "controller.yaml", ControllerSettings)


def with_law(settings: ControllerSettings, law: LawName) -> ControllerSettings:
    """``settings`` with another lateral law."""
    return settings.model_copy(update=dict(lateral=settings.lateral.model_copy(update=dict(law=law))))


def contestants() -> dict[str, ControllerSettings]:
    """The controller with each of its laws."""
    return {law.value: with_law(shipped_settings(), law) for law in LawName}


def unlearning(settings: ControllerSettings) -> ControllerSettings:
    """``settings`` without learning of offset and understeer."""
    return settings.model_copy(update=dict(learning=settings.learning.model_copy(update=dict(enabled=False))))


def nominal() -> Vehicle:
    """``config/vehicle.yaml``."""
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def with_tyres(vehicle: Vehicle, model: Model) -> Vehicle:
    """``vehicle`` with the rear tyre stiffness of the plants, where ``model`` has tyres."""
    if model is Model.KINEMATIC:
        return vehicle
    rear_slip = 1.0 / (PlantSettings().chassis.rear_stiffness_per_rad * GRAVITY_MPS2)
    return vehicle.model_copy(update={REAR_SLIP: rear_slip})


def drive_scenario(scenario: Scenario, controller: Controller, *, seed: int) -> Trace:
    """``scenario`` driven by the whole chain with another controller."""
    parts = replace(build_parts(scenario, seed=seed), controller=controller)
    return ClosedLoop(scenario, parts, load_simulator()).drive()
