"""Builds the plant that a scenario or a drive names."""

from pydantic import ValidationError

from sim_harness.world.plants.commonroad import CommonRoadPlant
from sim_harness.world.plants.highway_env import HighwayEnvPlant
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.single_track import SingleTrackPlant
from trepid import plugins
from trepid.car.vehicle import Vehicle
from trepid.config import InputError


def build_plant(settings: PlantSettings, vehicle: Vehicle, *, seed: int = 0) -> Plant:
    """The plant of ``settings``; ``vehicle`` is the vehicle file that the controller uses. Raises InputError."""
    plant = _plant(settings, vehicle)
    plant.begin(seed)
    return plant


def _plant(settings: PlantSettings, vehicle: Vehicle) -> Plant:
    real = real_vehicle(settings, vehicle)
    match settings.model:
        case Model.KINEMATIC:
            return KinematicPlant(real, settings)
        case Model.SINGLE_TRACK:
            return SingleTrackPlant(real, settings)
        case Model.COMMONROAD_DRIFT | Model.COMMONROAD_MULTI_BODY:
            return CommonRoadPlant(real, settings)
        case Model.HIGHWAY_ENV:
            return HighwayEnvPlant(real, settings)
        case name:
            make = plugins.part(plugins.Group.PLANTS, name, {})
            with plugins.beginning(plugins.Group.PLANTS, name):
                plant: Plant = make(real, settings)
            return plant


def real_vehicle(settings: PlantSettings, vehicle: Vehicle) -> Vehicle:
    """``vehicle`` with the fields that ``settings`` overrides in the simulation. Raises InputError."""
    try:
        return Vehicle.model_validate(vehicle.model_dump() | settings.vehicle)
    except ValidationError as error:
        problem = error.errors()[0]
        raise InputError(f"plant: vehicle.{'.'.join(map(str, problem['loc']))}: {problem['msg']}") from error
