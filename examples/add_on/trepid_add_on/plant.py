"""A plant: the kinematic car with a heavy load, whose drive and brakes answer half as strongly."""

from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.state import PlantState

SHARE = 0.5


class HeavyCar(KinematicPlant):
    """A kinematic bicycle that reaches half of the demanded acceleration."""

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        """``state`` after ``h`` [s]."""
        return super().advance(state, SHARE * accel_demand_mps2, h)
