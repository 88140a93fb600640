"""The vehicle of highway-env's lane-keeping task as a plant: a linear single track that is not ours.

Its mass, axles and cornering stiffnesses are set to those of `sim_harness.world.plants.axles`, so it understeers as
the vehicle file says; its equations and its Runge-Kutta steps are its own. Its tyres never slide, it knows no bank,
and its author calls its model below 1 m/s not realistic (it does not steer there): the kinematic plant takes over.

Leurent, An Environment for Autonomous Driving Decision-Making (2018), ``highway_env/vehicle/dynamics.py``.
"""

import math

import numpy as np

from sim_harness.world.plants.actuators import Actuators, moved
from sim_harness.world.plants.axles import ANTI_LOCK, GRAVITY_MPS2, axles_of
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.config import InputError
from trepid.messages import Command
from trepid.vehicle import Vehicle

ROLLING_MPS = 1.0  # below this highway-env damps the lateral motion instead of steering
_MAX_STEP_S = 0.01


class HighwayEnvPlant:
    """Advances a :class:`PlantState` with ``inner`` = (lateral speed at the centre of gravity, yaw rate)."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings) -> None:
        """Raises InputError for a bank or another friction than 1, and where the package is not installed."""
        if settings.bank_rad != 0.0 or settings.friction != 1.0:
            raise InputError("plant: model 'highway_env' has neither bank nor friction")
        try:
            from highway_env.vehicle.dynamics import BicycleVehicle
        except ImportError as error:
            raise InputError("plant: model 'highway_env' needs: pip install 'trepid[bench]'") from error
        self.vehicle = vehicle
        axles = axles_of(vehicle, settings)
        self._cg_m = axles.cg_to_rear_m
        self._car = BicycleVehicle(
            road=None, position=[0.0, 0.0]
        )  # holds parameters; every step sets its state
        self._car.MASS, self._car.INERTIA_Z = axles.mass_kg, axles.yaw_inertia_kgm2
        self._car.LENGTH_A, self._car.LENGTH_B = axles.cg_to_front_m, axles.cg_to_rear_m
        # highway-env counts one tyre of the two.
        self._car.FRICTION_FRONT = axles.front_stiffness_nprad / 2
        self._car.FRICTION_REAR = axles.rear_stiffness_nprad / 2
        self._car.MAX_SPEED = math.inf
        self._rolling = KinematicPlant(vehicle, settings)
        self.actuators = Actuators(vehicle, settings, grip_mps2=ANTI_LOCK * GRAVITY_MPS2)

    def initial(
        self,
        x_m: float = 0.0,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        speed_mps: float = 0.0,
        curvature_1pm: float = 0.0,
    ) -> PlantState:
        """Rolling without slip on ``curvature_1pm``; the tyres settle within some tenths of a second."""
        return self._rolling.initial(x_m, y_m, yaw_rad, speed_mps, curvature_1pm)

    def step(self, state: PlantState, command: Command, dt_s: float) -> PlantState:
        """State after ``dt_s`` under ``command``. Raises ValueError when a demand is not finite."""
        return self.actuators.drive(state, command, dt_s, self._advance)

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ'."""
        return state.inner[1] if state.inner else self._rolling.yaw_rate_radps(state)

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """v·ψ', which leaves out the part of a changing drift."""
        return state.speed_mps * self.yaw_rate_radps(state)

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """Angle of the steering that holds ``curvature_1pm`` at ``speed_mps``, within the angle limit."""
        return self._rolling.steady_angle_rad(curvature_1pm, speed_mps)

    def _advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        if state.speed_mps < ROLLING_MPS:
            return self._rolling.advance(state, accel_demand_mps2, h)
        middle = self.actuators.after(state, accel_demand_mps2, h / 2)
        end = self.actuators.after(state, accel_demand_mps2, h)
        car = self._car
        self._set(state)
        accel_mps2 = (end.speed_mps - state.speed_mps) / h
        steps = math.ceil(h / _MAX_STEP_S - 1e-6)
        for _ in range(steps):
            car.action = {"steering": middle.tyre_angle_rad, "acceleration": accel_mps2}
            car.step(h / steps)
        x_m = float(car.position[0]) - self._cg_m * math.cos(car.heading)
        y_m = float(car.position[1]) - self._cg_m * math.sin(car.heading)
        fast = end.speed_mps >= ROLLING_MPS
        inner = (float(car.lateral_speed), float(car.yaw_rate)) if fast else ()
        return moved(state, end, h, (x_m, y_m, float(car.heading)), inner)

    def _set(self, state: PlantState) -> None:
        """Give ``state`` to highway-env's vehicle, which stands on its centre of gravity."""
        cos, sin = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
        self._car.position = np.array([state.x_m + self._cg_m * cos, state.y_m + self._cg_m * sin])
        self._car.heading, self._car.speed = state.yaw_rad, state.speed_mps
        yaw_rate_radps = self.yaw_rate_radps(state)
        rolling = (self._cg_m * yaw_rate_radps, yaw_rate_radps)
        self._car.lateral_speed, self._car.yaw_rate = state.inner or rolling
