"""The interface of every simulated vehicle, and the parts that all of them share."""

import math
from abc import ABC, abstractmethod
from typing import ClassVar

from sim_harness.world.plants.actuators import Actuators
from sim_harness.world.plants.axles import ANTI_LOCK, GRAVITY_MPS2
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.car.vehicle import Vehicle
from trepid.messages import Command, VehicleState


class Plant(ABC):
    """A vehicle on the plane of the road under it; the reference point is the centre of the rear axle.

    The plane has the grade of the road, and leans by its bank. The weight pulls along the vehicle by
    -g·sin(atan(grade)), and across it to the lower side.

    A model implements ``advance``, ``yaw_rate_radps`` and ``steady_angle_rad``. One whose steering and drive have
    their own lag replaces ``step``, which otherwise puts those of the vehicle file before ``advance``.
    """

    LEANS: ClassVar[bool] = True
    """Whether the model simulates a bank."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings) -> None:
        self.vehicle, self._settings = vehicle, settings
        self.bank_mps2 = GRAVITY_MPS2 * math.sin(settings.bank_rad)
        self.grip_mps2 = settings.friction * GRAVITY_MPS2 * math.cos(settings.bank_rad)
        self.actuators = Actuators(vehicle, settings, grip_mps2=ANTI_LOCK * self.grip_mps2)

    def begin(self, seed: int) -> None:
        """Called once before a run; ``seed`` is that of whatever is random in the model."""
        self.seed = seed

    def initial(
        self,
        x_m: float = 0.0,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        speed_mps: float = 0.0,
        curvature_1pm: float = 0.0,
    ) -> PlantState:
        """The steady state on ``curvature_1pm`` at constant speed; ``yaw_rad`` of the vehicle, drift included."""
        angle_rad = self.steady_angle_rad(curvature_1pm, speed_mps)
        return PlantState(
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw_rad,
            speed_mps=speed_mps,
            road_wheel_angle_rad=angle_rad,
            acting_demand_rad=angle_rad,
            inner=self.steady_inner(curvature_1pm, speed_mps),
        )

    def stand_on(self, grade: float, bank_rad: float) -> None:
        """Take the grade and the bank of the road for the steps that follow.

        The bank adds to that of the settings.
        """
        lean_rad = self._settings.bank_rad + bank_rad
        self.bank_mps2 = GRAVITY_MPS2 * math.sin(lean_rad)
        self.grip_mps2 = self._settings.friction * GRAVITY_MPS2 * math.cos(lean_rad)
        self.actuators.pull_mps2 = -GRAVITY_MPS2 * math.sin(math.atan(grade))

    def step(self, state: PlantState, command: Command, dt_s: float) -> PlantState:
        """State after ``dt_s`` under ``command``. Raises ValueError when a demand is not finite."""
        return self.actuators.drive(state, command, dt_s, self.advance)

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """Lateral acceleration v·ψ' in the plane of the road, positive to the left."""
        return state.speed_mps * self.yaw_rate_radps(state)

    def longitudinal_accel_mps2(self, state: PlantState) -> float:
        """Change of the speed: drive and brakes, and the weight; 0 at rest, where the brakes hold."""
        return state.accel_mps2 + self.actuators.pull_mps2 if state.speed_mps > 0.0 else state.accel_mps2

    def measure(self, state: PlantState, t_s: float) -> VehicleState:
        """``state`` as sensors without noise measure it at ``t_s``."""
        return VehicleState(
            t_s=t_s,
            speed_mps=state.speed_mps,
            road_wheel_angle_rad=state.road_wheel_angle_rad,
            yaw_rate_radps=self.yaw_rate_radps(state),
            driver_override=False,
        )

    def steady_inner(self, _curvature_1pm: float, _speed_mps: float) -> tuple[float, ...]:
        """``PlantState.inner`` of the steady state; () where tyres settle from rolling without slip."""
        return ()

    @abstractmethod
    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        """``state`` after ``h`` [s] during which every demand is constant."""

    @abstractmethod
    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ', positive to the left."""

    @abstractmethod
    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """Angle of the steering that holds ``curvature_1pm`` at ``speed_mps``, within the angle limit."""
