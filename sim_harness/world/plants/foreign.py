"""The common part of plants that integrate the model of another package.

Such a model has tyres, its reference point is the centre of gravity, and it is not valid near standstill. The plant
moves the pose from the rear axle and back, and uses the kinematic plant below the model's lowest speed. There, and
in the initial state, ``PlantState.inner`` is (): rolling without slip.
"""

import math
from abc import abstractmethod
from typing import ClassVar

from sim_harness.world.plants.actuators import Actuation, state_after
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.car.vehicle import Vehicle

Pose = tuple[float, float, float]  # x, y [m], yaw [rad]
Inner = tuple[float, ...]


class ForeignPlant(Plant):
    """A model of another package above ``ROLLING_MPS``, the kinematic plant below."""

    LEANS = False
    ROLLING_MPS: ClassVar[float]
    YAW_RATE_AT: ClassVar[int]  # index of the yaw rate in ``PlantState.inner``

    def __init__(
        self, vehicle: Vehicle, settings: PlantSettings, *, rolling: KinematicPlant, cg_to_rear_m: float
    ) -> None:
        super().__init__(vehicle, settings)
        self._rolling = rolling
        self._cg_m = cg_to_rear_m

    def stand_on(self, grade: float, bank_rad: float) -> None:
        super().stand_on(grade, bank_rad)
        self._rolling.stand_on(grade, bank_rad)

    def yaw_rate_radps(self, state: PlantState) -> float:
        return state.inner[self.YAW_RATE_AT] if state.inner else self._rolling.yaw_rate_radps(state)

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        return self._rolling.steady_angle_rad(curvature_1pm, speed_mps)

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        if state.speed_mps < self.ROLLING_MPS:
            return self._rolling.advance(state, accel_demand_mps2, h)
        cos, sin = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
        start = (state.x_m + self._cg_m * cos, state.y_m + self._cg_m * sin, state.yaw_rad)
        (x_m, y_m, yaw_rad), end, inner = self._integrate(state, start, accel_demand_mps2, h)
        pose = (x_m - self._cg_m * math.cos(yaw_rad), y_m - self._cg_m * math.sin(yaw_rad), yaw_rad)
        return state_after(state, end, h, pose, inner if end.speed_mps >= self.ROLLING_MPS else ())

    @abstractmethod
    def _integrate(
        self, state: PlantState, start: Pose, accel_demand_mps2: float, h: float
    ) -> tuple[Pose, Actuation, Inner]:
        """Pose of the centre of gravity, motion and inner state after ``h`` from its pose ``start``."""
