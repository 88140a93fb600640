"""A vehicle whose model answers with a lateral acceleration, as one that was learned from drives does.

The model is given the wheel angle, after the steering of the vehicle file, as the curvature κ that it would hold by
that file (:meth:`.kinematic.KinematicPlant.curvature_1pm`). It answers with the lateral acceleration a, and the
centre of the rear axle moves on an arc:

    ψ' = a/v      x' = v·cos ψ      y' = v·sin ψ

over a step at the constant ψ' of its beginning, by the midpoint rule.
"""

import math
from abc import abstractmethod

from sim_harness.world.plants.actuators import state_after
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.state import PlantState

LEAST_MPS = 1.0  # below it the yaw rate is that of this speed: at standstill an acceleration says nothing


class LateralPlant(KinematicPlant):
    """A model implements ``answer``. ``PlantState.inner`` is what it answered last: () before the first answer."""

    @abstractmethod
    def answer(self, state: PlantState, curvature_1pm: float, h: float) -> tuple[float, ...]:
        """Lateral acceleration [m/s²], + left, over the next ``h`` [s], then all that the model keeps.

        ``curvature_1pm``: of the path that the wheels would hold by the vehicle file at the speed of ``state``;
        times v² it is the demanded lateral acceleration. :meth:`lateral_mps2` is that of ``state``.
        """

    def lateral_mps2(self, state: PlantState) -> float:
        """The lateral acceleration with which ``state`` was reached."""
        return self.yaw_rate_radps(state) * max(state.speed_mps, LEAST_MPS)

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ' = a/v; by the wheels before the first answer."""
        if not state.inner:
            return super().yaw_rate_radps(state)
        return state.inner[0] / max(state.speed_mps, LEAST_MPS)

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        """``state`` after ``h`` [s] with the lateral acceleration that the model answers."""
        angle_rad = self.actuators.at(state).tyre_angle_rad
        inner = self.answer(state, self.curvature_1pm(angle_rad, state.speed_mps), h)
        turn_rad, way_m = inner[0] / max(state.speed_mps, LEAST_MPS) * h, state.speed_mps * h
        middle_rad = state.yaw_rad + turn_rad / 2
        pose = (
            state.x_m + way_m * math.cos(middle_rad),
            state.y_m + way_m * math.sin(middle_rad),
            state.yaw_rad + turn_rad,
        )
        return state_after(state, self.actuators.after(state, accel_demand_mps2, h), h, pose, inner=inner)
