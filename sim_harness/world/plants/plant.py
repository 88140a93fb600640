"""The one interface to every simulated vehicle, and the way to build one."""

from typing import Protocol

from pydantic import ValidationError

from sim_harness.world.plants.commonroad import CommonRoadPlant
from sim_harness.world.plants.highway_env import HighwayEnvPlant
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.single_track import SingleTrackPlant
from sim_harness.world.plants.state import PlantState
from trepid.config import InputError
from trepid.messages import Command
from trepid.vehicle import Vehicle


class Plant(Protocol):
    """A vehicle on the road plane; the reference point is the centre of the rear axle."""

    vehicle: Vehicle

    def initial(
        self,
        x_m: float = 0.0,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        speed_mps: float = 0.0,
        curvature_1pm: float = 0.0,
    ) -> PlantState:
        """Settled on ``curvature_1pm`` at constant speed."""
        ...

    def step(self, state: PlantState, command: Command, dt_s: float) -> PlantState:
        """State after ``dt_s`` under ``command``. Raises ValueError when a demand is not finite."""
        ...

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ', positive to the left."""
        ...

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """Lateral acceleration in the plane of the road, positive to the left."""
        ...

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """Angle of the steering that holds ``curvature_1pm`` at ``speed_mps``, within the angle limit."""
        ...


def build_plant(settings: PlantSettings, vehicle: Vehicle) -> Plant:
    """The plant of ``settings``; ``vehicle`` is what the car is believed to be. Raises InputError."""
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


def real_vehicle(settings: PlantSettings, vehicle: Vehicle) -> Vehicle:
    """``vehicle`` with the fields that are different in reality. Raises InputError."""
    try:
        return Vehicle.model_validate(vehicle.model_dump() | settings.vehicle)
    except ValidationError as error:
        problem = error.errors()[0]
        raise InputError(f"plant: vehicle.{'.'.join(map(str, problem['loc']))}: {problem['msg']}") from error
