"""The vehicle of highway-env's lane-keeping task as a plant: an independent linear single track.

Mass, axles and cornering stiffnesses are those of `sim_harness.world.plants.axles`, which gives the understeer of
the vehicle file; equations and Runge-Kutta steps are highway-env's. The tyres never slide and a banked road is not
simulated. Below 1 m/s, where the model does not steer, the kinematic plant replaces it.

Leurent, An Environment for Autonomous Driving Decision-Making (2018), ``highway_env/vehicle/dynamics.py``.
"""

import math

import numpy as np

from sim_harness.world.plants.actuators import Actuation
from sim_harness.world.plants.axles import axles_of
from sim_harness.world.plants.foreign import ForeignPlant, Inner, Pose
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.car.vehicle import Vehicle
from trepid.config import InputError

_MAX_STEP_S = 0.01


class HighwayEnvPlant(ForeignPlant):
    """highway-env's vehicle. ``inner`` = (lateral speed at the centre of gravity, yaw rate)."""

    ROLLING_MPS = 1.0  # below this highway-env damps the lateral motion instead of steering
    YAW_RATE_AT = 1

    def __init__(self, vehicle: Vehicle, settings: PlantSettings) -> None:
        """Raises InputError for a banked or slippery road, and where the package is not installed."""
        if settings.bank_rad != 0.0 or settings.friction != 1.0:
            raise InputError("plant: model 'highway_env' simulates neither a banked road nor its friction")
        try:
            from highway_env.vehicle.dynamics import BicycleVehicle
        except ImportError as error:
            raise InputError("plant: model 'highway_env' needs: pip install 'trepid[bench]'") from error
        axles = axles_of(vehicle, settings)
        car = BicycleVehicle(road=None, position=[0.0, 0.0])  # every step overwrites its state
        car.MASS, car.INERTIA_Z = axles.mass_kg, axles.yaw_inertia_kgm2
        car.LENGTH_A, car.LENGTH_B = axles.cg_to_front_m, axles.cg_to_rear_m
        # highway-env counts one tyre of the two.
        car.FRICTION_FRONT = axles.front_stiffness_nprad / 2
        car.FRICTION_REAR = axles.rear_stiffness_nprad / 2
        car.MAX_SPEED = math.inf
        self._car = car
        super().__init__(
            vehicle, settings, rolling=KinematicPlant(vehicle, settings), cg_to_rear_m=axles.cg_to_rear_m
        )

    def _integrate(
        self, state: PlantState, start: Pose, accel_demand_mps2: float, h: float
    ) -> tuple[Pose, Actuation, Inner]:
        _, middle, end = self.actuators.during(state, accel_demand_mps2, h)
        car = self._car
        car.position, car.heading, car.speed = np.array(start[:2]), start[2], state.speed_mps
        yaw_rate_radps = self.yaw_rate_radps(state)
        car.lateral_speed, car.yaw_rate = state.inner or (self._cg_m * yaw_rate_radps, yaw_rate_radps)
        accel_mps2 = (end.speed_mps - state.speed_mps) / h
        steps = math.ceil(h / _MAX_STEP_S - 1e-6)
        for _ in range(steps):
            car.action = {"steering": middle.tyre_angle_rad, "acceleration": accel_mps2}
            car.step(h / steps)
        pose = (float(car.position[0]), float(car.position[1]), float(car.heading))
        return pose, end, (float(car.lateral_speed), float(car.yaw_rate))
